"""Smooth the zigzags of branches that go from cell to cell."""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Bool, Float, Int
from printer_slicer.geometry.vectors import norm
from printer_slicer.supports.branch_growth import BranchNodes
from printer_slicer.supports.reach_fields import ReachFields
from printer_slicer.supports.tree_settings import TreeSettings
from printer_slicer.values import replace

__all__ = ["smooth_branches"]

_ROUNDS = 3
_ROUNDING = 1e-6  # mm
_CORNERS = np.array([(0, 0), (0, 1), (1, 0), (1, 1)])


def smooth_branches(forest: BranchNodes, fields: ReachFields, settings: TreeSettings) -> BranchNodes:
    """Move nodes towards the middle between their neighbours, where the part is far enough away.

    Every second level is moved at once, while its neighbours stand still, so each check holds for the result: a moved
    node is clear of the part in all four cells around it, in the slabs above and below, and no piece is too steep.
    """
    place = np.array(forest.place)
    for turn in range(2 * _ROUNDS):
        own = np.flatnonzero(forest.movable & (forest.level % 2 == turn % 2))
        wanted = _average_neighbours(place, forest, own)
        fits = _is_clear(wanted, forest, own, fields) & _is_within_bed(wanted, forest, own, fields)
        moved = place.copy()
        moved[own[fits], :2] = wanted[fits]
        steep = _mark_ends_of_steep_pieces(moved, forest, settings)
        back = own[steep[own]]
        moved[back] = place[back]
        place = moved
    return replace(forest, place=place)


def _average_neighbours(place: Float, forest: BranchNodes, own: Int) -> Float:
    """Return for each node (n,) the mean (n, 2) of its place, the one below and the mean of those above, mm."""
    upper = np.flatnonzero(forest.below >= 0)
    lower = forest.below[upper]
    count = np.maximum(np.bincount(lower, minlength=len(place)), 1)[:, None]
    sums = [np.bincount(lower, place[upper, axis], minlength=len(place)) for axis in (0, 1)]
    above = np.asarray(np.stack(sums, axis=1), np.float64) / count
    below = np.where(forest.below >= 0, forest.below, np.arange(len(place)))
    # At the lower end, only the pieces above count.
    under = np.where((forest.below >= 0)[:, None], place[below, :2], above)
    return np.asarray((2 * place[own, :2] + above[own] + under[own]) / 4)


def _is_clear(wanted: Float, forest: BranchNodes, own: Int, fields: ReachFields) -> Bool:
    """Return a mask (n,) of places that keep the distance of a branch in all cells around them."""
    grid, level = fields.grid, forest.level[own]
    low = np.floor((wanted - (grid.x, grid.y)) / grid.cell - 0.5).astype(np.int64)[:, None, ::-1] + _CORNERS
    row, column = low[..., 0], low[..., 1]
    inside = (row >= 0) & (row < grid.n_rows) & (column >= 0) & (column < grid.n_columns)
    cell = np.where(inside, row * grid.n_columns + column, 0)
    clear = fields.clear.reshape(fields.n_levels, -1)
    room = np.minimum(clear[level[:, None], cell], clear[np.maximum(level - 1, 0)[:, None], cell])
    return np.asarray((inside & (room >= forest.radius[own, None] - _ROUNDING)).all(axis=1))


def _is_within_bed(wanted: Float, forest: BranchNodes, own: Int, fields: ReachFields) -> Bool:
    """Return a mask (n,) of places that are not nodes on the bed, or lie inside its edges by their radius."""
    on_bed = fields.to_bed.radius[0].ravel()[fields.grid.find_cells(wanted)]
    return np.asarray((forest.level[own] > 0) | (on_bed >= forest.radius[own]))


def _mark_ends_of_steep_pieces(place: Float, forest: BranchNodes, settings: TreeSettings) -> Bool:
    """Return a mask (N,) of nodes at either end of a piece whose outline moves sideways too much."""
    result = np.zeros(len(place), np.bool_)
    upper = np.flatnonzero(forest.below >= 0)
    lower = forest.below[upper]
    height = place[upper, 2] - place[lower, 2]
    aside = norm(place[upper, :2] - place[lower, :2]) + forest.lower_radius[upper] - forest.radius[upper]
    steep = aside > settings.slope * height + 1e-4
    result[upper[steep]] = result[lower[steep]] = True
    return result
