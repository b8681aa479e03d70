"""Measure how full each layer is, on a raster."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from printer_slicer.arrays import Bool, Float, frozen_array
from printer_slicer.geometry import Areas, normalize
from printer_slicer.inspection.coverage.extrusions import Extrusions, Purpose
from printer_slicer.inspection.coverage.raster import (
    CellWindow,
    cell_for,
    covered_share,
    rasterize_fill,
    rows_of,
    window_mean,
)
from printer_slicer.inspection.coverage.stack import Stack, split_thick_extrusions

__all__ = ["LayerFill", "measure_fill", "overlap_cells"]

_LEAST: Final = 1.0  # mm² of shell, under which its mean fill says nothing
_LEAST_MARGIN, _WIDEST_MARGIN = 1.0, 5.0  # mm of cells around beads: their width, within reason


@dataclass(frozen=True, slots=True, eq=False)
class LayerFill:
    """Fill of each layer, measured on the raster.

    Attributes:
        overlap: (L,) mm² filled more than `Rules.overlap_ratio` times, in the mean over a window as wide as a bead.
        most: (L,) the largest of these means.
        place: (L, 2) its position, mm.
        shell: (L,) material in the shell as a share of what it needs; nan if there is hardly any shell.
        cell: mm, width of the cells.
    """

    overlap: Float
    most: Float
    place: Float
    shell: Float
    cell: float

    def __post_init__(self) -> None:
        n = len(self.overlap)
        for name, shape in (("overlap", (n,)), ("most", (n,)), ("place", (n, 2)), ("shell", (n,))):
            object.__setattr__(self, name, frozen_array(getattr(self, name), np.float64, shape))


def measure_fill(stack: Stack, of_part: Bool, core: Areas, wanted: Float, overlap_ratio: float) -> LayerFill:
    """Measure how full each layer is; ironing is left out.

    Args:
        stack: all beads.
        of_part: (B,) which of them make up the part; the rest is left out.
        core: of each section, inside the shell.
        wanted: (L,) mm² of each layer outside the core that are to be filled.
        overlap_ratio: see `LayerFill`.
    """
    n, height = stack.n_layers, stack.height
    overlap, most, place, shell = np.zeros(n), np.zeros(n), np.full((n, 2), np.nan), np.full(n, np.nan)
    order = np.flatnonzero(of_part & (stack.beads.purpose != Purpose.IRONING))
    order = order[np.argsort(stack.layer[order], kind="stable")]
    beads = stack.beads.take(order)
    bounds = np.searchsorted(stack.layer[order], np.arange(n + 1)).tolist()
    slabs, cell = _Slabs(stack, of_part), _cell_of(beads)
    reach, rows = _reach(beads, cell), rows_of(core, cell)
    for k in range(n):
        # What is laid later, down to here, fills the layer too.
        some = slabs.of_layer(k) if slabs.deep[k] else beads.take(np.arange(bounds[k], bounds[k + 1]))
        if not some.n_beads:
            continue
        window = _window(cell, some)
        fill = rasterize_fill(some, window, float(height[k]))
        mean = window_mean(fill, reach)
        overlap[k] = float((mean > overlap_ratio).sum()) * cell**2
        i, j = divmod(int(mean.argmax()), window.wide)
        most[k], place[k] = mean[i, j], window.middle(i, j)
        if wanted[k] > _LEAST:
            laid = fill * (1 - covered_share(rows, k, window))
            shell[k] = float(laid.sum()) * cell**2 / wanted[k]
    return LayerFill(overlap, most, place, shell, cell)


def overlap_cells(beads: Extrusions, layer_height: float, overlap_ratio: float, cell: float) -> Areas:
    """Return the overlap of a layer's extrusions as areas of one layer; cells in a row form a rectangle."""
    window = _window(cell, beads)
    high = window_mean(rasterize_fill(beads, window, layer_height), _reach(beads, cell)) > overlap_ratio
    steps = np.diff(np.pad(high, ((0, 0), (1, 1))).astype(np.int8), axis=1)
    row, first = np.nonzero(steps > 0)
    last = np.nonzero(steps < 0)[1]
    x0, x1 = (window.left + first) * cell, (window.left + last) * cell
    y0, y1 = (window.front + row) * cell, (window.front + row + 1) * cell
    corners = np.stack([x0, y0, x1, y0, x1, y1, x0, y1], axis=1).reshape(-1, 2)
    n_rings = len(row)
    return normalize(Areas(corners, np.arange(n_rings + 1) * 4, np.zeros(n_rings, np.int64), 1))


class _Slabs:
    """Extrusions that fill each layer, in any order; `deep` (L,) tells whether a taller extrusion is among them."""

    def __init__(self, stack: Stack, of_part: Bool) -> None:
        """Take all beads, and which make up the part."""
        parts, source = split_thick_extrusions(stack)
        n = stack.n_layers
        cut = np.bincount(source, minlength=stack.beads.n_beads)[source] > 1
        self.deep = np.bincount(parts.layer[cut & of_part[source]], minlength=n) > 0
        kept = of_part[source] & (parts.beads.purpose != Purpose.IRONING) & (parts.layer >= 0)
        kept &= self.deep[parts.layer]
        own = np.flatnonzero(kept)
        own = own[np.argsort(parts.layer[own], kind="stable")]
        self._beads = parts.beads.take(own)
        self._bounds = np.searchsorted(parts.layer[own], np.arange(n + 1))

    def of_layer(self, k: int) -> Extrusions:
        """Return everything that fills layer k, one of the deep layers."""
        return self._beads.take(np.arange(self._bounds[k], self._bounds[k + 1]))


def _cell_of(beads: Extrusions) -> float:
    """Return the width of the cells, mm, for the box around beads."""
    ends = np.concatenate([np.zeros((1, 2)), beads.begin, beads.end][bool(beads.n_beads) :])
    return cell_for(ends.min(axis=0), ends.max(axis=0))


def _reach(beads: Extrusions, cell: float) -> int:
    """Cells to either side of the one in the middle of a window as wide as a usual bead."""
    return max(round((beads.usual_width / cell - 1) / 2), 1)


def _window(cell: float, beads: Extrusions) -> CellWindow:
    """Return the window of cells around extrusions."""
    ends = np.concatenate([beads.begin, beads.end])
    if not len(ends):
        return CellWindow(0, 0, 1, 1, cell)
    margin = min(max(float(beads.width.max()), _LEAST_MARGIN), _WIDEST_MARGIN)
    return CellWindow.around(ends.min(axis=0), ends.max(axis=0), margin, cell)
