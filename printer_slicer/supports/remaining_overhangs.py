"""Find the overhangs that supports of one style leave unsupported, so that the other style can support them."""

from __future__ import annotations

from typing import Final

import numpy as np

from printer_slicer.arrays import distinct, run_starts
from printer_slicer.geometry import Areas, intersection, normalize, offset
from printer_slicer.geometry.raster import CellGrid
from printer_slicer.model import Overhangs, Toolpaths
from printer_slicer.profile import Profile
from printer_slicer.supports.patches import join_patches
from printer_slicer.supports.slopes import compute_steps
from printer_slicer.supports.unsupported_places import UnsupportedPoints, find_unsupported_groups
from printer_slicer.values import replace

__all__ = ["find_remaining_overhangs"]

_MIN_AREA: Final = 1.0  # mm² of a place; smaller ones stay unsupported
_MARGIN: Final = (
    0.6  # mm around a place in which the overhang is supported, too, so that extrusions have room
)
_CELL: Final = (
    0.25  # mm; side of the cells by which places are drawn, more than the distance between their points
)


def find_remaining_overhangs(overhangs: Overhangs, paths: Toolpaths, profile: Profile) -> Overhangs:
    """Return the overhangs that have no bead near them, with a margin, and the islands without one.

    Args:
        overhangs: areas that need supports.
        paths: the beads of supports, on their layers.
        profile: gaps of supports, and the smallest patches.
    """
    groups = find_unsupported_groups(overhangs, paths, profile, with_islands=True)
    large = [one for one in groups if one.island.any() or one.area.sum() >= _MIN_AREA]
    near = _draw_places(large, overhangs.plan.n_layers)
    area, islands = intersection(overhangs.area, near), intersection(overhangs.islands, near)
    step = compute_steps(overhangs.plan, profile.quality.support_threshold_deg)
    kept, patch = join_patches(area, area, Areas.empty(area.n_layers), step, profile.quality)
    return replace(overhangs, area=kept, ring_patch=patch, islands=islands)


def _draw_places(groups: list[UnsupportedPoints], n_layers: int) -> Areas:
    """Return the areas around the points of places, by layer.

    Points lie so densely that an area around each of them would overlap dozens of others. So the rows of cells in which
    points lie are drawn instead.
    """
    if not groups:
        return Areas.empty(n_layers)
    xy = np.concatenate([one.xy for one in groups])
    grid = CellGrid.around(xy.min(axis=0), xy.max(axis=0) + _CELL, _CELL)
    cells = distinct(np.concatenate([one.layer for one in groups]) * grid.n_cells + grid.find_cells(xy))
    layer, cell = np.divmod(cells, grid.n_cells)
    begins = run_starts(cells - np.arange(len(cells))) | run_starts(cells // grid.n_columns)
    first = np.flatnonzero(begins)
    low = grid.find_middles(cell[first]) - _CELL / 2
    high = grid.find_middles(cell[np.append(first[1:], len(cells)) - 1]) + _CELL / 2
    rows = Areas.from_boxes(low, high, layer[first], n_layers)
    return offset(normalize(rows), _MARGIN)
