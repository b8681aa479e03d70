"""Seams above each other: one place on each loop, so that corners hide them and they do not wander from layer to layer.

Each loop has some candidates. What a candidate costs is told per mm of height (a flat place costs more than a corner,
an inward corner least of all), what lies between the candidates of a loop and of the one below it in mm of sideways
step, so that layers of other heights have their seams at the same places. The cheapest choice for all layers together
is found exactly, by messages from the top layer down and choices from the bottom layer up.

Source: Viterbi 1967, "Error bounds for convolutional codes", on the trees that loops above each other form.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, boxes
from printer_slicer.geometry.boxes import Boxes
from printer_slicer.model import Toolpaths
from printer_slicer.ordering.loops import Loops

__all__ = ["align_seams"]

_CANDIDATES = 14  # places on a loop, evenly spread; a corner stands for the places around it
_ARM = 0.8  # mm on both sides of a place over which its corner is measured: longer than what a tessellation turns by
_DULL, _SHARP = np.radians(20), np.radians(90)  # turns that are no corner, and those that are nothing but one
_CONVEX = 0.5  # of what a flat place costs: what an outward corner costs; an inward one costs nothing
_PULL = 0.15  # of it: how much more the places opposite the wanted side cost where corners do not decide
_STRONG_PULL = 3.0  # the same where a direction was asked for
_PER_HEIGHT = 2.0  # mm of sideways step that a flat place costs per mm of height
_FARTHEST = 6.0  # mm of sideways step; for more the seam begins anew
_BETWEEN = 4.0  # mm that the boxes around a loop and the one below may differ by
_TRACKED = 1.5  # mm that a seam on a flat place moves so that it lies over the one below


def align_seams(paths: Toolpaths, loops: Loops, toward: Float, *, strongly: bool) -> Float:
    """(R,) where loops, by ascending layer, begin.

    Args:
        paths: all of them.
        loops: those that are asked for.
        toward: (2,) unit vector to the side where seams lie if corners do not decide.
        strongly: whether that side goes before corners.
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
    """Places that may become seams: C for each of R loops.

    Attributes:
        along: (R, C) mm from the loop's first point.
        xy: (R, C, 2) mm.
        cost: (R, C) mm of sideways step that they are worth.
        corner: (R, C) which are corners.
    """

    along: Float
    xy: Float
    cost: Float
    corner: Bool

    @classmethod
    def of(cls, paths: Toolpaths, loops: Loops, toward: Float, *, strongly: bool) -> _Candidates:
        """Evenly spread places from the one farthest on the wanted side on, or the best corners beside them."""
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
        # The last one written is the sharpest.
        sharp = sharp[np.argsort(-at[sharp], kind="stable")]
        cell = owner[sharp], section[sharp].astype(np.int64)
        along[cell], cost[cell], corner[cell] = loops.reach[sharp], at[sharp], True
        loop = np.repeat(np.arange(n), _CANDIDATES)
        xy = loops.at(loop, along.ravel()).reshape(n, _CANDIDATES, 2)
        side, _ = loops.side(loop, along.ravel())
        hanging = 1.0 - paths.support_ratio[loops.point[side]].reshape(n, _CANDIDATES)
        bottom = np.minimum.reduceat(ahead, loops.start[:-1])
        behind = (top[:, None] - xy @ toward) / np.maximum(top - bottom, 1e-9)[:, None]
        cost = cost + hanging + behind * (_STRONG_PULL if strongly else _PULL)
        height = paths.plan.height[loops.layer]
        return cls(along, xy, cost * (_PER_HEIGHT * height)[:, None], corner)

    def cheapest(self, loops: Loops, below: Int) -> Int:
        """(R,) one candidate for each loop, so that all of them together cost least."""
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
        """(Q, C, C) what it costs to step from the candidates of lower loops to those of upper ones."""
        return self._far(self.xy[lower][:, :, None] - self.xy[upper][:, None, :])

    @staticmethod
    def _far(gap: Float) -> Float:
        x, y = gap[..., 0], gap[..., 1]
        return np.asarray(np.minimum(np.sqrt(x * x + y * y), _FARTHEST))


def _by_layer(layer: Int) -> Iterator[Int]:
    """The loops of each layer, from the bottom up."""
    starts = np.flatnonzero(np.diff(layer)) + 1
    yield from np.split(np.arange(len(layer)), starts)


def _first_of(owner: Int, hit: Bool) -> Int:
    """(R,) for each owner the first that is hit; every one has some."""
    hits = np.flatnonzero(hit)
    return np.asarray(hits[np.searchsorted(owner[hits], np.arange(int(owner[-1]) + 1))])


def _corner_costs(loops: Loops, owner: Int) -> Float:
    """(N,) what each point costs as a seam: 1 where the loop is flat."""
    arm = np.minimum(_ARM, loops.length / 6)[owner]
    before = loops.xy - loops.at(owner, loops.reach - arm)
    after = loops.at(owner, loops.reach + arm) - loops.xy
    turn = np.arctan2(before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0], (before * after).sum(axis=1))
    sharpness = np.clip((np.abs(turn) - _DULL) / (_SHARP - _DULL), 0.0, 1.0)
    return np.asarray(1.0 - sharpness * np.where(turn > 0, _CONVEX, 1.0))


def _find_loops_below(loops: Loops) -> Int:
    """(R,) the loop of the layer below that has most nearly the same box around it; -1 where none is like it."""
    low, high = boxes(loops.xy, loops.start, np.arange(loops.n_loops), loops.n_loops)
    middle = Boxes((low + high) / 2, (low + high) / 2, loops.layer)
    under = Boxes(middle.low, middle.high, loops.layer + 1)
    upper, lower = middle.grown(_BETWEEN).overlapping(under)
    gap = np.maximum(np.abs(low[upper] - low[lower]), np.abs(high[upper] - high[lower])).max(axis=1)
    fits = gap < _BETWEEN
    upper, lower, gap = upper[fits], lower[fits], gap[fits]
    order = np.lexsort((lower, gap, upper))
    upper, lower = upper[order], lower[order]
    below = np.full(loops.n_loops, -1, np.int64)
    first = np.diff(upper, prepend=-1) > 0
    below[upper[first]] = lower[first]
    return below
