"""Align seams: choose one seam position on each loop, hidden in corners and continuous from layer to layer.

Each loop has some candidate positions. The cost of a candidate is proportional to the layer height: flat positions cost
most, concave corners least. The cost between candidates of a loop and of the loop below is their horizontal distance.
So the result does not depend on the layer height. The minimum over all layers is found exactly by dynamic programming,
with costs passed from the top layer down and choices made from the bottom layer up.

Source: Viterbi 1967, "Error bounds for convolutional codes", applied to trees of stacked loops.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, bounding_boxes
from printer_slicer.geometry.boxes import Boxes
from printer_slicer.model import Toolpaths
from printer_slicer.ordering.loops import Loops
from printer_slicer.values import Struct

__all__ = ["align_seams"]

_N_CANDIDATES = 14  # candidates per loop, evenly spaced; a corner replaces the one in its section
# Length of outline, mm, on each side over which a corner is measured; longer than segments of tessellated curves.
_CORNER_ARM = 0.8
_SMALLEST_TURN, _FULL_TURN = np.radians(20), np.radians(90)  # below: no corner; above: a full corner
_CONVEX_COST = 0.5  # cost of a convex corner relative to a flat position; a concave one costs nothing
_OPPOSITE_SIDE_COST = 0.15  # relative additional cost of positions opposite the preferred side
_STRONG_OPPOSITE_SIDE_COST = 3.0  # the same if the user set a direction
_COST_PER_HEIGHT = 2.0  # cost of a flat position in mm of horizontal distance per mm of layer height
_MAX_DISTANCE_COST = 6.0  # mm; maximum cost of a horizontal distance, beyond which the seam starts anew
_MAX_BOX_DIFFERENCE = 4.0  # mm by which the bounding boxes of stacked loops may differ
_MAX_SHIFT = 1.5  # mm by which a seam on a flat position may move to lie above the one below


def align_seams(paths: Toolpaths, loops: Loops, toward: Float, *, prefers_side: bool) -> Float:
    """Return the seam positions of loops (R,), mm along each loop.

    Args:
        paths: all paths.
        loops: the loops, sorted by layer.
        toward: (2,) unit vector to the preferred side.
        prefers_side: whether the preferred side is more important than corners.
    """
    if not loops.n_loops:
        return np.zeros(0)
    below = _find_loops_below(loops)
    candidates = _Candidates.of(paths, loops, toward, prefers_side=prefers_side)
    chosen = candidates.choose_cheapest(loops, below)
    every = np.arange(loops.n_loops)
    along, corner = candidates.along[every, chosen], candidates.corner[every, chosen]
    place = candidates.xy[every, chosen]
    for some in _split_by_layer(loops.layer):
        free = some[~corner[some] & (below[some] >= 0)]
        nearest, gap = loops.nearest_positions(free, place[below[free]])
        moved = free[gap < _MAX_SHIFT]
        along[moved] = nearest[gap < _MAX_SHIFT]
        place[moved] = loops.points_at(moved, along[moved])
    return along


class _Candidates(Struct, frozen=True, eq=False):
    """Candidate seam positions, C for each of R loops.

    Attributes:
        along: (R, C) mm from the loop's first point.
        xy: (R, C, 2) mm.
        cost: (R, C) cost in mm of horizontal distance.
        corner: (R, C) whether the candidate is a corner.
    """

    along: Float
    xy: Float
    cost: Float
    corner: Bool

    @classmethod
    def of(cls, paths: Toolpaths, loops: Loops, toward: Float, *, prefers_side: bool) -> _Candidates:
        """Build the candidates of each loop, evenly spaced from its point farthest toward the preferred side.

        The sharpest corner in a section replaces the candidate of that section.
        """
        n, owner = loops.n_loops, np.repeat(np.arange(loops.n_loops), np.diff(loops.start))
        ahead = loops.xy @ toward
        top = np.maximum.reduceat(ahead, loops.start[:-1])
        farthest = _find_first_hits(owner, ahead >= top[owner] - 1e-6)
        shift = np.mod(loops.reach - loops.reach[farthest][owner], np.maximum(loops.length[owner], 1e-9))
        section = np.minimum(shift / np.maximum(loops.length[owner], 1e-9) * _N_CANDIDATES, _N_CANDIDATES - 1)
        along = (
            loops.reach[farthest][:, None]
            + (np.arange(_N_CANDIDATES) + 0.5) / _N_CANDIDATES * loops.length[:, None]
        )
        cost, corner = np.ones((n, _N_CANDIDATES)), np.zeros((n, _N_CANDIDATES), np.bool_)
        at = _compute_corner_costs(loops, owner)
        sharp = np.flatnonzero(at < 1.0)
        # Sorted such that the sharpest corner is written last.
        sharp = sharp[np.argsort(-at[sharp], kind="stable")]
        cell = owner[sharp], section[sharp].astype(np.int64)
        along[cell], cost[cell], corner[cell] = loops.reach[sharp], at[sharp], True
        loop = np.repeat(np.arange(n), _N_CANDIDATES)
        xy = loops.points_at(loop, along.ravel()).reshape(n, _N_CANDIDATES, 2)
        side, _ = loops.find_segments(loop, along.ravel())
        unsupported = 1.0 - paths.support_ratio[loops.point[side]].reshape(n, _N_CANDIDATES)
        bottom = np.minimum.reduceat(ahead, loops.start[:-1])
        behind = (top[:, None] - xy @ toward) / np.maximum(top - bottom, 1e-9)[:, None]
        cost = (
            cost
            + unsupported
            + behind * (_STRONG_OPPOSITE_SIDE_COST if prefers_side else _OPPOSITE_SIDE_COST)
        )
        height = paths.plan.height[loops.layer]
        return cls(along, xy, cost * (_COST_PER_HEIGHT * height)[:, None], corner)

    def choose_cheapest(self, loops: Loops, below: Int) -> Int:
        """Return the candidate with the lowest total cost for each loop (R,)."""
        total = self.cost.copy()
        layers = list(_split_by_layer(loops.layer))
        for some in reversed(layers):
            child = some[below[some] >= 0]
            if len(child):
                message = (total[child][:, None, :] + self._transition_costs(below[child], child)).min(axis=2)
                np.add.at(total, below[child], message)
        chosen: Int = total.argmin(axis=1)
        for some in layers:
            child = some[below[some] >= 0]
            if len(child):
                parent = below[child]
                step = self._limited_distance(self.xy[parent, chosen[parent]][:, None] - self.xy[child])
                chosen[child] = (total[child] + step).argmin(axis=1)
        return chosen

    def _transition_costs(self, lower: Int, upper: Int) -> Float:
        """Return the costs between candidates of lower and upper loops (Q, C, C)."""
        return self._limited_distance(self.xy[lower][:, :, None] - self.xy[upper][:, None, :])

    @staticmethod
    def _limited_distance(gap: Float) -> Float:
        """Return the lengths of vectors (..., 2), mm, limited to `_MAX_DISTANCE_COST`."""
        x, y = gap[..., 0], gap[..., 1]
        return np.asarray(np.minimum(np.sqrt(x * x + y * y), _MAX_DISTANCE_COST))


def _split_by_layer(layer: Int) -> Iterator[Int]:
    """Yield the loops of each layer, from the bottom up."""
    starts = np.flatnonzero(np.diff(layer)) + 1
    yield from np.split(np.arange(len(layer)), starts)


def _find_first_hits(owner: Int, is_hit: Bool) -> Int:
    """Return for each owner (R,) the index of its first entry where `is_hit` is true; every owner has one."""
    hits = np.flatnonzero(is_hit)
    return np.asarray(hits[np.searchsorted(owner[hits], np.arange(int(owner[-1]) + 1))])


def _compute_corner_costs(loops: Loops, owner: Int) -> Float:
    """Return the relative cost of each point as a seam (N,): 1 on flat parts, 0 in concave corners."""
    arm = np.minimum(_CORNER_ARM, loops.length / 6)[owner]
    before = loops.xy - loops.points_at(owner, loops.reach - arm)
    after = loops.points_at(owner, loops.reach + arm) - loops.xy
    turn = np.arctan2(before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0], (before * after).sum(axis=1))
    sharpness = np.clip((np.abs(turn) - _SMALLEST_TURN) / (_FULL_TURN - _SMALLEST_TURN), 0.0, 1.0)
    return np.asarray(1.0 - sharpness * np.where(turn > 0, _CONVEX_COST, 1.0))


def _find_loops_below(loops: Loops) -> Int:
    """Return for each loop (R,) the loop below with the most similar bounding box; -1 if there is none."""
    low, high = bounding_boxes(loops.xy, loops.start, np.arange(loops.n_loops), loops.n_loops)
    middle = Boxes((low + high) / 2, (low + high) / 2, loops.layer)
    under = Boxes(middle.low, middle.high, loops.layer + 1)
    upper, lower = middle.expand(_MAX_BOX_DIFFERENCE).find_overlapping(under)
    gap = np.maximum(np.abs(low[upper] - low[lower]), np.abs(high[upper] - high[lower])).max(axis=1)
    fits = gap < _MAX_BOX_DIFFERENCE
    upper, lower, gap = upper[fits], lower[fits], gap[fits]
    order = np.lexsort((lower, gap, upper))
    upper, lower = upper[order], lower[order]
    below = np.full(loops.n_loops, -1, np.int64)
    first = np.diff(upper, prepend=-1) > 0
    below[upper[first]] = lower[first]
    return below
