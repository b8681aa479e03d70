"""Align seams: choose one seam position on each loop, hidden in corners and continuous from layer to layer.

Each loop has some candidate positions. The cost of a candidate is proportional to the layer height: flat positions cost
most, concave corners least. The cost between candidates of a loop and of the loop below is their horizontal distance.
So the result does not depend on the layer height. The minimum over all layers is found exactly by dynamic programming,
with costs passed from the top layer down and choices made from the bottom layer up.

Source: Viterbi 1967, "Error bounds for convolutional codes", applied to trees of stacked loops.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, bounding_boxes
from printer_slicer.geometry.boxes import Boxes
from printer_slicer.model import Toolpaths
from printer_slicer.ordering.loops import Loops

__all__ = ["align_seams"]

_CANDIDATES = 14  # candidates per loop, evenly spaced; a corner replaces the one in its section
_ARM = 0.8  # mm on both sides over which a corner is measured; longer than segments of tessellated curves
_DULL, _SHARP = np.radians(20), np.radians(90)  # turning angles of no corner and of a full corner
_CONVEX = 0.5  # cost of a convex corner relative to a flat position; a concave one costs nothing
_PULL = 0.15  # relative additional cost of positions opposite the preferred side
_STRONG_PULL = 3.0  # the same if the user set a direction
_PER_HEIGHT = 2.0  # cost of a flat position in mm of horizontal distance per mm of layer height
_FARTHEST = 6.0  # mm; maximum cost of a horizontal distance, beyond which the seam starts anew
_BETWEEN = 4.0  # mm by which the bounding boxes of stacked loops may differ
_TRACKED = 1.5  # mm by which a seam on a flat position may move to lie above the one below


def align_seams(paths: Toolpaths, loops: Loops, toward: Float, *, strongly: bool) -> Float:
    """Return the seam positions of loops (R,), mm along each loop.

    Args:
        paths: all paths.
        loops: the loops, sorted by layer.
        toward: (2,) unit vector to the preferred side.
        strongly: whether the preferred side is more important than corners.
    """
    if not loops.n_loops:
        return np.zeros(0)
    below = _find_loops_below(loops)
    candidates = _Candidates.of(paths, loops, toward, strongly=strongly)
    chosen = candidates.cheapest(loops, below)
    every = np.arange(loops.n_loops)
    along, corner = candidates.along[every, chosen], candidates.corner[every, chosen]
    place = candidates.xy[every, chosen]
    for some in _by_layer(loops.layer):
        free = some[~corner[some] & (below[some] >= 0)]
        nearest, gap = loops.nearest(free, place[below[free]])
        moved = free[gap < _TRACKED]
        along[moved] = nearest[gap < _TRACKED]
        place[moved] = loops.at(moved, along[moved])
    return along


@dataclass(frozen=True, slots=True, eq=False)
class _Candidates:
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
    def of(cls, paths: Toolpaths, loops: Loops, toward: Float, *, strongly: bool) -> _Candidates:
        """Build candidates: evenly spaced from the point farthest on the preferred side, or the sharpest corners."""
        n, owner = loops.n_loops, np.repeat(np.arange(loops.n_loops), np.diff(loops.start))
        ahead = loops.xy @ toward
        top = np.maximum.reduceat(ahead, loops.start[:-1])
        farthest = _first_of(owner, ahead >= top[owner] - 1e-6)
        shift = np.mod(loops.reach - loops.reach[farthest][owner], np.maximum(loops.length[owner], 1e-9))
        section = np.minimum(shift / np.maximum(loops.length[owner], 1e-9) * _CANDIDATES, _CANDIDATES - 1)
        along = (
            loops.reach[farthest][:, None]
            + (np.arange(_CANDIDATES) + 0.5) / _CANDIDATES * loops.length[:, None]
        )
        cost, corner = np.ones((n, _CANDIDATES)), np.zeros((n, _CANDIDATES), np.bool_)
        at = _corner_costs(loops, owner)
        sharp = np.flatnonzero(at < 1.0)
        # Sorted such that the sharpest corner is written last.
        sharp = sharp[np.argsort(-at[sharp], kind="stable")]
        cell = owner[sharp], section[sharp].astype(np.int64)
        along[cell], cost[cell], corner[cell] = loops.reach[sharp], at[sharp], True
        loop = np.repeat(np.arange(n), _CANDIDATES)
        xy = loops.at(loop, along.ravel()).reshape(n, _CANDIDATES, 2)
        side, _ = loops.side(loop, along.ravel())
        unsupported = 1.0 - paths.support_ratio[loops.point[side]].reshape(n, _CANDIDATES)
        bottom = np.minimum.reduceat(ahead, loops.start[:-1])
        behind = (top[:, None] - xy @ toward) / np.maximum(top - bottom, 1e-9)[:, None]
        cost = cost + unsupported + behind * (_STRONG_PULL if strongly else _PULL)
        height = paths.plan.height[loops.layer]
        return cls(along, xy, cost * (_PER_HEIGHT * height)[:, None], corner)

    def cheapest(self, loops: Loops, below: Int) -> Int:
        """Return the candidate with the lowest total cost for each loop (R,)."""
        total = self.cost.copy()
        layers = list(_by_layer(loops.layer))
        for some in reversed(layers):
            child = some[below[some] >= 0]
            if len(child):
                message = (total[child][:, None, :] + self._steps(below[child], child)).min(axis=2)
                np.add.at(total, below[child], message)
        chosen: Int = total.argmin(axis=1)
        for some in layers:
            child = some[below[some] >= 0]
            if len(child):
                parent = below[child]
                step = self._far(self.xy[parent, chosen[parent]][:, None] - self.xy[child])
                chosen[child] = (total[child] + step).argmin(axis=1)
        return chosen

    def _steps(self, lower: Int, upper: Int) -> Float:
        """Return the costs between candidates of lower and upper loops (Q, C, C)."""
        return self._far(self.xy[lower][:, :, None] - self.xy[upper][:, None, :])

    @staticmethod
    def _far(gap: Float) -> Float:
        x, y = gap[..., 0], gap[..., 1]
        return np.asarray(np.minimum(np.sqrt(x * x + y * y), _FARTHEST))


def _by_layer(layer: Int) -> Iterator[Int]:
    """Yield the loops of each layer, from the bottom up."""
    starts = np.flatnonzero(np.diff(layer)) + 1
    yield from np.split(np.arange(len(layer)), starts)


def _first_of(owner: Int, hit: Bool) -> Int:
    """Return the first hit of each owner (R,); each has at least one."""
    hits = np.flatnonzero(hit)
    return np.asarray(hits[np.searchsorted(owner[hits], np.arange(int(owner[-1]) + 1))])


def _corner_costs(loops: Loops, owner: Int) -> Float:
    """Return the relative cost of each point as a seam (N,): 1 on flat parts, 0 in concave corners."""
    arm = np.minimum(_ARM, loops.length / 6)[owner]
    before = loops.xy - loops.at(owner, loops.reach - arm)
    after = loops.at(owner, loops.reach + arm) - loops.xy
    turn = np.arctan2(before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0], (before * after).sum(axis=1))
    sharpness = np.clip((np.abs(turn) - _DULL) / (_SHARP - _DULL), 0.0, 1.0)
    return np.asarray(1.0 - sharpness * np.where(turn > 0, _CONVEX, 1.0))


def _find_loops_below(loops: Loops) -> Int:
    """Return for each loop (R,) the loop below with the most similar bounding box; -1 if there is none."""
    low, high = bounding_boxes(loops.xy, loops.start, np.arange(loops.n_loops), loops.n_loops)
    middle = Boxes((low + high) / 2, (low + high) / 2, loops.layer)
    under = Boxes(middle.low, middle.high, loops.layer + 1)
    upper, lower = middle.expand(_BETWEEN).find_overlapping(under)
    gap = np.maximum(np.abs(low[upper] - low[lower]), np.abs(high[upper] - high[lower])).max(axis=1)
    fits = gap < _BETWEEN
    upper, lower, gap = upper[fits], lower[fits], gap[fits]
    order = np.lexsort((lower, gap, upper))
    upper, lower = upper[order], lower[order]
    below = np.full(loops.n_loops, -1, np.int64)
    first = np.diff(upper, prepend=-1) > 0
    below[upper[first]] = lower[first]
    return below
