"""Areas on a raster of square cells, and the distance of each cell from the nearest solid one.

A cell belongs to an area if its middle does.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import ceil, floor

import numpy as np
from numpy.typing import NDArray

from printer_slicer.arrays import Bool, Float, Int
from printer_slicer.geometry.areas import Areas
from printer_slicer.geometry.hatching import find_row_crossings
from printer_slicer.values import Struct

__all__ = [
    "NEIGHBOUR_CELLS",
    "CellGrid",
    "Float32",
    "cheapest_within",
    "clearance",
    "highest_within",
    "rasterize_areas",
]

Float32 = NDArray[np.float32]
NEIGHBOUR_CELLS = np.stack(np.meshgrid([0, -1, 1], [0, -1, 1], indexing="ij"), axis=-1).reshape(-1, 2)
"""Steps (9, 2), rows and columns, from a cell to itself and to the cells around it."""

_CELLS_AT_ONCE = 1 << 22  # bounds the memory for counting crossings


class CellGrid(Struct, frozen=True):
    """A raster of square cells.

    Attributes:
        x, y: lowest corner, mm.
        cell: side of a cell, mm.
        n_rows, n_columns: number of cells along y and along x.
    """

    x: float
    y: float
    cell: float
    n_rows: int
    n_columns: int

    @classmethod
    def around(cls, low: Float, high: Float, cell: float) -> CellGrid:
        """Return the grid that covers a box given by its corners (2,), mm; lines of the grid pass through 0."""
        first = [floor(float(value) / cell) for value in low]
        last = [max(ceil(float(value) / cell), at + 1) for value, at in zip(high, first, strict=True)]
        return cls(first[0] * cell, first[1] * cell, cell, last[1] - first[1], last[0] - first[0])

    @property
    def n_cells(self) -> int:
        """Number of cells."""
        return self.n_rows * self.n_columns

    def find_cells(self, points: Float) -> Int:
        """Return the index (P,) of the cell in which each point (P, 2) lies; outside, of the nearest cell."""
        column, row = np.floor((points - (self.x, self.y)) / self.cell).astype(np.int64).T
        row, column = np.clip(row, 0, self.n_rows - 1), np.clip(column, 0, self.n_columns - 1)
        return np.asarray(row * self.n_columns + column)

    def find_middles(self, cells: Int) -> Float:
        """Return the middles (..., 2) of cells (...,), mm."""
        row, column = np.divmod(cells, self.n_columns)
        return np.stack([self.x + (column + 0.5) * self.cell, self.y + (row + 0.5) * self.cell], axis=-1)

    def find_moved_cells(self, cells: Int, moves: Int) -> tuple[Int, Bool]:
        """Return the cells (n, M) to which `moves` (M, 2) lead from cells (n,), and whether they lie on the grid.

        Moves are rows and columns. A move that leaves the grid leads to cell 0.
        """
        row, column = np.divmod(cells, self.n_columns)
        rows, columns = row[:, None] + moves[:, 0], column[:, None] + moves[:, 1]
        inside = (rows >= 0) & (rows < self.n_rows) & (columns >= 0) & (columns < self.n_columns)
        return np.where(inside, rows * self.n_columns + columns, 0), inside


def rasterize_areas(areas: Areas, grid: CellGrid) -> Bool:
    """Return the mask (n_layers, n_rows, n_columns) of cells whose middles lie in the areas.

    Each outline changes by one the number of areas to its right. Summed along the rows this gives the number of areas
    that contain each cell.
    """
    result = np.zeros((areas.n_layers, grid.n_rows, grid.n_columns), np.bool_)
    at_once = max(_CELLS_AT_ONCE // grid.n_cells, 1)
    for first in range(0, areas.n_layers, at_once):
        some = np.arange(first, min(first + at_once, areas.n_layers))
        part = areas if len(some) == areas.n_layers else areas.copy_layers(some)
        if part.n_rings:
            result[some] = _rasterize_batch(part, grid)
    return result


def _rasterize_batch(areas: Areas, grid: CellGrid) -> Bool:
    """Return the mask of `rasterize_areas` for a few layers."""
    n, axis = areas.n_layers, np.tile([1.0, 0.0], (areas.n_layers, 1))
    phase = grid.y / grid.cell + 0.5
    layer, row, x, edge = find_row_crossings(areas, axis, np.full(n, grid.cell), np.full(n, phase))
    column = np.clip(np.ceil((x - grid.x) / grid.cell - 0.5).astype(np.int64), 0, grid.n_columns)
    down = (
        areas.xy[areas.following[edge], 1] < areas.xy[edge, 1]
    )  # solid lies to the right of a downward edge
    within = (row >= 0) & (row < grid.n_rows)
    key = (layer * grid.n_rows + row) * (grid.n_columns + 1) + column
    size = n * grid.n_rows * (grid.n_columns + 1)
    change = np.bincount(key[within & down], minlength=size) - np.bincount(
        key[within & ~down], minlength=size
    )
    count = np.cumsum(change.reshape(n, grid.n_rows, -1).astype(np.int32), axis=2)
    return np.asarray(count[..., :-1] > 0)


def clearance(solid: Bool, cell: float, reach: float) -> Float32:
    """Return the distance (..., n_rows, n_columns) from each cell to the nearest solid cell of its layer, mm.

    Distances are between the middles of cells and exact up to `reach`; what is farther away gets `reach`. First the
    distance along each row is found, then the lowest sum of squares over the neighbouring rows.
    Source: Felzenszwalb & Huttenlocher, Distance Transforms of Sampled Functions, 2012; here with a limited reach.

    Args:
        solid: (..., n_rows, n_columns) mask of solid cells.
        cell: side of a cell, mm.
        reach: mm, greater than 0.
    """
    n_steps = ceil(reach / cell)
    most = np.float32(n_steps + 1)
    along = _row_distances(solid, n_steps + 1)
    squares = along.astype(np.float32) ** 2
    result = squares.copy()
    n_rows = solid.shape[-2]
    for step in range(1, min(n_steps, n_rows - 1) + 1):
        for to, of in ((slice(step, None), slice(None, -step)), (slice(None, -step), slice(step, None))):
            np.minimum(
                result[..., to, :], squares[..., of, :] + np.float32(step * step), out=result[..., to, :]
            )
    np.sqrt(np.minimum(result, most * most, out=result), out=result)
    return np.asarray(np.minimum(result * np.float32(cell), np.float32(reach)))


def _row_distances(solid: Bool, most: int) -> NDArray[np.int32]:
    """Return the distance of each cell to the nearest solid one in its row, in cells, at most `most`."""
    n = solid.shape[-1]
    place = np.arange(n, dtype=np.int32)
    before = np.maximum.accumulate(np.where(solid, place, np.int32(-most - n)), axis=-1)
    after = np.minimum.accumulate(np.where(solid, place, np.int32(most + 2 * n))[..., ::-1], axis=-1)[
        ..., ::-1
    ]
    return np.asarray(np.minimum(np.minimum(place - before, after - place), np.int32(most)))


def highest_within(field: Float32, moves: Int) -> Float32:
    """Return for each cell the highest value at the cells to which the `moves` (M, 2), rows and columns, lead."""
    result = np.full_like(field, -np.inf)
    for moved in _moved_fields(field, moves, -np.inf):
        np.maximum(result, moved, out=result)
    return result


def cheapest_within(price: Float32, moves: Int, cost: Float) -> Float32:
    """Return for each cell the lowest sum of the price after one of the `moves` (M, 2) and its `cost` (M,)."""
    result = np.full_like(price, np.inf)
    for moved, own in zip(_moved_fields(price, moves, np.inf), cost.tolist(), strict=True):
        np.minimum(result, moved + np.float32(own), out=result)
    return result


def _moved_fields(field: Float32, moves: Int, beyond: float) -> Iterator[Float32]:
    """Yield for each of the `moves` (M, 2) the values at the cells to which it leads; `beyond` outside the grid."""
    reach = int(np.abs(moves).max(initial=0))
    wide = np.pad(field, reach, constant_values=beyond)
    n_rows, n_columns = field.shape
    for rows, columns in (moves + reach).tolist():
        yield wide[rows : rows + n_rows, columns : columns + n_columns]
