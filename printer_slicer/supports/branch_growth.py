"""Grow branches from their tips down to the bed, level by level, and merge those that meet."""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Bool, Float, Int
from printer_slicer.geometry.raster import NEIGHBOUR_CELLS, Float32
from printer_slicer.geometry.vectors import norm
from printer_slicer.supports.branch_merging import LiveBranches, choose_goals, join_branches
from printer_slicer.supports.first_segments import FirstSegments, grow_radius
from printer_slicer.supports.reach_fields import ReachFields
from printer_slicer.supports.tree_settings import TreeSettings
from printer_slicer.values import Struct, replace

__all__ = ["BranchNodes", "grow_branches"]

_ROUNDING = 1e-5  # mm


class BranchNodes(Struct, frozen=True, eq=False):
    """Nodes of all branches. Nodes come before the nodes below them.

    Attributes:
        place: (N, 3) mm.
        radius: (N,) mm.
        below: (N,) next node down; -1: the branch ends here.
        lower_radius: (N,) radius of the piece from this node where it arrives at the next one, mm.
        level: (N,) level of the node; -1: a tip, or an end on the part.
        movable: (N,) whether the node may be moved by smoothing.
        on_part: (N,) whether the branch ends here on the part.
    """

    place: Float
    radius: Float
    below: Int
    lower_radius: Float
    level: Int
    movable: Bool
    on_part: Bool

    @property
    def upper_nodes(self) -> Int:
        """Upper ends (B,) of all pieces; a level at the height of the part's surface leaves no room for a piece."""
        upper = np.flatnonzero(self.below >= 0)
        return np.asarray(upper[self.place[upper, 2] > self.place[self.below[upper], 2] + _ROUNDING])

    @property
    def pieces(self) -> Float:
        """All pieces (B, 8): z, x, y and radius of the lower end, then of the upper end, mm."""
        upper = self.upper_nodes
        lower = self.below[upper]
        low, high = self.place[lower][:, [2, 0, 1]], self.place[upper][:, [2, 0, 1]]
        return np.column_stack([low, self.lower_radius[upper], high, self.radius[upper]])

    @property
    def piece_heights(self) -> Float:
        """Distance (B,) from the lower end of each piece up to the highest tip of its branch, mm."""
        highest, upper = np.array(self.place[:, 2]), self.upper_nodes
        for level in (-1, *range(int(self.level.max(initial=-1)), -1, -1)):
            some = upper[self.level[upper] == level]
            np.maximum.at(highest, self.below[some], highest[some])
        lower = self.below[upper]
        return np.asarray(highest[lower] - self.place[lower, 2])


class _Nodes:
    """Nodes while they are made."""

    def __init__(self, tips: Float, radius: float) -> None:
        """Begin with the tips (T, 3)."""
        n = len(tips)
        self._place, self._radius = [tips], [np.full(n, radius)]
        self._level, self._movable, self._on_part = (
            [np.full(n, -1)],
            [np.zeros(n, np.bool_)],
            [np.zeros(n, np.bool_)],
        )
        self._upper, self._lower, self._arrived = list[Int](), list[Int](), list[Float]()
        self.count = n

    def add(self, place: Float, radius: Float, level: int, *, movable: Bool, on_part: bool = False) -> Int:
        """Add nodes (n, 3) and return their indices (n,)."""
        n = len(place)
        self._place.append(place)
        self._radius.append(radius)
        self._level.append(np.full(n, level))
        self._movable.append(movable)
        self._on_part.append(np.full(n, on_part))
        self.count += n
        return np.arange(self.count - n, self.count)

    def link(self, upper: Int, lower: Int, radius: Float) -> None:
        """Let the nodes `lower` (n,) follow `upper` (n,), where pieces arrive with a radius (n,)."""
        self._upper.append(upper)
        self._lower.append(lower)
        self._arrived.append(radius)

    def place_of(self, node: Int) -> Float:
        """Return the places (n, 3) of nodes."""
        self._place = [np.concatenate(self._place)]
        return self._place[0][node]

    def radius_of(self, node: Int) -> Float:
        """Return the radii (n,) of nodes, mm."""
        self._radius = [np.concatenate(self._radius)]
        return self._radius[0][node]

    def fix(self, node: Int) -> None:
        """Let smoothing not move these nodes."""
        self._movable = [np.concatenate(self._movable)]
        self._movable[0][node] = False

    def finish(self) -> BranchNodes:
        """Return all nodes."""
        below, lower_radius = np.full(self.count, -1), np.zeros(self.count)
        for upper, lower, radius in zip(self._upper, self._lower, self._arrived, strict=True):
            below[upper], lower_radius[upper] = lower, radius
        columns = (self._place, self._radius, self._level, self._movable, self._on_part)
        place, own, level, movable, on_part = (np.concatenate(column) for column in columns)
        return BranchNodes(place, own, below, lower_radius, level, movable, on_part)


def grow_branches(
    tips: Float, starts: FirstSegments, fields: ReachFields, settings: TreeSettings
) -> BranchNodes:
    """Grow branches from all tips that have a way down to the bed or to the part.

    On each level, those that are close become one. Each branch then moves towards the nearest other one that it can
    meet, or else along the cheapest way, and only to places from which a branch of its radius reaches its end.

    Args:
        tips: (T, 3) mm; tip i is node i.
        starts: of the tips.
        fields: where branches can go.
        settings: of trees.
    """
    nodes = _Nodes(tips, settings.tip_radius)
    live = _begin(tips, starts, np.zeros(0, np.int64))
    for level in range(fields.n_levels - 1, -1, -1):
        if level:
            live = _concatenate(live, _begin(tips, starts, np.flatnonzero(starts.level == level)))
        if not len(live.node):
            continue
        live = _arrive(live, level, nodes, fields, settings)
        live = _end_on_part(live, level, nodes, fields)
        if level and len(live.node):
            live = _go_down(live, level, fields, settings)
    low = np.flatnonzero(starts.level == 0)  # their first piece ends on the bed
    place = np.column_stack([starts.place[low], np.zeros(len(low))])
    foot = nodes.add(place, starts.radius[low], 0, movable=np.zeros(len(low), np.bool_))
    nodes.link(low, foot, starts.radius[low])
    return nodes.finish()


def _begin(tips: Float, starts: FirstSegments, which: Int) -> LiveBranches:
    """Return the branches of some tips as they arrive at their first level."""
    n, radius = len(which), starts.radius[which]
    reach, drift = np.zeros(n), np.zeros((n, 2))
    return LiveBranches(which, starts.cell[which], radius, starts.to_bed[which], reach, tips[which], drift)


def _concatenate(live: LiveBranches, new: LiveBranches) -> LiveBranches:
    """Return the branches of both values."""
    return LiveBranches(
        *(
            np.concatenate([getattr(one, name) for one in (live, new)])
            for name in LiveBranches.__struct_fields__
        )
    )


def _look_up(to_bed: Bool, level: int, cell: Int, fields: ReachFields, name: str) -> Float32:
    """Return the values of a field at cells (n, ...) of a level, for branches (n,) to the bed or to any end."""
    bed, part = (getattr(ways, name)[level].ravel() for ways in (fields.to_bed, fields.to_any))
    shape = (len(to_bed),) + (1,) * (cell.ndim - 1)
    return np.asarray(np.where(to_bed.reshape(shape), bed[cell], part[cell]))


def _arrive(
    live: LiveBranches, level: int, nodes: _Nodes, fields: ReachFields, settings: TreeSettings
) -> LiveBranches:
    """Make the nodes of a level, one for all branches that become one there; return the branches that go on."""
    above = nodes.place_of(live.node)
    group, merged = join_branches(live, above[:, :2], level, fields, settings)
    middle = fields.grid.find_middles(merged.cell)
    place = np.column_stack([middle, np.full(len(middle), level * fields.slab)])
    from_tip = np.zeros(len(middle), np.bool_)
    from_tip[group[live.reach == 0]] = True
    node = nodes.add(place, merged.radius, level, movable=~from_tip)
    aside = norm(above[:, :2] - middle[group])
    height = above[:, 2] - level * fields.slab
    thin = nodes.radius_of(live.node)
    arrived = np.minimum(live.radius, np.maximum(thin + settings.slope * height - aside, thin))
    nodes.link(live.node, node[group], arrived)
    return replace(merged, node=node)


def _end_on_part(live: LiveBranches, level: int, nodes: _Nodes, fields: ReachFields) -> LiveBranches:
    """End the branches that stand on the part under this level; return the others."""
    if not level:
        return live
    room = fields.end_radius[level].ravel()[live.cell]
    price = _look_up(live.to_bed, level, live.cell, fields, "price")
    cheapest = np.abs(price - fields.end_price[level].ravel()[live.cell]) <= 1e-3
    ends = ~live.to_bed & (room >= live.radius - _ROUNDING) & (cheapest | ~_can_go_on(live, level, fields))
    here = live.take(ends)
    if len(here.node):
        around, inside = fields.grid.find_moved_cells(here.cell, NEIGHBOUR_CELLS)
        z = np.where(inside, fields.surface[level].ravel()[around], np.inf).min(axis=1).astype(np.float64)
        place = np.column_stack([fields.grid.find_middles(here.cell), z])
        foot = nodes.add(place, here.radius, -1, movable=np.zeros(len(z), np.bool_), on_part=True)
        nodes.link(here.node, foot, here.radius)
        nodes.fix(here.node)
    return live.take(~ends)


def _can_go_on(live: LiveBranches, level: int, fields: ReachFields) -> Bool:
    """Return a mask (n,) of branches that can go down one more level."""
    cell, inside = fields.grid.find_moved_cells(live.cell, fields.moves.step)
    free = np.where(inside, _look_up(live.to_bed, level - 1, cell, fields, "free"), -np.inf)
    room = np.minimum(free.max(axis=1), fields.clear[level - 1].ravel()[live.cell])
    return np.asarray(room >= live.radius - _ROUNDING)


def _go_down(live: LiveBranches, level: int, fields: ReachFields, settings: TreeSettings) -> LiveBranches:
    """Move all branches to the level below."""
    cell, inside = fields.grid.find_moved_cells(live.cell, fields.moves.step)
    free = _look_up(live.to_bed, level - 1, cell, fields, "free")
    possible = inside & (free >= live.radius[:, None] - _ROUNDING)
    price = _look_up(live.to_bed, level - 1, cell, fields, "price") + fields.moves.length
    goal = choose_goals(live, level, fields, settings) + live.drift
    away = norm(fields.grid.find_middles(cell) - goal[:, None])
    cost = np.where(possible, np.where(np.isnan(away), price, away), np.inf)
    best, own = np.argmin(cost, axis=1), np.arange(len(cost))
    if not np.isfinite(cost[own, best]).all():
        raise AssertionError("a branch stands where none reaches its end")
    aside = fields.moves.aside[best]
    most = np.minimum(free[own, best], live.radius + settings.slope * fields.slab - aside)
    radius = np.maximum(np.minimum(grow_radius(live.radius, fields.slab, settings), most), live.radius)
    reach = np.full(len(own), settings.slope * fields.slab + _ROUNDING)
    drift = np.nan_to_num(goal - fields.grid.find_middles(cell[own, best]))
    drift = np.clip(drift, -fields.grid.cell / 2, fields.grid.cell / 2)
    return replace(live, cell=cell[own, best], radius=radius, reach=reach, drift=drift)
