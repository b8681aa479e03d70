"""Rasterize extrusions: measure how full of material each cell of a layer is.

Cells are 0.1 mm wide, or 0.2 mm on plates of more than two million cells. Extrusions are upright bodies of their own
height, as wide as their spacing, so that adjacent extrusions fill every cell once. Each body is split into pieces
smaller than a cell. Each piece is distributed to the four cells around it by bilinear weights, which keeps the sum
exact and moves no material by more than one cell. Limits apply to means over windows about as wide as an extrusion.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from printer_slicer.arrays import Float, Int, consecutive
from printer_slicer.geometry import Areas, Lines, hatch
from printer_slicer.inspection.coverage.extrusions import Extrusions
from printer_slicer.values import Struct

__all__ = [
    "CellWindow",
    "choose_cell_width",
    "covered_share",
    "make_scan_lines",
    "rasterize_fill",
    "window_mean",
]

_FINE_CELL, _COARSE_CELL = 0.1, 0.2  # mm
_MAX_FINE_CELLS: Final = 2_000_000  # fine cells
_MAX_THREAD_RATIO: Final = 1.15  # maximum ratio of width to height of a round thread
_LINES_PER_ROW: Final = 4
_HEIGHT_TOLERANCE: Final = 0.01  # mm
_BLOCK_SIZE: Final = 1 << 18  # pieces; limits the memory


class CellWindow(Struct, frozen=True):
    """A rectangle of cells; the lower corner of cell (i, j) is ((left + j) · cell, (front + i) · cell).

    Attributes:
        left, front: column and row of the first cell.
        wide, deep: number of cells along x and y.
        cell: mm, width of a cell.
    """

    left: int
    front: int
    wide: int
    deep: int
    cell: float

    @classmethod
    def around(cls, low: Float, high: Float, margin: float, cell: float) -> CellWindow:
        """Return the cells that the box from `low` to `high` (2,), mm, extended by a margin, touches."""
        left, front = np.floor((low - margin) / cell).astype(int).tolist()
        right, back = np.ceil((high + margin) / cell).astype(int).tolist()
        return cls(left, front, max(right - left, 1), max(back - front, 1), cell)

    def slices_in(self, other: CellWindow) -> tuple[slice, slice]:
        """Return the slices that select this window's cells in the array of an enclosing window."""
        i, j = self.front - other.front, self.left - other.left
        return slice(i, i + self.deep), slice(j, j + self.wide)

    def rows_and_columns(self, points: Float) -> tuple[Int, Int]:
        """Return rows and columns (P,) of the cells that contain points (P, 2), mm, clipped to the window."""
        j = np.clip(np.floor(points[:, 0] / self.cell).astype(np.int64) - self.left, 0, self.wide - 1)
        i = np.clip(np.floor(points[:, 1] / self.cell).astype(np.int64) - self.front, 0, self.deep - 1)
        return i, j

    def edge_distance(self, beads: Extrusions) -> float:
        """Return the smallest distance, mm, from a centre line of extrusions to the outermost cells."""
        ends = np.concatenate([beads.begin, beads.end]) / self.cell
        low = (ends - (self.left, self.front)).min(initial=np.inf)
        high = ((self.left + self.wide, self.front + self.deep) - ends).min(initial=np.inf)
        return max(float(min(low, high)) - 1.0, 1.0) * self.cell

    def cell_middle(self, i: int, j: int) -> tuple[float, float]:
        """Return x and y of the middle of a cell, mm."""
        return (self.left + j + 0.5) * self.cell, (self.front + i + 0.5) * self.cell


def choose_cell_width(low: Float, high: Float) -> float:
    """Return the cell width, mm, for a box from `low` to `high` (2,) mm."""
    return _FINE_CELL if float(np.prod((high - low) / _FINE_CELL)) <= _MAX_FINE_CELLS else _COARSE_CELL


def rasterize_fill(beads: Extrusions, window: CellWindow, layer_height: float = np.inf) -> Float:
    """Return how many times material fills each cell (deep, wide); 1 means exactly full.

    Sloped extrusions count by the share of the layer height that they fill. Contoured extrusions fill their cells up to
    the surface, which lies inside the layer.

    Args:
        beads: extrusions of one layer, all within the window.
        window: the cells; extrusions too wide for it are narrowed, without loss of material.
        layer_height: mm.
    """
    # At the width of its spacing an extrusion is a rectangle as high as the extrusion. Round threads that hang below
    # their layer, such as bridges, are not pressed against each other: they fill their visible width.
    width = beads.width
    threads = (beads.height > layer_height + _HEIGHT_TOLERANCE) & (width <= beads.height * _MAX_THREAD_RATIO)
    width_filled = np.where(threads, width, beads.area / beads.height)
    spread_width = np.minimum(width_filled, 2 * window.edge_distance(beads))
    # Sloped extrusions are lower than their layer; the extrusions above them fill the rest.
    share = np.minimum(beads.height / layer_height, 1) if np.isfinite(layer_height) else 1.0
    is_covered = (beads.rise != 0) & ~beads.is_contoured
    material_width = np.where(is_covered, width_filled * share, width_filled)
    along = np.maximum(np.ceil(beads.length / window.cell), 1).astype(np.int64)
    across = np.maximum(np.ceil(spread_width / window.cell), 1).astype(np.int64)
    block = np.cumsum(along * across) // _BLOCK_SIZE
    sums = np.zeros(window.deep * window.wide)
    for first, last in _split_runs(block):
        selected = slice(first, last)
        count = along[selected], across[selected]
        weight = (material_width * beads.length)[selected] / (count[0] * count[1])
        some = beads.take(np.arange(first, last))
        sums += _spread_material(some, spread_width[selected], weight, count, window)
    return (sums / window.cell**2).reshape(window.deep, window.wide)


def _split_runs(block: Int) -> list[tuple[int, int]]:
    """Return, for each run of equal values, its first index and the index after its end."""
    if not len(block):
        return []
    cuts = np.flatnonzero(np.diff(block)) + 1
    return list(zip([0, *cuts.tolist()], [*cuts.tolist(), len(block)], strict=True))


def _spread_material(
    beads: Extrusions, spread_width: Float, weight: Float, counts: tuple[Int, Int], window: CellWindow
) -> Float:
    """Return the material of extrusions in each cell (deep · wide,).

    Args:
        beads: the extrusions.
        spread_width: (B,) mm, width over which each is spread.
        weight: (B,) material of each of its pieces.
        counts: (B,) number of pieces along and across.
        window: the cells.
    """
    along, across = counts
    count = along * across
    bead = np.repeat(np.arange(beads.n_beads), count)
    piece = consecutive(np.zeros(beads.n_beads, np.int64), count)
    u = (piece // across[bead] + 0.5) / along[bead]
    v = ((piece % across[bead] + 0.5) / across[bead] - 0.5) * spread_width[bead]
    way = beads.end - beads.begin
    side = np.stack([-way[:, 1], way[:, 0]], axis=1) / np.maximum(beads.length, 1e-12)[:, None]
    share = weight[bead]
    # Cell (i, j) has its middle at (i + 0.5, j + 0.5).
    x = (beads.begin[bead, 0] + u * way[bead, 0] + v * side[bead, 0]) / window.cell - window.left - 0.5
    y = (beads.begin[bead, 1] + u * way[bead, 1] + v * side[bead, 1]) / window.cell - window.front - 0.5
    j, i = np.floor(x).astype(np.int64), np.floor(y).astype(np.int64)
    right, up = x - j, y - i
    cell, size = i * window.wide + j, window.deep * window.wide
    sums = np.zeros(size, np.float64)
    for step, part in (
        (0, (1 - right) * (1 - up)),
        (1, right * (1 - up)),
        (window.wide, (1 - right) * up),
        (window.wide + 1, right * up),
    ):
        sums += np.bincount(cell + step, weights=part * share, minlength=size)[:size]
    return sums


def make_scan_lines(areas: Areas, cell: float) -> Lines:
    """Return scan lines along x within areas, four lines per row of cells."""
    return hatch(areas, angle=0.0, spacing=cell / _LINES_PER_ROW, phase=0.5)


def covered_share(scan_lines: Lines, layer: int, window: CellWindow) -> Float:
    """Return which share of each cell (deep, wide) scan lines cover; exact along x, to 1/4 cell along y."""
    first, last = np.searchsorted(scan_lines.layer, [layer, layer + 1])
    row = scan_lines.row[first:last] // _LINES_PER_ROW - window.front
    inside = (row >= 0) & (row < window.deep)
    u = np.clip(scan_lines.u[first:last][inside] / window.cell - window.left, 0, window.wide)
    row = np.repeat(row[inside], 2)
    place, sign = u.ravel(), np.tile([1.0 / _LINES_PER_ROW, -1.0 / _LINES_PER_ROW], len(u))
    cell = np.floor(place).astype(np.int64)
    part = place - cell
    size = window.deep * (window.wide + 2)
    begin = row * (window.wide + 2) + cell
    steps = np.bincount(begin, weights=sign * (1 - part), minlength=size)
    steps += np.bincount(begin + 1, weights=sign * part, minlength=size)
    return np.asarray(np.cumsum(steps.reshape(window.deep, -1), axis=1)[:, : window.wide], np.float64)


def window_mean(values: Float, reach: int) -> Float:
    """Return the mean around each cell, over a square of 2 · reach + 1 cells; cells outside count as 0."""
    sums = np.pad(values, ((reach + 1, reach), (reach + 1, reach))).cumsum(axis=0).cumsum(axis=1)
    size = 2 * reach + 1
    total = sums[size:, size:] - sums[:-size, size:] - sums[size:, :-size] + sums[:-size, :-size]
    return np.asarray(total / size**2)
