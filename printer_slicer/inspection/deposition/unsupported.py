"""Find unsupported extrusion, height by height, against everything printed before.

Extrusion is unsupported if it lies more than 5 mm from every extrusion of its height that rests on something or that
bridges: it runs straight over a gap and rests at both ends. Extrusions side by side may overhang that far.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import pi
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, consecutive
from printer_slicer.inspection.deposition.height_map import (
    NOTHING,
    HeightMap,
    LevelMoves,
    MovePieces,
    runs_of,
    split_moves,
)
from printer_slicer.inspection.deposition.marks import Marks, Purpose, purposes_of_roles
from printer_slicer.profile import Profile
from printer_slicer.roles import Role

if TYPE_CHECKING:
    from printer_slicer.model import Program

__all__ = [
    "MIN_REPORTED_LENGTH",
    "Unsupported",
    "UnsupportedTracker",
    "deposit",
    "describe",
    "unsupported_of_program",
    "unsupported_pieces",
]

MIN_REPORTED_LENGTH: Final = 3.0
"""Length, mm, of unsupported or colliding extrusion at one height from which it is reported."""

_THREAD: Final = 1.15  # of its diameter that a strand may sag
_CONTACT: Final = 0.32  # mm that slicers leave between supports and the part
_LIP: Final = 5.0  # mm that extrusions side by side may overhang
_Box = tuple[tuple[float, float], tuple[float, float]]
_STRAIGHT: Final = 0.95  # chord divided by length, from which a stretch that rests at both ends is a bridge


def unsupported_pieces(
    height_map: HeightMap, laid: LevelMoves, cut: MovePieces, cell: Int, marks: Marks
) -> Int:
    """Return the unsupported pieces of the extrusions of one height.

    Args:
        height_map: height map of everything printed before.
        laid: the moves of this height.
        cut: (P,) pieces of the extruding moves.
        cell: (P,) cell of the relief of each piece.
        marks: layers and roles from the comments.
    """
    none = np.zeros(0, np.int64)
    if len(marks.layers) and not marks.layer(laid.command).any():
        return none  # priming may extrude into the air
    lowest = cut.z - laid.thread[cut.move] * _THREAD
    if not marks.has_roles:
        lowest = lowest - _CONTACT  # the layer below may be a support
    is_supported = height_map.is_supported(cell, lowest, _CONTACT) | (lowest <= 0)
    if is_supported.all():
        return none
    held = is_supported | _bridges(laid, cut, is_supported)
    if held.all():
        return none
    # Supports are removed later: whether they hold is the slicer's responsibility.
    removable = np.isin(laid.role, [*marks.removable])[cut.move]
    return np.flatnonzero(~height_map.connected(cell, held, _LIP) & ~removable)


def deposit(height_map: HeightMap, laid: LevelMoves, cut: MovePieces, cell: Int, marks: Marks) -> None:
    """Add extrusions to the relief at their full width; arguments as above."""
    width = laid.width(-height_map.depth(cell, cut.z))
    removable = np.isin(laid.role, [*marks.removable])[cut.move]
    for kind in (True, False):
        own = np.flatnonzero(removable == kind)
        if len(own):
            height_map.add_extrusions(cut.take(own), laid.sideways, width, removable=kind)


def _bridges(laid: LevelMoves, cut: MovePieces, is_supported: Bool) -> Bool:
    """Return a mask (P,) of pieces in a straight line over a gap that is supported at both ends."""
    broken = (np.diff(cut.move) > 0) & (
        np.hypot(*(laid.start[cut.move[1:]] - laid.end[cut.move[:-1]])[:, :2].T) > NOTHING
    )
    path = np.append(0, np.cumsum(broken))
    hangs = ~is_supported
    begins = hangs & (np.append(True, is_supported[:-1]) | np.append(True, np.diff(path) > 0))
    first = np.flatnonzero(begins)
    ends = hangs & (np.append(is_supported[1:], True) | np.append(np.diff(path) > 0, True))
    last = np.flatnonzero(ends)
    same_before = (first > 0) & (path[np.maximum(first - 1, 0)] == path[first])
    same_behind = (last < len(path) - 1) & (path[np.minimum(last + 1, len(path) - 1)] == path[last])
    total = np.append(0.0, np.cumsum(cut.length))
    length = total[last + 1] - total[first]
    chord = np.hypot(cut.x[last] - cut.x[first], cut.y[last] - cut.y[first]) + cut.length[first]
    bridge = same_before & same_behind & (chord >= _STRAIGHT * length)
    result = np.zeros(len(is_supported), np.bool_)
    result[consecutive(first[bridge], (last - first + 1)[bridge])] = True
    return result


class Unsupported(NamedTuple):
    """Unsupported extrusion of one height.

    Attributes:
        command: the first command that extrudes it, counted from 1.
        layer: counted from 1; 0 if the file has no layer comments.
        z, x, y: mm, start of it.
        length: mm, in total.
    """

    command: int
    layer: int
    z: float
    x: float
    y: float
    length: float


class UnsupportedTracker:
    """Collects the unsupported extrusion of a print from batches of its moves.

    Args:
        box: corners of what the nozzle can reach, x and y, mm; extrusion outside is ignored.
        area: mm² of the filament.
        marks: layers and roles from the comments.
    """

    def __init__(self, box: _Box, area: float, marks: Marks) -> None:
        self._box, self._area, self._marks = box, area, marks
        self._height_map: HeightMap | None = None
        self._waiting: list[LevelMoves] = []
        self._z = np.nan
        self._found: list[Unsupported] = []

    def feed(self, command: Int, start: Float, end: Float, fresh: Float) -> None:
        """Add moves.

        Args:
            command: (n,) command of each move, counted from 1, ascending.
            start: (n, 3) mm.
            end: (n, 3) mm.
            fresh: (n,) mm of filament that leaves the nozzle.
        """
        flat = np.hypot(*(end - start)[:, :2].T)
        volume = fresh * self._area
        at = np.flatnonzero((volume > NOTHING) & (flat > NOTHING))
        columns = (command[at], start[at], end[at], volume[at], flat[at])
        some = LevelMoves(*columns, np.ones(len(at), np.bool_), self._marks.role(command[at]))
        firsts, heights = runs_of(np.arange(len(at)), end[at, 2], self._z)
        begin = 0
        for first, height in zip(firsts, heights, strict=True):
            self._waiting.append(some.between(begin, first))
            self._check_waiting()
            begin, self._z = first, height
        self._waiting.append(some.between(begin, len(at)))

    def close(self) -> tuple[Unsupported, ...]:
        """Return everything found, in the order of the commands."""
        self._check_waiting()
        return tuple(self._found)

    def _check_waiting(self) -> None:
        """Check all collected moves of one height."""
        waiting, self._waiting = self._waiting, []
        if not any(len(one.command) for one in waiting):
            return
        laid = LevelMoves.joined(waiting)
        height_map = self._height_map = self._height_map or HeightMap(*self._box)
        cut = split_moves(laid.start, laid.end)
        cell = height_map.cells(cut)
        lost = unsupported_pieces(height_map, laid, cut, cell, self._marks)
        length = float(cut.length[lost].sum())
        if length > MIN_REPORTED_LENGTH:
            at = int(lost[0])
            command = int(laid.command[cut.move[at]])
            layer = int(self._marks.layer(np.array([command]))[0])
            z, x, y = (float(column[at]) for column in (cut.z, cut.x, cut.y))
            self._found.append(Unsupported(command, layer, z, x, y, length))
        deposit(height_map, laid, cut, cell, self._marks)


def unsupported_of_program(program: Program, profile: Profile) -> tuple[Unsupported, ...]:
    """Return the unsupported extrusion of a sliced program; commands are its moves."""
    role = np.where(program.role == Role.TRAVEL, 0, purposes_of_roles(program.role))
    first = np.flatnonzero(np.diff(role, prepend=-1) != 0)
    marks = Marks(
        layers=np.searchsorted(program.layer, np.arange(program.plan.n_layers)) + 1,
        roles=first + 1,
        names=role[first],
        removable=frozenset({int(Purpose.SUPPORT_MATERIAL)}),
    )
    tracker = UnsupportedTracker(
        profile.printer.corners, pi * profile.material.filament_diameter**2 / 4, marks
    )
    fresh = np.where(program.role == Role.TRAVEL, 0.0, program.filament)
    tracker.feed(np.arange(program.n_moves) + 1, program.start, program.xyz, fresh)
    return tracker.close()


def describe(found: Sequence[Unsupported]) -> str:
    """Describe the findings in one sentence: total length, and position of the first."""
    first, length = found[0], sum(one.length for one in found)
    where = [f"layer {first.layer}"] if first.layer else []
    where += [f"z {first.z:.6g} mm, x {first.x:.1f} y {first.y:.1f}"]
    several = f" at {len(found)} heights, first" if len(found) > 1 else ""
    return f"{length:.0f} mm of unsupported extrusion{several} at {', '.join(where)}"
