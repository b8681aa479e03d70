"""Measure on a raster how full of material each layer is."""

from __future__ import annotations

from typing import Final

import numpy as np

from printer_slicer.arrays import Bool, Float, frozen_array
from printer_slicer.geometry import Areas, normalize
from printer_slicer.inspection.coverage.extrusions import Extrusions, Purpose
from printer_slicer.inspection.coverage.raster import (
    CellWindow,
    choose_cell_width,
    covered_share,
    make_scan_lines,
    rasterize_fill,
    window_mean,
)
from printer_slicer.inspection.coverage.stack import Stack, split_thick_extrusions
from printer_slicer.values import Struct, force_setattr

__all__ = ["LayerFill", "measure_fill", "overlap_cells"]

_MIN_SHELL_AREA: Final = 1.0  # mm²; a mean over a smaller shell says nothing
_MIN_MARGIN, _MAX_MARGIN = 1.0, 5.0  # mm, limits of the margin around extrusions


class LayerFill(Struct, frozen=True, eq=False):
    """How full of material each layer is, measured on a raster.

    Attributes:
        overlap: (L,) mm², area where the mean fill exceeds `CoverageRules.overlap_ratio`; the mean is over
            windows as wide as a line.
        most: (L,) largest mean fill in such a window.
        place: (L, 2) position of the largest mean fill, mm.
        shell: (L,) material in the shell as a share of the material it needs; nan if the shell is tiny.
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
            force_setattr(self, name, frozen_array(getattr(self, name), np.float64, shape))


def measure_fill(
    stack: Stack, of_part: Bool, core: Areas, area_to_fill: Float, overlap_ratio: float
) -> LayerFill:
    """Measure how full of material each layer is, without ironing.

    Args:
        stack: all beads.
        of_part: (B,) mask of the extrusions of the part; the others are left out.
        core: area of each section inside the shell.
        area_to_fill: (L,) mm² outside the core that each layer should fill.
        overlap_ratio: see `LayerFill`.
    """
    n, height = stack.n_layers, stack.height
    overlap, most, place, shell = np.zeros(n), np.zeros(n), np.full((n, 2), np.nan), np.full(n, np.nan)
    order = np.flatnonzero(of_part & (stack.beads.purpose != Purpose.IRONING))
    order = order[np.argsort(stack.layer[order], kind="stable")]
    beads = stack.beads.take(order)
    bounds = np.searchsorted(stack.layer[order], np.arange(n + 1)).tolist()
    shared_layers, cell = _SharedLayers(stack, of_part), _cell_width_around(beads)
    reach, rows = _window_reach_in_cells(beads, cell), make_scan_lines(core, cell)
    for k in range(n):
        # Higher extrusions that reach down to this layer fill it, too.
        selected = (
            shared_layers.extrusions_in(k)
            if shared_layers.shared[k]
            else beads.take(np.arange(bounds[k], bounds[k + 1]))
        )
        if not selected.n_beads:
            continue
        window = _window_around(cell, selected)
        fill = rasterize_fill(selected, window, float(height[k]))
        mean = window_mean(fill, reach)
        overlap[k] = float((mean > overlap_ratio).sum()) * cell**2
        i, j = divmod(int(mean.argmax()), window.wide)
        most[k], place[k] = mean[i, j], window.cell_middle(i, j)
        if area_to_fill[k] > _MIN_SHELL_AREA:
            fill_in_shell = fill * (1 - covered_share(rows, k, window))
            shell[k] = float(fill_in_shell.sum()) * cell**2 / area_to_fill[k]
    return LayerFill(overlap, most, place, shell, cell)


def overlap_cells(beads: Extrusions, layer_height: float, overlap_ratio: float, cell: float) -> Areas:
    """Return the areas where extrusions of a layer overlap; adjacent cells of a row form one rectangle."""
    window = _window_around(cell, beads)
    is_overlap = (
        window_mean(rasterize_fill(beads, window, layer_height), _window_reach_in_cells(beads, cell))
        > overlap_ratio
    )
    steps = np.diff(np.pad(is_overlap, ((0, 0), (1, 1))).astype(np.int8), axis=1)
    row, first = np.nonzero(steps > 0)
    last = np.nonzero(steps < 0)[1]
    x0, x1 = (window.left + first) * cell, (window.left + last) * cell
    y0, y1 = (window.front + row) * cell, (window.front + row + 1) * cell
    corners = np.stack([x0, y0, x1, y0, x1, y1, x0, y1], axis=1).reshape(-1, 2)
    n_rings = len(row)
    return normalize(Areas(corners, np.arange(n_rings + 1) * 4, np.zeros(n_rings, np.int64), 1))


class _SharedLayers:
    """Extrusions of the layers that share extrusions with other layers; `shared` (L,) is their mask."""

    def __init__(self, stack: Stack, of_part: Bool) -> None:
        """Split all extrusions by layer, and store the extrusions of the part, selected by `of_part` (B,)."""
        parts, source = split_thick_extrusions(stack)
        n = stack.n_layers
        is_split = np.bincount(source, minlength=stack.beads.n_beads)[source] > 1
        self.shared = np.bincount(parts.layer[is_split & of_part[source]], minlength=n) > 0
        kept = of_part[source] & (parts.beads.purpose != Purpose.IRONING) & (parts.layer >= 0)
        kept &= self.shared[parts.layer]
        own = np.flatnonzero(kept)
        own = own[np.argsort(parts.layer[own], kind="stable")]
        self._beads = parts.beads.take(own)
        self._bounds = np.searchsorted(parts.layer[own], np.arange(n + 1))

    def extrusions_in(self, k: int) -> Extrusions:
        """Return all extrusions that fill layer k, which must be a shared layer."""
        return self._beads.take(np.arange(self._bounds[k], self._bounds[k + 1]))


def _cell_width_around(beads: Extrusions) -> float:
    """Return the cell width, mm, that suits the size of the bounding box of extrusions."""
    ends = np.concatenate([np.zeros((1, 2)), beads.begin, beads.end][bool(beads.n_beads) :])
    return choose_cell_width(ends.min(axis=0), ends.max(axis=0))


def _window_reach_in_cells(beads: Extrusions, cell: float) -> int:
    """Return how many cells a window as wide as a usual extrusion extends from its middle cell."""
    return max(round((beads.usual_width / cell - 1) / 2), 1)


def _window_around(cell: float, beads: Extrusions) -> CellWindow:
    """Return the rectangle of cells that encloses extrusions."""
    ends = np.concatenate([beads.begin, beads.end])
    if not len(ends):
        return CellWindow(0, 0, 1, 1, cell)
    margin = min(max(float(beads.width.max()), _MIN_MARGIN), _MAX_MARGIN)
    return CellWindow.around(ends.min(axis=0), ends.max(axis=0), margin, cell)
