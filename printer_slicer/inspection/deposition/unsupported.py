"""Find unsupported extrusion, height by height, on the height map of everything printed before.

Extrusion is unsupported if it is more than 5 mm from every supported extrusion and from every bridge of its height. A
bridge runs straight over a gap and is supported at both ends. Adjacent extrusions may overhang by up to 5 mm.

A part may lie on supports, and supports on a part, at the gaps of the settings. Supports lie on other supports without
a gap, so that a missing layer is noticed, and they may overhang by only 2.8 mm along their path.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from math import pi
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, consecutive, median
from printer_slicer.inspection.deposition.height_map import (
    NEGLIGIBLE,
    HeightMap,
    LevelMoves,
    MovePieces,
    find_height_changes,
    kernel_level,
    split_moves,
)
from printer_slicer.inspection.deposition.marks import Marks, Purpose, purposes_of_roles
from printer_slicer.inspection.deposition.support_gaps import SupportGaps
from printer_slicer.kernel import load_kernel
from printer_slicer.profile import Profile
from printer_slicer.roles import Role

if TYPE_CHECKING:
    from printer_slicer.model import Program

__all__ = [
    "MIN_REPORTED_LENGTH",
    "UnsupportedExtrusion",
    "UnsupportedTracker",
    "add_to_height_map",
    "describe_unsupported",
    "find_unsupported_pieces",
    "unsupported_of_program",
]

MIN_REPORTED_LENGTH: Final = 3.0
"""Minimum length, mm, of unsupported or colliding extrusion at one height that is reported."""

_MAX_SAG: Final = 1.15  # strand diameters; the print supports extrusion at most this far above it
_MOVES_AT_ONCE: Final = 1 << 14  # moves of a program that are checked together
_MAX_OVERHANG: Final = 5.0  # mm, overhang of adjacent extrusions that counts as supported
_MAX_SUPPORT_OVERHANG: Final = 2.8  # mm along the path, the same for supports
_SEAM: Final = 0.5  # mm between the ends of a loop
_MAX_CLEARANCE: Final = 1.28  # times the height at which a support would be as wide as others are
_SAME_HEIGHT: Final = 0.02  # mm
_ROUNDING: Final = 1e-4  # mm
_Box = tuple[tuple[float, float], tuple[float, float]]
_MIN_STRAIGHTNESS: Final = 0.95  # minimum ratio of a bridge's chord to its length


def find_unsupported_pieces(
    height_map: HeightMap, moves: LevelMoves, pieces: MovePieces, cell: Int, marks: Marks
) -> Int:
    """Return the indices of the unsupported pieces among the extrusions of one height.

    Args:
        height_map: height map of everything printed before.
        moves: the moves of this height.
        pieces: (P,) pieces of the extruding moves.
        cell: (P,) cell of each piece in the height map.
        marks: layers and roles from the comments.
    """
    none = np.zeros(0, np.int64)
    if len(marks.layers) and not marks.layer_at(moves.command).any():
        return none  # priming may extrude into the air
    removable = _find_removable(moves, marks)
    of_part = _find_in_part(height_map, moves, pieces, cell, (removable, marks))
    if not removable.any():
        return of_part
    of_supports = _find_in_supports(height_map, moves, pieces, cell, (removable, marks))
    return np.union1d(of_part, of_supports) if len(of_supports) else of_part


def _find_in_part(
    height_map: HeightMap, moves: LevelMoves, pieces: MovePieces, cell: Int, known: tuple[Bool, Marks]
) -> Int:
    """Return the indices of the unsupported pieces that stay on the part, see `find_unsupported_pieces`.

    `known` are the mask (n,) of removable moves, and the marks.
    """
    removable, marks = known
    none, gap = np.zeros(0, np.int64), marks.gaps.above
    kernel = load_kernel()
    if kernel:
        level = kernel_level(moves, removable, pieces, cell)
        drop = 0.0 if marks.has_roles else gap
        return height_map.find_unsupported_with(kernel, level, support_gap=gap, drop=drop)
    lowest = pieces.z - moves.strand_diameter.take(pieces.move) * _MAX_SAG
    if not marks.has_roles:
        lowest = lowest - gap  # the layer below may be a support
    is_supported = height_map.is_supported(cell, lowest, gap) | (lowest <= 0)
    if is_supported.all():
        return none
    is_held = is_supported | _find_bridges(moves, pieces, is_supported)
    if is_held.all():
        return none
    is_near = height_map.find_pieces_near_seeds(cell, is_held, _MAX_OVERHANG)
    return np.flatnonzero(~is_near & ~removable.take(pieces.move))


def _find_in_supports(
    height_map: HeightMap, moves: LevelMoves, pieces: MovePieces, cell: Int, known: tuple[Bool, Marks]
) -> Int:
    """Return the indices of the unsupported pieces of supports; arguments as for `_find_in_part`."""
    removable, marks = known
    none = np.zeros(0, np.int64)
    some = np.flatnonzero(removable.take(pieces.move))
    own, own_cell = pieces.take(some), cell[some]
    top, is_on_support = height_map.tops_around(own_cell)
    clearance = own.z - top
    strand = moves.strand_diameter.take(own.move)
    section, most = strand**2 * (pi / 4), strand * _MAX_SAG
    beside = is_on_support & (clearance > _SAME_HEIGHT)
    if beside.any():
        # Over a missing layer, an extrusion would be narrower than the others.
        width = median(section[beside] / clearance[beside])
        most = np.minimum(most, _MAX_CLEARANCE * section / width)
    most = np.where(is_on_support | (top <= 0), most, most + marks.gaps.below)
    is_supported = clearance <= most + _ROUNDING
    if is_supported.all():
        return none
    is_held = is_supported | _find_bridges(moves, own, is_supported)
    return some[_measure_to_held(moves, own, is_held) > _MAX_SUPPORT_OVERHANG]


def _measure_to_held(moves: LevelMoves, pieces: MovePieces, is_held: Bool) -> Float:
    """Return the distance (P,) along the path from each piece to the nearest one that is held, mm; inf without one."""
    path = _number_paths(moves, pieces)
    n = int(path[-1]) + 1
    first, last = np.searchsorted(path, np.arange(n)), np.searchsorted(path, np.arange(n), side="right") - 1
    place = np.cumsum(pieces.length)
    start, end = moves.start[pieces.move[first], :2], moves.end[pieces.move[last], :2]
    whole = place[last] - place[first] + pieces.length[first]
    closed = np.hypot(*(end - start).T) <= _SEAM
    held = np.flatnonzero(is_held)
    at, own = place[held], path[held]
    low, high = np.searchsorted(own, np.arange(n)), np.searchsorted(own, np.arange(n), side="right") - 1
    around = np.where(closed & (low <= high), whole, np.inf)
    if not len(held):
        return np.full(len(path), np.inf)
    index = np.searchsorted(at, place)
    after, before = np.minimum(index, len(at) - 1), np.maximum(index - 1, 0)
    # Beyond the first and the last held piece of a loop lies the last or the first one.
    head, tail = at[np.minimum(low, len(at) - 1)], at[np.maximum(high, 0)]
    next_one = np.where((index < len(at)) & (own[after] == path), at[after], (head + around)[path])
    previous = np.where((index > 0) & (own[before] == path), at[before], (tail - around)[path])
    return np.asarray(np.where(is_held, 0.0, np.minimum(next_one - place, place - previous)))


def _number_paths(moves: LevelMoves, pieces: MovePieces) -> Int:
    """Return the number (P,) of the path of each piece, from 0; a path goes on where the nozzle does not jump."""
    broken = (np.diff(pieces.move) > 0) & (
        np.hypot(*(moves.start[pieces.move[1:]] - moves.end[pieces.move[:-1]])[:, :2].T) > NEGLIGIBLE
    )
    return np.append(0, np.cumsum(broken))


def add_to_height_map(
    height_map: HeightMap, moves: LevelMoves, pieces: MovePieces, cell: Int, marks: Marks
) -> None:
    """Add extrusions to the height map with their full width; arguments as for `find_unsupported_pieces`."""
    removable = _find_removable(moves, marks)
    kernel = load_kernel()
    if kernel:
        height_map.add_with(kernel, kernel_level(moves, removable, pieces, cell))
        return
    width = moves.width(-height_map.depth_below_print(cell, pieces.z))
    if not removable.any():
        height_map.add_extrusions(pieces, moves.perpendicular, width, removable=False)
        return
    for is_removable in (True, False):
        selected = np.flatnonzero(removable.take(pieces.move) == is_removable)
        if len(selected):
            height_map.add_extrusions(
                pieces.take(selected), moves.perpendicular, width, removable=is_removable
            )


def _find_removable(moves: LevelMoves, marks: Marks) -> Bool:
    """Return a mask (n,) of moves whose extrusion is removed after the print, such as supports."""
    result = np.zeros(len(moves.role), np.bool_)
    for role in marks.removable:
        result |= moves.role == role
    return result


def _find_bridges(moves: LevelMoves, pieces: MovePieces, is_supported: Bool) -> Bool:
    """Return a mask (P,) of pieces in bridges: straight lines over a gap, supported at both ends."""
    path = _number_paths(moves, pieces)
    unsupported = ~is_supported
    begins = unsupported & (np.append(True, is_supported[:-1]) | np.append(True, np.diff(path) > 0))
    first = np.flatnonzero(begins)
    ends = unsupported & (np.append(is_supported[1:], True) | np.append(np.diff(path) > 0, True))
    last = np.flatnonzero(ends)
    starts_supported = (first > 0) & (path[np.maximum(first - 1, 0)] == path[first])
    ends_supported = (last < len(path) - 1) & (path[np.minimum(last + 1, len(path) - 1)] == path[last])
    total = np.append(0.0, np.cumsum(pieces.length))
    length = total[last + 1] - total[first]
    chord = (
        np.hypot(pieces.x[last] - pieces.x[first], pieces.y[last] - pieces.y[first]) + pieces.length[first]
    )
    is_bridge = starts_supported & ends_supported & (chord >= _MIN_STRAIGHTNESS * length)
    result = np.zeros(len(is_supported), np.bool_)
    result[consecutive(first[is_bridge], (last - first + 1)[is_bridge])] = True
    return result


class UnsupportedExtrusion(NamedTuple):
    """The unsupported extrusion at one height.

    Attributes:
        command: the first command that extrudes it, counted from 1.
        layer: counted from 1; 0 if the file has no layer comments.
        z, x, y: mm, position of its first piece.
        length: mm, total length.
    """

    command: int
    layer: int
    z: float
    x: float
    y: float
    length: float


class _SplitMoves(NamedTuple):
    """Moves, their pieces, and the cells of these in the height map."""

    moves: LevelMoves
    pieces: MovePieces
    cell: Int


class UnsupportedTracker:
    """Collects the unsupported extrusion of a print from batches of its moves.

    Args:
        box: corners of the area that the nozzle can reach, x and y, mm; extrusion outside is ignored.
        area: mm², cross-section of the filament.
        marks: layers and roles from the comments.
    """

    def __init__(self, box: _Box, area: float, marks: Marks) -> None:
        self._box, self._area, self._marks = box, area, marks
        self._height_map: HeightMap | None = None
        self._queue: list[_SplitMoves] = []
        self._z = np.nan
        self._found: list[UnsupportedExtrusion] = []

    def add_moves(self, command: Int, start: Float, end: Float, new_filament: Float) -> None:
        """Add moves in printing order.

        Args:
            command: (n,) command of each move, counted from 1, ascending.
            start: (n, 3) mm.
            end: (n, 3) mm.
            new_filament: (n,) mm of filament that leaves the nozzle.
        """
        xy_length = np.hypot(*(end - start)[:, :2].T)
        volume = new_filament * self._area
        extruding = np.flatnonzero((volume > NEGLIGIBLE) & (xy_length > NEGLIGIBLE))
        if not len(extruding):
            return
        columns = (
            command[extruding],
            start[extruding],
            end[extruding],
            volume[extruding],
            xy_length[extruding],
        )
        moves = LevelMoves(
            *columns, np.ones(len(extruding), np.bool_), self._marks.role_at(command[extruding])
        )
        firsts, heights = find_height_changes(np.arange(len(extruding)), end[extruding, 2], self._z)
        levels = self._split(moves, [0, *firsts, len(extruding)])
        self._queue.append(levels[0])
        for level, height in zip(levels[1:], heights, strict=True):
            self._check_queue()
            self._queue, self._z = [level], height

    def _split(self, moves: LevelMoves, borders: list[int]) -> list[_SplitMoves]:
        """Split moves into pieces, and divide them at some of the moves."""
        height_map = self._height_map = self._height_map or HeightMap(*self._box)
        pieces = split_moves(moves.start, moves.end)
        cell = height_map.cells(pieces)
        ends = np.searchsorted(pieces.move, borders).tolist()
        return [
            _SplitMoves(moves.select_range(*some), pieces.select_range(*own, some[0]), cell[slice(*own)])
            for some, own in zip(pairwise(borders), pairwise(ends), strict=True)
        ]

    def read_height_map(self) -> HeightMap | None:
        """Return the height map of all moves so far; None if nothing is printed."""
        self._check_queue()
        return self._height_map

    def close(self) -> tuple[UnsupportedExtrusion, ...]:
        """Return all unsupported extrusion, in the order of the commands."""
        self._check_queue()
        return tuple(self._found)

    def _check_queue(self) -> None:
        """Check all queued moves of one height."""
        waiting, self._queue = [one for one in self._queue if len(one.cell)], []
        height_map = self._height_map
        if height_map is None or not waiting:
            return
        moves, pieces, cell = waiting[0]
        if len(waiting) > 1:
            moves = LevelMoves.concatenate([one.moves for one in waiting])
            pieces = split_moves(moves.start, moves.end)
            cell = height_map.cells(pieces)
        unsupported = find_unsupported_pieces(height_map, moves, pieces, cell, self._marks)
        length = float(pieces.length[unsupported].sum())
        if length > MIN_REPORTED_LENGTH:
            piece = int(unsupported[0])
            command = int(moves.command[pieces.move[piece]])
            layer = int(self._marks.layer_at(np.array([command]))[0])
            z, x, y = (float(column[piece]) for column in (pieces.z, pieces.x, pieces.y))
            self._found.append(UnsupportedExtrusion(command, layer, z, x, y, length))
        add_to_height_map(height_map, moves, pieces, cell, self._marks)


def unsupported_of_program(program: Program, profile: Profile) -> tuple[UnsupportedExtrusion, ...]:
    """Return the unsupported extrusion of a sliced program; commands are its moves."""
    change = np.flatnonzero(np.diff(program.role, prepend=-1) != 0)
    role = np.where(program.role[change] == Role.TRAVEL, 0, purposes_of_roles(program.role[change]))
    is_new = np.diff(role, prepend=-1) != 0
    marks = Marks(
        layers=np.searchsorted(program.layer, np.arange(program.plan.n_layers)) + 1,
        roles=change[is_new] + 1,
        names=role[is_new],
        removable=frozenset({int(Purpose.SUPPORT_MATERIAL)}),
        gaps=SupportGaps.of(profile),
    )
    tracker = UnsupportedTracker(profile.printer.corners, profile.material.filament_area, marks)
    for first in range(0, program.n_moves, _MOVES_AT_ONCE):
        last = min(first + _MOVES_AT_ONCE, program.n_moves)
        before = program.xyz[first - 1] if first else program.origin
        end = program.xyz[first:last]
        new_filament = np.where(program.role[first:last] == Role.TRAVEL, 0.0, program.filament[first:last])
        start = np.concatenate([before[None], end[:-1]])
        tracker.add_moves(np.arange(first, last) + 1, start, end, new_filament)
    return tracker.close()


def describe_unsupported(found: Sequence[UnsupportedExtrusion]) -> str:
    """Describe unsupported extrusion in one sentence: total length, and position of the first."""
    first, length = found[0], sum(one.length for one in found)
    where = [f"layer {first.layer}"] if first.layer else []
    where += [f"z {first.z:.6g} mm, x {first.x:.1f} y {first.y:.1f}"]
    several = f" at {len(found)} heights, first" if len(found) > 1 else ""
    return f"{length:.0f} mm of unsupported extrusion{several} at {', '.join(where)}"
