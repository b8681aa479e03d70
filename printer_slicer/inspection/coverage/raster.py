"""Rasterize material: how full each cell of a layer is.

Cells are 0.1 mm wide, on plates of more than two million of them 0.2 mm. Beads are spread as upright bodies of their
own height: as wide as their spacing, so that neighbours laid as they should be fill every cell once. Each body is cut
into pieces smaller than a cell, and each piece is shared among the four cells around it in proportion to how near it
is, which keeps the sum exact and moves nothing by more than one cell. What is judged are means over windows about as
wide as a bead.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from printer_slicer.arrays import Float, Int, consecutive
from printer_slicer.geometry import Areas, Lines, hatch
from printer_slicer.inspection.coverage.extrusions import Extrusions

__all__ = ["CellWindow", "cell_for", "covered_share", "rasterize_fill", "rows_of", "window_mean"]

_FINE, _COARSE = 0.1, 0.2  # mm
_MANY: Final = 2_000_000  # fine cells
_ROUND: Final = 1.15  # width by height, up to which a bead is a thread
_ROWS: Final = 4
_DEEPER: Final = 0.01  # mm
_AT_ONCE: Final = 1 << 18  # pieces: what bounds the memory


@dataclass(frozen=True, slots=True)
class CellWindow:
    """A rectangle of cells; cell (i, j) reaches from ((left + j) · cell, (front + i) · cell) on.

    Attributes:
        left, front: of the first cell.
        wide, deep: how many cells along x and y.
        cell: mm, width of each.
    """

    left: int
    front: int
    wide: int
    deep: int
    cell: float

    @classmethod
    def around(cls, low: Float, high: Float, margin: float, cell: float) -> CellWindow:
        """Return the cells touched by the box from `low` to `high` (2,) mm, with a margin."""
        left, front = np.floor((low - margin) / cell).astype(int).tolist()
        right, back = np.ceil((high + margin) / cell).astype(int).tolist()
        return cls(left, front, max(right - left, 1), max(back - front, 1), cell)

    def within(self, other: CellWindow) -> tuple[slice, slice]:
        """Return the slices of these cells in the array of an enclosing window."""
        i, j = self.front - other.front, self.left - other.left
        return slice(i, i + self.deep), slice(j, j + self.wide)

    def cells(self, points: Float) -> tuple[Int, Int]:
        """Return row and column of points (P, 2) mm, clipped to the window."""
        j = np.clip(np.floor(points[:, 0] / self.cell).astype(np.int64) - self.left, 0, self.wide - 1)
        i = np.clip(np.floor(points[:, 1] / self.cell).astype(np.int64) - self.front, 0, self.deep - 1)
        return i, j

    def room(self, beads: Extrusions) -> float:
        """Mm around the centre lines of beads, of which none comes nearer than that to the outermost cells."""
        ends = np.concatenate([beads.begin, beads.end]) / self.cell
        low = (ends - (self.left, self.front)).min(initial=np.inf)
        high = ((self.left + self.wide, self.front + self.deep) - ends).min(initial=np.inf)
        return max(float(min(low, high)) - 1.0, 1.0) * self.cell

    def middle(self, i: int, j: int) -> tuple[float, float]:
        """x and y of the middle of a cell, mm."""
        return (self.left + j + 0.5) * self.cell, (self.front + i + 0.5) * self.cell


def cell_for(low: Float, high: Float) -> float:
    """Return the cell width, mm, for a box from `low` to `high` (2,) mm."""
    return _FINE if float(np.prod((high - low) / _FINE)) <= _MANY else _COARSE


def rasterize_fill(beads: Extrusions, window: CellWindow, layer_height: float = np.inf) -> Float:
    """Return how often each cell (deep, wide) is filled up to the height of its extrusions; 1 is full.

    Slopes count by how much of the layer's height they fill.

    Args:
        beads: of one layer, all within the window.
        window: the cells; beads too wide for it are laid narrower, with all that they hold.
        layer_height: mm.
    """
    # To the width of the spacing the cross-section is that of a rectangle as high as the bead. Round threads that hang
    # deeper than their layer, as bridges do, are not pressed against each other: they fill what they are seen to cover.
    width = beads.width
    threads = (beads.height > layer_height + _DEEPER) & (width <= beads.height * _ROUND)
    spread = np.where(threads, width, beads.area / beads.height)
    reach = np.minimum(spread, 2 * window.room(beads))
    # Slopes lie lower than their layer; what is laid over them fills the rest.
    share = np.minimum(beads.height / layer_height, 1) if np.isfinite(layer_height) else 1.0
    held = np.where(beads.rise != 0, spread * share, spread)
    along = np.maximum(np.ceil(beads.length / window.cell), 1).astype(np.int64)
    across = np.maximum(np.ceil(reach / window.cell), 1).astype(np.int64)
    block = np.cumsum(along * across) // _AT_ONCE
    sums = np.zeros(window.deep * window.wide)
    for first, last in _runs(block):
        some = slice(first, last)
        count = along[some], across[some]
        weight = (held * beads.length)[some] / (count[0] * count[1])
        sums += _spread(beads.take(np.arange(first, last)), reach[some], weight, count, window)
    return (sums / window.cell**2).reshape(window.deep, window.wide)


def _runs(block: Int) -> list[tuple[int, int]]:
    """First and one after the last of each run of equal values."""
    if not len(block):
        return []
    cuts = np.flatnonzero(np.diff(block)) + 1
    return list(zip([0, *cuts.tolist()], [*cuts.tolist(), len(block)], strict=True))


def _spread(
    beads: Extrusions, reach: Float, weight: Float, counts: tuple[Int, Int], window: CellWindow
) -> Float:
    """Return the material of extrusions in each cell (deep · wide,).

    Args:
        beads: some.
        reach: (B,) mm, their width.
        weight: (B,) what each piece holds.
        counts: (B,) pieces along and across.
        window: the cells.
    """
    along, across = counts
    count = along * across
    bead = np.repeat(np.arange(beads.n_beads), count)
    nth = consecutive(np.zeros(beads.n_beads, np.int64), count)
    u = (nth // across[bead] + 0.5) / along[bead]
    v = ((nth % across[bead] + 0.5) / across[bead] - 0.5) * reach[bead]
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


def rows_of(areas: Areas, cell: float) -> Lines:
    """Return lines along x within areas, four per row of cells."""
    return hatch(areas, angle=0.0, spacing=cell / _ROWS, phase=0.5)


def covered_share(rows: Lines, layer: int, window: CellWindow) -> Float:
    """Return the covered share of each cell (deep, wide); exact along x, to a quarter of a cell along y."""
    first, last = np.searchsorted(rows.layer, [layer, layer + 1])
    row = rows.row[first:last] // _ROWS - window.front
    inside = (row >= 0) & (row < window.deep)
    u = np.clip(rows.u[first:last][inside] / window.cell - window.left, 0, window.wide)
    row = np.repeat(row[inside], 2)
    place, sign = u.ravel(), np.tile([1.0 / _ROWS, -1.0 / _ROWS], len(u))
    cell = np.floor(place).astype(np.int64)
    part = place - cell
    size = window.deep * (window.wide + 2)
    begin = row * (window.wide + 2) + cell
    steps = np.bincount(begin, weights=sign * (1 - part), minlength=size)
    steps += np.bincount(begin + 1, weights=sign * part, minlength=size)
    return np.asarray(np.cumsum(steps.reshape(window.deep, -1), axis=1)[:, : window.wide], np.float64)


def window_mean(field: Float, reach: int) -> Float:
    """Return the mean over the square of 2 · reach + 1 cells around each cell; outside cells are empty."""
    sums = np.pad(field, ((reach + 1, reach), (reach + 1, reach))).cumsum(axis=0).cumsum(axis=1)
    size = 2 * reach + 1
    total = sums[size:, size:] - sums[:-size, size:] - sums[size:, :-size] + sums[:-size, :-size]
    return np.asarray(total / size**2)
