"""Height map of the plate: the top of the print in each cell, to find collisions and missing support.

Cells are 0.25 mm wide. An extrusion marks the cells whose middle it covers. The marked width is the spacing
of extrusions, so neighbours leave no gap, and a nozzle that only brushes the side of an extrusion does not
collide. An extrusion is supported if the print in its cell or in a neighbouring cell is lower by at most the
diameter of the extruded strand.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import pi
from typing import Final

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, consecutive, median
from printer_slicer.inspection.deposition.marks import Defect, Marks
from printer_slicer.kernel import Buffer, Kernel, load_kernel
from printer_slicer.motion.vectorized import compute_volumetric_flow
from printer_slicer.values import Struct

__all__ = [
    "CELL",
    "COMMAND",
    "END",
    "FED",
    "NEGLIGIBLE",
    "START",
    "HeightMap",
    "KernelLevel",
    "LevelMoves",
    "MoveBatch",
    "MovePieces",
    "PlateHeights",
    "find_height_changes",
    "kernel_level",
    "split_moves",
]

CELL: Final = 0.25
"""Width of a cell, mm."""

_SUPPORT_REACH: Final = 1  # cells; an extrusion may be supported by the print this far to each side
_MAX_WIDTH: Final = 2.0  # mm; maximum marked width of an extrusion, however much filament is fed
_PIECES_AT_ONCE: Final = 1 << 16  # bounds the memory for intermediate values
_MAP_MARGIN: Final = 2.0  # mm around the area that the nozzle can reach


class MovePieces(Struct, frozen=True, eq=False):
    """Moves that were split into pieces no longer than a cell.

    Attributes:
        move: (P,) index of the move of each piece.
        x, y, z: (P,) mm, middle of each piece; a move straight up or down is one piece at its lower end.
        length: (P,) mm, length of each piece in x and y.
    """

    move: Int
    x: Float
    y: Float
    z: Float
    length: Float

    def take(self, indices: Int) -> MovePieces:
        """Return the pieces with these indices."""
        columns = (column.take(indices) for column in (self.x, self.y, self.z, self.length))
        return MovePieces(self.move.take(indices), *columns)

    def select_range(self, first: int, last: int, move: int) -> MovePieces:
        """Return the pieces from index `first` up to `last`, exclusive, with moves counted from `move`."""
        x, y, z, length = (column[first:last] for column in (self.x, self.y, self.z, self.length))
        return MovePieces(self.move[first:last] - move, x, y, z, length)

    def shift(self, offsets: Float) -> MovePieces:
        """Return the pieces, shifted in x and y by the offsets (n, 2), mm, of their moves."""
        x, y = (offsets[:, axis].take(self.move) for axis in (0, 1))
        x += self.x
        y += self.y
        return MovePieces(self.move, x, y, self.z, self.length)


def split_moves(start: Float, end: Float) -> MovePieces:
    """Split moves from `start` to `end`, (n, 3) mm, into pieces no longer than a cell, in order."""
    kernel = load_kernel()
    if kernel:
        owner, *columns = kernel.split_moves(np.ascontiguousarray(start), np.ascontiguousarray(end))
        return MovePieces(np.frombuffer(owner, np.int64), *(np.frombuffer(column) for column in columns))
    way = end - start
    length = np.hypot(way[:, 0], way[:, 1])
    count = np.maximum(np.ceil(length / CELL), 1).astype(np.int64)
    move = np.repeat(np.arange(len(start)), count)
    share = (consecutive(np.zeros(len(start), np.int64), count) + 0.5) / count.take(move)
    x, y, z = (start[:, axis].take(move) + share * way[:, axis].take(move) for axis in range(3))
    upright = length == 0
    if upright.any():
        pieces = upright.take(move)
        z[pieces] = np.minimum(start[move, 2], end[move, 2])[pieces]
    return MovePieces(move, x, y, z, (length / count).take(move))


KernelLevel = tuple[tuple[Float, Float, Float, Float, Bool], tuple[Int, Float, Float, Float, Float, Int]]
"""Moves of one height and their pieces as arguments of the kernel, see `kernel_level`."""


class PlateHeights(Struct, frozen=True, eq=False):
    """Height of the print in each cell of the plate.

    Attributes:
        top: (rows, columns) mm; the first row is the front one; 0 where the plate is empty.
        left, front: mm, the corner of the first cell.
        cell: mm, width of a cell.
    """

    top: Float
    left: float
    front: float
    cell: float


class HeightMap:
    """The height of the print so far in each cell of the plate.

    Args:
        low, high: corners of the area that the nozzle can reach, x and y, mm; everything outside is ignored.

    Attributes:
        highest: mm, top of the highest extrusion so far.
    """

    def __init__(self, low: tuple[float, float], high: tuple[float, float]) -> None:
        self._left, self._front = low[0] - _MAP_MARGIN, low[1] - _MAP_MARGIN
        self._wide = int(np.ceil((high[0] + _MAP_MARGIN - self._left) / CELL)) + 1
        self._deep = int(np.ceil((high[1] + _MAP_MARGIN - self._front) / CELL)) + 1
        # The last cell represents everything outside; it always stays empty.
        self._outside = self._wide * self._deep
        self._top = np.zeros(self._outside + 1, np.float32)
        self._removable: Bool | None = None  # no extrusion is removable
        self.highest = 0.0

    def cells(self, pieces: MovePieces) -> Int:
        """Return the index (P,) of the cell that contains each piece."""
        result = np.zeros(len(pieces.x), np.int64)
        for first in range(0, len(result), _PIECES_AT_ONCE):
            some = slice(first, first + _PIECES_AT_ONCE)
            # Rounding towards 0 is cheap: pieces less than a cell outside fall into edge cells, which are empty.
            column = ((pieces.x[some] - self._left) * (1 / CELL)).astype(np.int64)
            row = ((pieces.y[some] - self._front) * (1 / CELL)).astype(np.int64)
            inside = (column >= 0) & (column < self._wide) & (row >= 0) & (row < self._deep)
            result[some] = np.where(inside, row * self._wide + column, self._outside)
        return result

    def depth_below_print(self, cell: Int, z: Float) -> Float:
        """Return how far (P,), mm, heights z are below the top of the print in cells; negative above."""
        return np.asarray(self._top.take(cell) - z)

    def max_depth_below_print_around(self, cell: Int, z: Float) -> Float:
        """Return how far (P,), mm, heights z are below the highest top of the print in 3 by 3 cells."""
        around = [row * self._wide + column for row in (-1, 0, 1) for column in (-1, 0, 1)]
        beside = np.clip(cell[:, None] + np.array(around), 0, self._outside)
        return np.asarray(self._top[beside].max(axis=1, initial=0.0) - z)

    def max_depth_below_print_within(self, cell: Int, z: Float, radius: float) -> Float:
        """Return how far (P,), mm, heights z are below the highest top of the print in cells within a radius, mm."""
        reach = int(radius / CELL)
        steps = np.arange(-reach, reach + 1)
        row, column = (axis.ravel() for axis in np.meshgrid(steps, steps))
        near = np.hypot(row, column) * CELL <= radius
        beside = np.clip(cell[:, None] + (row * self._wide + column)[near], 0, self._outside)
        return np.asarray(self._top[beside].max(axis=1, initial=0.0) - z)

    def is_supported(self, cell: Int, lowest: Float, support_gap: float) -> Bool:
        """Return a mask (P,) of pieces that have print up to height `lowest` in their or a neighbouring cell.

        Args:
            cell: (P,) cell of each piece.
            lowest: (P,) mm, lowest top of the print that supports the piece.
            support_gap: mm that support material may be lower.
        """
        result = self._reaches_up_to(cell, lowest, support_gap)
        missing = np.flatnonzero(~result)
        for row in range(-_SUPPORT_REACH, _SUPPORT_REACH + 1):
            for column in range(-_SUPPORT_REACH, _SUPPORT_REACH + 1):
                if not len(missing):
                    return result
                beside = np.clip(cell[missing] + row * self._wide + column, 0, self._outside)
                found = self._reaches_up_to(beside, lowest[missing], support_gap)
                result[missing[found]] = True
                missing = missing[~found]
        return result

    def tops_around(self, cell: Int) -> tuple[Float, Bool]:
        """Return the highest top of the print (P,) in 3 by 3 cells, mm, and whether it is removed after the print."""
        around = np.array([row * self._wide + column for row in (-1, 0, 1) for column in (-1, 0, 1)])
        beside = np.clip(cell[:, None] + around, 0, self._outside)
        tops = self._top[beside]
        highest = np.argmax(tops, axis=1)
        rows = np.arange(len(cell))
        top = tops[rows, highest].astype(np.float64)
        if self._removable is None:
            return top, np.zeros(len(cell), np.bool_)
        return top, self._removable[beside[rows, highest]]

    def add_extrusions(
        self, pieces: MovePieces, perpendicular: Float, width: Float, *, removable: bool
    ) -> None:
        """Raise the height map to these pieces of extrusions.

        Args:
            pieces: the pieces.
            perpendicular: (n, 2) unit vector at right angles to each move.
            width: (n,) mm, width of each move.
            removable: whether the extrusions are removed after the print, such as supports.
        """
        spread = np.clip(width - CELL, 0.0, _MAX_WIDTH)  # distance between the outermost cells
        rows = np.ceil(spread / CELL)
        least, most = (int(count) for count in (rows[pieces.move].min(), rows[pieces.move].max()))
        for k in range(most + 1):
            layer_pieces = pieces if k <= least else pieces.take(np.flatnonzero((rows >= k)[pieces.move]))
            step = np.where(rows > 0, k / np.maximum(rows, 1) - 0.5, 0.0) * spread
            cell = self.cells(layer_pieces.shift(perpendicular * step[:, None]))
            np.maximum.at(self._top, cell, layer_pieces.z.astype(np.float32))
            self._mark_removable(cell, removable=removable)
        self._top[self._outside] = 0.0
        self.highest = max(self.highest, float(pieces.z.max()))

    def _mark_removable(self, cell: Int, *, removable: bool) -> None:
        """Remember whether the top of the print in cells is removed after the print."""
        if self._removable is None:
            if not removable:
                return
            self._removable = np.zeros(self._outside + 1, np.bool_)
        self._removable[cell] = removable
        self._removable[self._outside] = False

    def find_unsupported_with(
        self, kernel: Kernel, level: KernelLevel, *, support_gap: float, drop: float
    ) -> Int:
        """Find unsupported pieces as `unsupported.find_unsupported_pieces` does.

        Args:
            kernel: computes them.
            level: moves of one height and their pieces, all extruding.
            support_gap: mm that support material may be lower.
            drop: mm that everything may be lower.
        """
        return np.frombuffer(
            kernel.find_unsupported_pieces(self._kernel_map(), *level, support_gap, drop), np.int64
        )

    def add_with(self, kernel: Kernel, level: KernelLevel) -> None:
        """Raise the height map with the kernel as `unsupported.add_to_height_map` does; arguments as above."""
        (*_, is_removable), (_, _, _, z, *_) = level
        if self._removable is None and is_removable.any():
            self._removable = np.zeros(self._outside + 1, np.bool_)
        kernel.raise_height_map(self._kernel_map(), *level, self._left, self._front)
        self.highest = max(self.highest, float(z.max()))

    def _kernel_map(self) -> tuple[Buffer, Buffer, int]:
        """Return this height map as an argument for the kernel."""
        return self._top, np.zeros(0, np.bool_) if self._removable is None else self._removable, self._wide

    def plate_heights(self, max_cells: int = 1600) -> PlateHeights:
        """Return the heights of the printed area, with cells merged to at most `max_cells` per side."""
        top = self._top[: self._outside].reshape(self._deep, self._wide)
        rows, columns = (np.flatnonzero((top > 0).any(axis=axis)) for axis in (1, 0))
        if not len(rows):
            return PlateHeights(np.zeros((0, 0)), self._left, self._front, CELL)
        first, last, left, right = rows[0], rows[-1] + 1, columns[0], columns[-1] + 1
        factor = int(max(np.ceil(max(last - first, right - left) / max_cells), 1))
        used = top[first:last, left:right]
        used = np.pad(used, ((0, -used.shape[0] % factor), (0, -used.shape[1] % factor)))
        coarse = used.reshape(used.shape[0] // factor, factor, used.shape[1] // factor, factor).max(
            axis=(1, 3)
        )
        return PlateHeights(
            coarse.astype(np.float64), self._left + left * CELL, self._front + first * CELL, factor * CELL
        )

    def find_pieces_near_seeds(self, cell: Int, seeds: Bool, reach: float) -> Bool:
        """Return a mask (P,) of pieces up to `reach` mm from a seed piece, along cells with pieces."""
        rows, columns = np.divmod(cell, self._wide)
        top, left = rows.min() - 3, columns.min() - 3
        shape = (int(rows.max() - top) + 4, int(columns.max() - left) + 4)
        place = (rows - top) * shape[1] + columns - left
        filled = np.zeros(shape[0] * shape[1], np.bool_)
        filled[place] = True
        # Neighbouring extrusions are a few cells apart; the cells between them count as filled.
        filled = _grow_mask(filled.reshape(shape), 1)
        reached = np.zeros(shape, np.bool_)
        reached.reshape(-1)[place[seeds]] = True
        for _ in range(round(reach / CELL)):
            grown = _grow_mask(reached, 1) & filled
            if (grown == reached).all():
                break
            reached = grown
        return np.asarray(reached.reshape(-1)[place])

    def _reaches_up_to(self, cell: Int, lowest: Float, support_gap: float) -> Bool:
        """Return a mask (P,) of cells in which the top of the print is at least at `lowest`, mm."""
        top = self._top.take(cell)
        if self._removable is not None:
            top = top + support_gap * self._removable.take(cell)
        return np.asarray(top >= lowest - 1e-4)


def _grow_mask(mask: Bool, cells: int) -> Bool:
    """Return a mask of cells, grown by a number of cells to all sides."""
    for _ in range(cells):
        mask = mask.copy()
        mask[1:] |= mask[:-1]
        mask[:-1] |= mask[1:]
        mask[:, 1:] |= mask[:, :-1]
        mask[:, :-1] |= mask[:, 1:]
    return mask


COMMAND, START, END, FED = 0, slice(1, 4), slice(4, 7), 7
"""Columns of the rows of moves that a simulated printer records, see `sim.move_log`."""

NEGLIGIBLE: Final = 1e-9
"""mm³ or mm; smaller values are rounding errors."""

_COLUMNS: Final = ("command", "start", "end", "volume", "xy_length", "extrudes", "role")
_MAX_FLATTENING: Final = 3.0  # diameter of the strand divided by the height of the flattest extrusion
_SAME_HEIGHT: Final = 0.02  # mm; moves at heights that differ by less are checked together


class LevelMoves(Struct, frozen=True, eq=False):
    """Moves at one height, and which of them extrude.

    Attributes:
        command: (n,) command of each move, counted from 1.
        start, end: (n, 3) mm.
        volume: (n,) mm³ extruded.
        flat: (n,) mm, length in x and y.
        extrudes: (n,) whether the move extrudes.
        role: (n,) role, see `Marks.role_at`.
    """

    command: Int
    start: Float
    end: Float
    volume: Float
    xy_length: Float
    extrudes: Bool
    role: Int

    @property
    def strand_diameter(self) -> Float:
        """Diameter (n,) of the extruded strand before it is pressed flat, mm."""
        return np.asarray(2.0 * np.sqrt(self.volume / np.maximum(self.xy_length, NEGLIGIBLE) / pi))

    @property
    def perpendicular(self) -> Float:
        """Unit vector (n, 2) at right angles to each move."""
        way = (self.end - self.start)[:, :2] / np.maximum(self.xy_length, NEGLIGIBLE)[:, None]
        return np.stack([-way[:, 1], way[:, 0]], axis=1)

    def width(self, clearance: Float) -> Float:
        """Return the width (n,) of each extrusion, mm, as the spacing at which neighbours fill a layer.

        Args:
            clearance: (m,) mm, distance down to the print or the bed at some points of the extrusions.
        """
        open_clearance = clearance[clearance > _SAME_HEIGHT]
        height = median(open_clearance) if len(open_clearance) else 0.0
        strand_diameter = np.maximum(self.strand_diameter, NEGLIGIBLE)
        return np.asarray(
            strand_diameter**2
            * (pi / 4)
            / np.clip(height, strand_diameter / _MAX_FLATTENING, strand_diameter)
        )

    def select_range(self, first: int, last: int) -> LevelMoves:
        """Return the moves from index `first` up to `last`, exclusive."""
        some = slice(first, last)
        return LevelMoves(
            self.command[some],
            self.start[some],
            self.end[some],
            self.volume[some],
            self.xy_length[some],
            self.extrudes[some],
            self.role[some],
        )

    @classmethod
    def concatenate(cls, parts: Sequence[LevelMoves]) -> LevelMoves:
        """Concatenate consecutive moves."""
        if len(parts) == 1:
            return parts[0]
        return LevelMoves(*(np.concatenate([getattr(part, name) for part in parts]) for name in _COLUMNS))


def kernel_level(moves: LevelMoves, is_removable: Bool, pieces: MovePieces, cell: Int) -> KernelLevel:
    """Return the moves of one height and their pieces, with their cells, as arguments for the kernel."""
    start, end = np.ascontiguousarray(moves.start), np.ascontiguousarray(moves.end)
    return (
        (start, end, moves.volume, moves.xy_length, is_removable),
        (pieces.move, pieces.x, pieces.y, pieces.z, pieces.length, cell),
    )


class MoveBatch(LevelMoves, Struct, frozen=True, eq=False):
    """Executed moves at one height, with filament, duration and flow.

    Attributes:
        fed: (n,) mm of filament fed.
        seconds: (n,) s, duration of each move.
        flow: (n,) mm³/s.
    """

    fed: Float
    seconds: Float
    flow: Float

    @classmethod
    def from_rows(cls, rows: Float, seconds: Float, new_volume: Float, marks: Marks) -> MoveBatch:
        """Make a batch of moves at one height from rows of executed moves, see `sim.move_log`."""
        command = rows[:, COMMAND].astype(np.int64)
        start, end = rows[:, START], rows[:, END]
        xy_length = np.hypot(*(end - start)[:, :2].T)
        extrudes = (new_volume > NEGLIGIBLE) & (xy_length > NEGLIGIBLE)
        flow = np.zeros(len(rows))
        flow[extrudes] = compute_volumetric_flow(new_volume[extrudes], seconds[extrudes])
        return cls(
            command,
            start,
            end,
            new_volume,
            xy_length,
            extrudes,
            marks.role_at(command),
            rows[:, FED],
            seconds,
            flow,
        )

    @property
    def feeds_without_extruding(self) -> Bool:
        """Mask (n,) of moves that feed filament but extrude nothing."""
        return (self.fed > NEGLIGIBLE) & ~self.extrudes

    def make_defect(self, kind: str, index: int, layers: Int, amount: float) -> Defect:
        """Return a defect of this kind, located at the end of the move with this index."""
        x, y, z = self.end[index].tolist()
        return Defect(kind, int(self.command[index]), int(layers[index]), z, x, y, amount)


def find_height_changes(indices: Int, z: Float, previous: float) -> tuple[list[int], list[float]]:
    """Return the indices at which the height of extrusion changes, and the new heights."""
    firsts, heights = [], []
    changes = np.flatnonzero(np.diff(z, prepend=np.nan) != 0)
    for index, height in zip(indices[changes].tolist(), z[changes].tolist(), strict=True):
        if not abs(height - previous) <= _SAME_HEIGHT:
            firsts.append(index)
            heights.append(height)
            previous = height
    return firsts, heights
