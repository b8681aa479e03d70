"""Height map of the plate: the top of the print in each cell, collisions with it, and unsupported extrusions.

Cells are 0.25 mm wide. A bead marks the cells whose middle it covers, as wide as its spacing, so that neighbours leave
no gap and what only brushes its side does not count as going through it. It rests where something stands under it, or
in a cell beside that, no farther down than the thread that leaves the nozzle is thick.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import pi
from typing import Final

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, consecutive, median
from printer_slicer.inspection.deposition.marks import Defect, Marks
from printer_slicer.motion.vectorized import volumetric_flow

__all__ = [
    "CELL",
    "COMMAND",
    "END",
    "FED",
    "NOTHING",
    "START",
    "HeightMap",
    "LevelMoves",
    "MoveBatch",
    "MovePieces",
    "PlateHeights",
    "runs_of",
    "split_moves",
]

CELL: Final = 0.25
"""mm."""

_REACH: Final = 1  # cells to all sides within which a bead may rest
_WIDEST: Final = 2.0  # mm that a bead marks at most, however much is fed
_SPARE: Final = 2.0  # mm around what machines reach


@dataclass(frozen=True, slots=True, eq=False)
class MovePieces:
    """Moves in pieces no longer than a cell.

    Attributes:
        move: (P,) index of the move of each.
        x, y, z: (P,) mm, its middle; a move straight up or down is one piece at its lower end.
        length: (P,) mm in the plane.
    """

    move: Int
    x: Float
    y: Float
    z: Float
    length: Float

    def take(self, which: Int) -> MovePieces:
        """Some of the pieces."""
        return MovePieces(self.move[which], self.x[which], self.y[which], self.z[which], self.length[which])

    def beside(self, side: Float) -> MovePieces:
        """Return the pieces shifted with their moves by (n, 2) mm in the plane."""
        x, y = (np.ascontiguousarray(side[:, axis])[self.move] for axis in (0, 1))
        x += self.x
        y += self.y
        return MovePieces(self.move, x, y, self.z, self.length)


def split_moves(start: Float, end: Float) -> MovePieces:
    """Moves from (n, 3) to (n, 3) mm in pieces, in order."""
    way = end - start
    length = np.hypot(way[:, 0], way[:, 1])
    count = np.maximum(np.ceil(length / CELL), 1).astype(np.int64)
    move = np.repeat(np.arange(len(start)), count)
    share = (consecutive(np.zeros(len(start), np.int64), count) + 0.5) / count[move]
    z = start[move, 2] + share * way[move, 2]
    upright = (length == 0)[move]
    z[upright] = np.minimum(start[move, 2], end[move, 2])[upright]
    return MovePieces(
        move,
        start[move, 0] + share * way[move, 0],
        start[move, 1] + share * way[move, 1],
        z,
        (length / count)[move],
    )


@dataclass(frozen=True, slots=True, eq=False)
class PlateHeights:
    """What stands on the plate, seen from above.

    Attributes:
        top: (rows, columns) mm; the first row is the front one, 0 is where nothing stands.
        left, front: mm, the corner of the first cell.
        cell: mm.
    """

    top: Float
    left: float
    front: float
    cell: float


class HeightMap:
    """Height of the print so far in each cell of the plate.

    Args:
        low, high: corners of what the nozzle can reach, x and y, mm; what lies outside is not looked at.

    Attributes:
        highest: mm, of everything laid.
    """

    def __init__(self, low: tuple[float, float], high: tuple[float, float]) -> None:
        self._left, self._front = low[0] - _SPARE, low[1] - _SPARE
        self._wide = int(np.ceil((high[0] + _SPARE - self._left) / CELL)) + 1
        self._deep = int(np.ceil((high[1] + _SPARE - self._front) / CELL)) + 1
        # The last cell stands for everything outside: nothing is there, and nothing stays.
        self._outside = self._wide * self._deep
        self._top = np.zeros(self._outside + 1, np.float32)
        self._removable = np.zeros(self._outside + 1, np.bool_)
        self.highest = 0.0

    def cells(self, cut: MovePieces) -> Int:
        """Return the cell (P,) of each piece."""
        # Rounded towards 0, which is cheap: what lies less than a cell outside goes to the edge, where nothing is.
        column = ((cut.x - self._left) * (1 / CELL)).astype(np.int64)
        row = ((cut.y - self._front) * (1 / CELL)).astype(np.int64)
        inside = (column >= 0) & (column < self._wide) & (row >= 0) & (row < self._deep)
        return np.where(inside, row * self._wide + column, self._outside)

    def depth(self, cell: Int, z: Float) -> Float:
        """Return how far (P,) the nozzle at z is below the print in its cell, mm; negative if above."""
        return np.asarray(self._top[cell] - z)

    def deepest(self, cell: Int, z: Float) -> Float:
        """Return the largest such depth (P,) in the cell and its neighbours: a nozzle is wider than a cell."""
        around = [row * self._wide + column for row in (-1, 0, 1) for column in (-1, 0, 1)]
        beside = np.clip(cell[:, None] + np.array(around), 0, self._outside)
        return np.asarray(self._top[beside].max(axis=1, initial=0.0) - z)

    def is_supported(self, cell: Int, lowest: Float, spare: float) -> Bool:
        """Return whether (P,) the print reaches up to `lowest`, mm, below a piece or beside it.

        Args:
            cell: of each piece.
            lowest: (P,) mm, how far down its thread reaches.
            spare: mm that supports may be lower.
        """
        result = self._reaches(cell, lowest, spare)
        missing = np.flatnonzero(~result)
        for row in range(-_REACH, _REACH + 1):
            for column in range(-_REACH, _REACH + 1):
                if not len(missing):
                    return result
                beside = np.clip(cell[missing] + row * self._wide + column, 0, self._outside)
                found = self._reaches(beside, lowest[missing], spare)
                result[missing[found]] = True
                missing = missing[~found]
        return result

    def add_extrusions(self, cut: MovePieces, sideways: Float, width: Float, *, removable: bool) -> None:
        """Plastic reaches up to these pieces of beads now.

        Args:
            cut: the pieces.
            sideways: (n, 2) across each move.
            width: (n,) mm of each.
            removable: whether the part is taken off these again.
        """
        spread = np.clip(width - CELL, 0.0, _WIDEST)  # between the outermost cells
        rows = np.ceil(spread / CELL)
        least, most = (int(count) for count in (rows[cut.move].min(), rows[cut.move].max()))
        for k in range(most + 1):
            some = cut if k <= least else cut.take(np.flatnonzero((rows >= k)[cut.move]))
            step = np.where(rows > 0, k / np.maximum(rows, 1) - 0.5, 0.0) * spread
            cell = self.cells(some.beside(sideways * step[:, None]))
            np.maximum.at(self._top, cell, some.z.astype(np.float32))
            self._removable[cell] = removable
        self._top[self._outside], self._removable[self._outside] = 0.0, False
        self.highest = max(self.highest, float(cut.z.max()))

    def plate(self, most: int = 1600) -> PlateHeights:
        """Return the heights on the plate, in at most `most` cells per side."""
        top = self._top[: self._outside].reshape(self._deep, self._wide)
        rows, columns = (np.flatnonzero((top > 0).any(axis=axis)) for axis in (1, 0))
        if not len(rows):
            return PlateHeights(np.zeros((0, 0)), self._left, self._front, CELL)
        first, last, left, right = rows[0], rows[-1] + 1, columns[0], columns[-1] + 1
        by = int(max(np.ceil(max(last - first, right - left) / most), 1))
        some = top[first:last, left:right]
        some = np.pad(some, ((0, -some.shape[0] % by), (0, -some.shape[1] % by)))
        coarse = some.reshape(some.shape[0] // by, by, some.shape[1] // by, by).max(axis=(1, 3))
        return PlateHeights(
            coarse.astype(np.float64), self._left + left * CELL, self._front + first * CELL, by * CELL
        )

    def connected(self, cell: Int, seeds: Bool, reach: float) -> Bool:
        """Return a mask (P,) of pieces within `reach` mm of a seed, along cells with pieces."""
        rows, columns = np.divmod(cell, self._wide)
        top, left = rows.min() - 3, columns.min() - 3
        shape = (int(rows.max() - top) + 4, int(columns.max() - left) + 4)
        place = (rows - top) * shape[1] + columns - left
        held = np.zeros(shape[0] * shape[1], np.bool_)
        held[place] = True
        # Beads lie a few cells apart: between them is plastic, too.
        held = _grown(held.reshape(shape), 1)
        reached = np.zeros(shape, np.bool_)
        reached.reshape(-1)[place[seeds]] = True
        for _ in range(round(reach / CELL)):
            grown = _grown(reached, 1) & held
            if (grown == reached).all():
                break
            reached = grown
        return np.asarray(reached.reshape(-1)[place])

    def _reaches(self, cell: Int, lowest: Float, spare: float) -> Bool:
        """Return whether (P,) the print in a cell reaches up to `lowest`."""
        return np.asarray(self._top[cell] + spare * self._removable[cell] >= lowest - 1e-4)


def _grown(field: Bool, by: int) -> Bool:
    """Return a mask grown by one cell to all sides."""
    for _ in range(by):
        field = field.copy()
        field[1:] |= field[:-1]
        field[:-1] |= field[1:]
        field[:, 1:] |= field[:, :-1]
        field[:, :-1] |= field[:, 1:]
    return field


COMMAND, START, END, FED = 0, slice(1, 4), slice(4, 7), 7
"""Columns of the rows that a printer keeps of its moves: see `sim.move_log`."""

NOTHING: Final = 1e-9
"""mm³ or mm: less is rounding."""

_COLUMNS: Final = ("command", "start", "end", "volume", "flat", "extrudes", "role")
_FLATTEST: Final = 3.0  # times as thick as its bead is the thread of the flattest: six times as wide as high
_LEVEL: Final = 0.02  # mm: what lies so near in z is looked at together


@dataclass(frozen=True, slots=True, eq=False)
class LevelMoves:
    """Moves of one height, and which of them extrude.

    Attributes:
        command: (n,) command of each move, counted from 1.
        start, end: (n, 3) mm.
        volume: (n,) mm³ extruded.
        flat: (n,) mm, length in x and y.
        extrudes: (n,) whether the move extrudes.
        role: (n,) role, see `Marks.role`.
    """

    command: Int
    start: Float
    end: Float
    volume: Float
    flat: Float
    extrudes: Bool
    role: Int

    @property
    def thread(self) -> Float:
        """(n,) mm, diameter of the extruded strand before it is pressed flat."""
        return np.asarray(2.0 * np.sqrt(self.volume / np.maximum(self.flat, NOTHING) / pi))

    @property
    def sideways(self) -> Float:
        """(n, 2) unit vector perpendicular to each move."""
        way = (self.end - self.start)[:, :2] / np.maximum(self.flat, NOTHING)[:, None]
        return np.stack([-way[:, 1], way[:, 0]], axis=1)

    def width(self, room: Float) -> Float:
        """Return the spacing (n,) of extrusions side by side of this width, mm.

        Args:
            room: mm, how far down plastic or bed are under some places of them.
        """
        free = room[room > _LEVEL]
        height = median(free) if len(free) else 0.0
        thread = np.maximum(self.thread, NOTHING)
        return np.asarray(thread**2 * (pi / 4) / np.clip(height, thread / _FLATTEST, thread))

    def between(self, first: int, last: int) -> LevelMoves:
        """Return the moves from `first` up to `last`, exclusive."""
        return LevelMoves(*(getattr(self, name)[first:last] for name in _COLUMNS))

    @classmethod
    def joined(cls, parts: Sequence[LevelMoves]) -> LevelMoves:
        """Concatenate consecutive moves."""
        return LevelMoves(*(np.concatenate([getattr(part, name) for part in parts]) for name in _COLUMNS))


@dataclass(frozen=True, slots=True, eq=False)
class MoveBatch(LevelMoves):
    """Moves of one height as a printer executed them.

    Attributes:
        fed: (n,) mm of filament fed.
        seconds: (n,) that each takes.
        flow: (n,) mm³/s.
    """

    fed: Float
    seconds: Float
    flow: Float

    @classmethod
    def of(cls, rows: Float, seconds: Float, fresh: Float, marks: Marks) -> MoveBatch:
        """Make a batch from rows of executed moves."""
        command = rows[:, COMMAND].astype(np.int64)
        start, end = rows[:, START], rows[:, END]
        flat = np.hypot(*(end - start)[:, :2].T)
        extrudes = (fresh > NOTHING) & (flat > NOTHING)
        flow = np.zeros(len(rows))
        flow[extrudes] = volumetric_flow(fresh[extrudes], seconds[extrudes])
        return cls(
            command, start, end, fresh, flat, extrudes, marks.role(command), rows[:, FED], seconds, flow
        )

    @property
    def empty(self) -> Bool:
        """(n,) whether filament is fed but nothing is extruded."""
        return (self.fed > NOTHING) & ~self.extrudes

    def defect_at(self, kind: str, at: int, numbers: Int, amount: float) -> Defect:
        """Return the defect at the end of a move."""
        x, y, z = self.end[at].tolist()
        return Defect(kind, int(self.command[at]), int(numbers[at]), z, x, y, amount)


def runs_of(at: Int, z: Float, before: float) -> tuple[list[int], list[float]]:
    """Return where the extrusion height changes, and the new heights."""
    firsts, heights = [], []
    changes = np.flatnonzero(np.diff(z, prepend=np.nan) != 0)
    for place, height in zip(at[changes].tolist(), z[changes].tolist(), strict=True):
        if not abs(height - before) <= _LEVEL:
            firsts.append(place)
            heights.append(height)
            before = height
    return firsts, heights
