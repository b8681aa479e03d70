"""Find contacts of the print head with the print, where parts are printed one after the other.

As long as the nozzle is above everything printed, the head cannot touch it. The first time that the nozzle is lower,
the height map is dilated by the outline of each shape of the head: the result is the highest print within the outline,
for each position of the nozzle. It is valid until the nozzle gets below what was printed since then. Positions are
accurate to two cells; a contact must be deeper than this to be reported.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Final, NamedTuple

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, distinct
from printer_slicer.inspection.deposition.height_map import HeightMap, MovePieces, PlateHeights, split_moves
from printer_slicer.profile.print_head import HeadShape
from printer_slicer.values import Struct

__all__ = ["HeadContact", "HeadContactFinder"]

_CELL: Final = 0.5  # mm
_MAX_CELLS: Final = 600  # along each side of the bed; larger beds have wider cells
_TOLERANCE: Final = 1.0  # mm; the nozzle may be this far below the print without a contact of the head
_Box = tuple[tuple[float, float], tuple[float, float]]


class HeadContact(NamedTuple):
    """A contact of the head with the print.

    Attributes:
        moves: (n,) indices of the moves that touch.
        x, y, z: position of the nozzle at the first contact, mm.
        depth: mm, by which the print is higher than the lower side of the shape, at most.
        height: of the lowest shape that touches above the nozzle, mm.
    """

    moves: Int
    x: float
    y: float
    z: float
    depth: float
    height: float


class _DilatedMap(Struct, frozen=True, eq=False):
    """The highest print that a shape of the head meets, for each cell in which the nozzle can be, (rows, columns), mm.

    The lower side of the shape is `height` mm above the nozzle.
    """

    height: float
    top: Float


class HeadContactFinder:
    """Finds contacts of the print head with the print, from batches of moves in printing order.

    Args:
        shapes: of the head.
        box: corners of the bed, x and y, mm; positions of the nozzle outside are ignored.
    """

    def __init__(self, shapes: Sequence[HeadShape], box: _Box) -> None:
        (self._left, self._front), high = box
        size = high[0] - self._left, high[1] - self._front
        self._cell = max(_CELL, max(size) / _MAX_CELLS)
        self._columns, self._rows = (int(np.ceil(side / self._cell)) for side in size)
        self._shapes = shapes
        self._maps: list[_DilatedMap] = []
        self._printed = -np.inf
        """Highest print since the maps were made, mm."""

    def check(
        self,
        moves: tuple[Float, Float, Bool],
        add: Callable[[slice], None],
        read_height_map: Callable[[], HeightMap | None],
    ) -> Iterator[HeadContact]:
        """Yield at most one contact for each range of moves.

        Args:
            moves: start and end (n, 3), mm, and whether each move extrudes (n,).
            add: called with each range of moves after it was checked, so that its extrusions can be added to the map.
            read_height_map: returns the height map of all added moves.
        """
        start, end, extrudes = moves
        low = np.minimum(start[:, 2], end[:, 2])
        begin, n = 0, len(low)
        while begin < n:
            printed = np.where(extrudes[begin:], end[begin:, 2], -np.inf)
            before = np.maximum.accumulate(np.append(self._printed, printed[:-1]))
            stale = low[begin:] < before - _TOLERANCE
            stop = begin + int(stale.argmax()) if stale.any() else n
            some = slice(begin, stop)
            contact = self._find(start[some], end[some], low[some])
            if contact is not None:
                yield contact._replace(moves=contact.moves + begin)
            add(some)
            self._printed = max(self._printed, float(printed[: stop - begin].max(initial=-np.inf)))
            if stop < n:
                self._make_maps(read_height_map())
            begin = stop

    def _make_maps(self, height_map: HeightMap | None) -> None:
        """Make the maps of all shapes from everything that is printed so far."""
        self._printed, self._maps = -np.inf, []
        if height_map is None or not height_map.highest:
            return
        heights = self._read_heights(height_map.plate_heights(_MAX_CELLS * 2))
        tables = _make_range_maxima(heights)
        self._maps = [
            _DilatedMap(shape.height, self._dilate(heights, tables, shape))
            for shape in self._shapes
            if shape.height < height_map.highest
        ]

    def _read_heights(self, plate: PlateHeights) -> Float:
        """Return the height of the print in each cell (rows, columns), mm."""
        heights = np.zeros((self._rows, self._columns))
        row, column = np.nonzero(plate.top)
        y = ((plate.front + (row + 0.5) * plate.cell - self._front) / self._cell).astype(np.int64)
        x = ((plate.left + (column + 0.5) * plate.cell - self._left) / self._cell).astype(np.int64)
        inside = (x >= 0) & (x < self._columns) & (y >= 0) & (y < self._rows)
        np.maximum.at(heights, (y[inside], x[inside]), plate.top[row[inside], column[inside]])
        return heights

    def _dilate(self, heights: Float, tables: Sequence[Float], shape: HeadShape) -> Float:
        """Return the highest print within a shape, for each cell in which the nozzle can be (rows, columns), mm."""
        rows, columns = heights.shape
        steps = np.arange(1 - rows, rows)
        first, last = _find_row_spans(shape, steps * self._cell, 2 * self._cell)
        begin = np.clip(np.ceil(first / self._cell), -columns, columns + 1).astype(np.int64)
        end = np.clip(np.floor(last / self._cell), -columns - 1, columns).astype(np.int64)
        result = np.zeros_like(heights)
        if (begin == -columns).all() and (end == columns).all():
            result[:] = heights.max()
            return result
        for step, a, b in zip(steps.tolist(), begin.tolist(), end.tolist(), strict=True):
            if b < a:
                continue
            target = result[max(-step, 0) : rows - max(step, 0)]
            level = (b - a + 1).bit_length() - 1
            table = tables[level][max(step, 0) : rows - max(-step, 0)]
            for at in (a, b + 1 - (1 << level)):
                np.maximum(target, table[:, at + columns : at + 2 * columns], out=target)
        return result

    def _find(self, start: Float, end: Float, low: Float) -> HeadContact | None:
        """Return the contact of some moves with what the maps hold; None if there is none."""
        deepest = max((float(one.top.max()) - one.height for one in self._maps), default=-np.inf)
        moves = np.flatnonzero(low < deepest - _TOLERANCE)
        if not len(moves):
            return None
        pieces = split_moves(start[moves], end[moves])
        row, column, inside = self._find_cells(pieces)
        depth = np.full(len(pieces.move), -np.inf)
        height = np.full(len(pieces.move), np.inf)
        for one in self._maps:
            own = np.where(inside, one.top[row, column] - pieces.z - one.height, -np.inf)
            touches = own > _TOLERANCE
            depth[touches] = np.maximum(depth, own)[touches]
            height[touches] = np.minimum(height, one.height)[touches]
        hits = np.flatnonzero(depth > 0)
        if not len(hits):
            return None
        first, touching = int(hits[0]), moves[distinct(pieces.move[hits])]
        x, y, z = (float(column[first]) for column in (pieces.x, pieces.y, pieces.z))
        return HeadContact(touching, x, y, z, float(depth[hits].max()), float(height[first]))

    def _find_cells(self, pieces: MovePieces) -> tuple[Int, Int, Bool]:
        """Return the row and the column (P,) of each piece, and whether (P,) it is on the bed."""
        row = np.floor((pieces.y - self._front) / self._cell).astype(np.int64)
        column = np.floor((pieces.x - self._left) / self._cell).astype(np.int64)
        inside = (row >= 0) & (row < self._rows) & (column >= 0) & (column < self._columns)
        return np.where(inside, row, 0), np.where(inside, column, 0), inside


def _make_range_maxima(heights: Float) -> list[Float]:
    """Return the maxima of ranges of 1, 2, 4, ... cells, which begin in each cell of a row.

    Rows are extended on both sides by as many empty cells as they have.
    """
    columns = heights.shape[1]
    tables = [np.pad(heights, ((0, 0), (columns, columns + 1)))]
    while 1 << len(tables) <= 2 * columns + 1:
        table, width = tables[-1].copy(), 1 << (len(tables) - 1)
        np.maximum(table[:, :-width], tables[-1][:, width:], out=table[:, :-width])
        tables.append(table)
    return tables


def _find_row_spans(shape: HeadShape, y: Float, inset: float) -> tuple[Float, Float]:
    """Return the first and the last x (n,) of a shape at each y (n,), mm, if all its sides are moved inward."""
    corners = np.array(shape.corners)
    along = np.roll(corners, -1, axis=0) - corners
    length = np.hypot(*along.T)
    (ax, ay), (ex, ey) = corners.T, along.T
    # Inside is on the left of each side: ex (y - ay) - ey (x - ax) >= inset * length.
    room = ex * (y[:, None] - ay) - inset * length
    with np.errstate(divide="ignore", invalid="ignore"):
        x = ax + room / ey
    first = np.where(ey < 0, x, -np.inf).max(axis=1)
    last = np.where(ey > 0, x, np.inf).min(axis=1)
    is_outside = ((ey == 0) & (room < 0)).any(axis=1)
    return np.where(is_outside, np.inf, first), np.where(is_outside, -np.inf, last)
