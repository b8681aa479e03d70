"""Contours made smoother or sampled anew, each point provably within a bound of where the contour was, and back.

What holds for `smooth` and `resample`, ring by ring, and therefore for the contours of a layer:

- the Hausdorff distance between the old and the new ring is at most `bound`: no point of one is farther from the
  other;
- no ring is lost, turned over, or made to cross or touch itself or another ring; rings lie within each other as
  before.

Why, for points that are moved. Every point p of a ring is moved by at most r(p) <= bound, and a point of an edge
goes with the same share of both ends, so it moves by no more than the greater of the two: this matches old and new
points, in both directions, within the bound. Where another ring is d away from an edge, both ends of the edge are
moved by less than d / 2, and so are those of the other: during the whole move the rings never meet, so which lies
in which, the winding number of one about any point of the other, cannot change. That a ring does not meet itself is
looked up afterwards: points of edges that do, and all points of a ring whose area changed its sign, go back to
where they were, until no edge that was moved meets another. Each round takes back at least one point, so it ends.

Why, for points that are left out. Points that stay lie on the old ring. Between two of them the old ring, an arc,
is replaced by a chord, and only if all corners of the arc are within r <= bound of the chord. The points within r
of a segment are a convex set, so the whole arc is in it; and the arc leads from one end of the chord to the other,
so each point of the chord is the foot of a point of the arc, which is as near. What lies between arc and chord,
their convex hull, is within 2 r of the arc. Where another ring is d away from the arc, r < d / 4 on both sides: the
hulls do not meet, nor do the rings while arcs become chords inside them. Chords of a ring that meet get the points
of their arcs back, and so does a ring whose area changed its sign.

Sources: Desbrun, Meyer, Schröder & Barr, Implicit fairing of irregular meshes using diffusion and curvature flow,
1999 (the mean that counts nearer neighbours more); Douglas & Peucker, Algorithms for the reduction of the number of
points required to represent a digitized line or its caricature, 1973.
"""

from __future__ import annotations

from math import isfinite
from typing import Final

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, consecutive
from printer_slicer.errors import UsageError
from printer_slicer.exports.ring_clearance import clearance, contacts
from printer_slicer.geometry import Areas
from printer_slicer.geometry.segment_index import distance_to_segments

__all__ = ["resample", "smooth"]

_MOVED: Final = 0.9  # share of the bound for moving points; the rest is for leaving points out
_PASSES: Final = 8  # of the filter
_WAY: Final = 0.6  # how far a point goes toward the mean of its neighbours in one pass
# Bounds between the points put beside a corner; a right angle becomes three turns of 24 to 48 degrees.
_STEP: Final = 0.75
_HALF: Final = 0.49  # of the distance to another ring that a point may be moved
_QUARTER: Final = 0.24  # of the distance to another ring that a chord may be off
_STILL: Final = 1e-9  # mm; less than this is rounding
_MOST_POINTS: Final = 20_000_000


def smooth(areas: Areas, bound: float) -> Areas:
    """The areas with smoother contours, nowhere farther than `bound` mm from the old ones, nor those from them.

    Points are put beside corners, all are moved toward the mean of their neighbours, held to the bound, and points
    that were put in but are not needed are left out again. Long straight edges stay where they are; what is convex
    becomes a little smaller (a circle of 1 mm radius within 0.05 mm: by 0.0025 mm). Where the bound or another
    contour leaves no room, the contour stays as it is. The module's text has the proof.

    Args:
        areas: clean areas.
        bound: mm, over 0.

    Raises:
        UsageError: a bound that is not over 0.
    """
    if not (bound > 0 and isfinite(bound)):
        raise UsageError(f"a contour cannot be smoothed within {bound:g} mm", remedy="Choose a bound over 0")
    if not areas.n_rings:
        return areas
    refined, original = _refined(areas, _STEP * bound, _PASSES)
    moved = _filtered(refined, _MOVED * bound)
    # Points that were put on an edge which did not move are not needed.
    still = (moved.xy == refined.xy).all(axis=1)
    around = still[refined.following] & still & still[refined.previous]
    keep = original | ~around
    kept = _only(moved, keep)
    # Points that did not move hold the straight edges between them in place.
    return _only(kept, _needed(kept, original[keep] | still[keep], (1 - _MOVED) * bound))


def resample(areas: Areas, spacing: float, bound: float) -> Areas:
    """The areas with points at most `spacing` mm apart along the contour, at no place farther than `bound` mm off.

    Corners that cannot be left out within the bound stay; between them the points lie on the old contour at equal
    distances. With a bound of 0 the contour is the same line, with more points. The module's text has the proof.

    Args:
        areas: clean areas.
        spacing: mm, over 0; inf: leave out what is not needed and put nothing in.
        bound: mm, 0 or more.

    Raises:
        UsageError: a spacing that is not over 0 or takes more than 20 million points, or a bound under 0.
    """
    if not spacing > 0:
        raise UsageError(f"points cannot be {spacing:g} mm apart", remedy="Choose a distance over 0")
    if not (bound >= 0 and isfinite(bound)):
        raise UsageError(
            f"a contour cannot be sampled within {bound:g} mm", remedy="Choose a bound of 0 or more"
        )
    if not areas.n_rings:
        return areas
    if float(areas.ring_length().sum()) / spacing > _MOST_POINTS:
        raise UsageError(
            f"points {spacing:g} mm apart are more than {_MOST_POINTS // 10**6} million",
            remedy="Choose a larger distance",
        )
    corners = _needed(areas, _thirds(areas), bound)
    dense, chosen = _spaced(areas, corners, spacing)
    return _only(dense, _needed(dense, chosen, bound))


def _edge_lengths(areas: Areas) -> Float:
    """(N,) mm."""
    return np.asarray(np.hypot(*(areas.xy[areas.following] - areas.xy).T))


def _only(areas: Areas, keep: Bool) -> Areas:
    """The stack with only the points for which `keep` is true; at least three of each ring must be."""
    count = np.add.reduceat(keep, areas.ring_start[:-1], dtype=np.int64)
    return Areas(areas.xy[keep], np.append(0, np.cumsum(count)), areas.ring_layer, areas.n_layers)


def _with_points(areas: Areas, edge: Int, share: Float) -> tuple[Areas, Bool]:
    """The same contours with points put on edges, and (N + P,) which points were there before.

    Args:
        areas: the contours.
        edge: (P,) ascending.
        share: (P,) of the edge's length from its first point, ascending on each edge, between 0 and 1.
    """
    begin, end = areas.xy[edge], areas.xy[areas.following[edge]]
    put = begin + share[:, None] * (end - begin)
    n_put = np.bincount(edge, minlength=len(areas.xy))
    before = np.cumsum(n_put) - n_put
    old = np.arange(len(areas.xy)) + before
    original = np.zeros(len(areas.xy) + len(edge), np.bool_)
    original[old] = True
    xy = np.zeros((len(original), 2))
    xy[original], xy[~original] = areas.xy, put
    start = np.append(old, len(original))[areas.ring_start]
    return Areas(xy, start, areas.ring_layer, areas.n_layers), original


# Moving points


def _refined(areas: Areas, step: float, reach: int) -> tuple[Areas, Bool]:
    """The contours with `reach` points, `step` mm apart, on both sides of each corner; which points were there before.

    Edges with no room for so many are divided evenly.
    """
    length = _edge_lengths(areas)
    short = length <= 2 * reach * step
    count = np.where(short, np.maximum(np.ceil(length / step) - 1, 0), 2 * reach).astype(np.int64)
    edge = np.repeat(np.arange(len(length)), count)
    number = consecutive(np.zeros_like(count), count) + 1
    even = number / (count[edge] + 1)
    one = step / np.maximum(length[edge], step)
    ends = np.where(number <= reach, number * one, 1 - (2 * reach + 1 - number) * one)
    return _with_points(areas, edge, np.where(short[edge], even, ends))


def _filtered(areas: Areas, bound: float) -> Areas:
    """The contours with their points moved by at most `bound` mm and no ring meeting itself or another."""
    room = clearance(areas, bound / _HALF)
    most = np.minimum(bound, _HALF * np.minimum(room, room[areas.previous]))
    step = _smoothing(areas, most)
    sign = np.sign(areas.ring_area())
    sizes = np.diff(areas.ring_start)
    check = np.ones(areas.n_rings, np.bool_)
    while check.any():
        moved = Areas(areas.xy + step, areas.ring_start, areas.ring_layer, areas.n_layers)
        back = np.repeat(np.sign(moved.ring_area()) != sign, sizes)
        index = np.flatnonzero(np.repeat(check, sizes))
        for edge in contacts(moved.select(check)):
            back[index[edge]] = True
            back[areas.following[index[edge]]] = True
        back &= (step != 0).any(axis=1)
        step[back] = 0.0
        check = np.logical_or.reduceat(back, areas.ring_start[:-1])
    return Areas(areas.xy + step, areas.ring_start, areas.ring_layer, areas.n_layers)


def _smoothing(areas: Areas, most: Float) -> Float:
    """(N, 2) mm by which each point is moved, at most by `most` (N,).

    Each point goes some way toward the mean of its neighbours, the nearer one counting more, again and again. On a
    straight line no point moves, and what is convex stays convex; a filter that also takes steps back, to keep the
    size of circles, was tried and left bumps of a third of the rounding beside each corner.
    """
    following, previous = areas.following, areas.previous
    weight = 1.0 / np.maximum(_edge_lengths(areas), _STILL)
    share = weight / (weight + weight[previous])
    rest = 1 - share
    columns = [np.ascontiguousarray(column) for column in areas.xy.T]
    steps = [np.zeros(len(areas.xy)), np.zeros(len(areas.xy))]
    for _ in range(_PASSES):
        for axis, column in enumerate(columns):
            here = column + steps[axis]
            steps[axis] += _WAY * (share * here[following] + rest * here[previous] - here)
        held = np.minimum(1.0, most / np.maximum(np.hypot(*steps), _STILL))
        steps = [step * held for step in steps]
    moved = np.stack(steps, axis=1)
    moved[np.hypot(*steps) < _STILL] = 0.0
    return moved


# Leaving points out


def _thirds(areas: Areas) -> Bool:
    """(N,) the first point of each ring and those a third and two thirds of its points later."""
    chosen = np.zeros(len(areas.xy), np.bool_)
    start, sizes = areas.ring_start[:-1], np.diff(areas.ring_start)
    for third in range(3):
        chosen[start + third * sizes // 3] = True
    return chosen


def _needed(areas: Areas, chosen: Bool, bound: float) -> Bool:
    """(N,) the chosen points and those without which a chord would be too far from its arc or meet another.

    Args:
        areas: the contours.
        chosen: (N,) points that stay: the first of each ring and two more at least.
        bound: mm.
    """
    room = np.minimum(bound, _QUARTER * clearance(areas, max(bound / _QUARTER, _STILL)))
    chosen = _within(areas, chosen, room)
    sign, sizes = np.sign(areas.ring_area()), np.diff(areas.ring_start)
    check = np.logical_or.reduceat(~chosen, areas.ring_start[:-1])
    while check.any():
        made = _only(areas, chosen)
        arc = np.cumsum(chosen) - 1  # which chord each old edge has become a part of
        back = np.repeat(np.sign(made.ring_area()) != sign, sizes)
        index = np.flatnonzero(np.repeat(check, np.diff(made.ring_start)))
        for chord in contacts(made.select(check)):
            back |= np.bincount(index[chord], minlength=len(made.xy))[arc] > 0
        back &= ~chosen
        chosen = chosen | back
        check = np.logical_or.reduceat(back, areas.ring_start[:-1])
    return chosen


def _within(areas: Areas, chosen: Bool, room: Float) -> Bool:
    """(N,) the chosen points and as many as it takes for every chord to be within `room` (N,) of each edge it replaces.

    Of each arc that is too far from its chord the farthest corner is chosen too, until none is.
    """
    chosen = chosen.copy()
    ring_end = np.repeat(areas.ring_start[1:], np.diff(areas.ring_start))
    first = np.repeat(areas.ring_start[:-1], np.diff(areas.ring_start))
    open_ = np.flatnonzero(~chosen)
    while len(open_):
        ends = np.flatnonzero(chosen)
        least = np.minimum.reduceat(room, ends)
        arc = np.searchsorted(ends, open_, side="right") - 1
        begin = ends[arc]
        after = np.append(ends, len(areas.xy))[arc + 1]
        after = np.where(after < ring_end[begin], after, first[begin])
        far = distance_to_segments(areas.xy[open_], areas.xy[begin], areas.xy[after])
        fails = np.zeros(len(ends), np.bool_)
        fails[arc[far > np.maximum(least[arc], _STILL)]] = True
        left = fails[arc]
        open_, arc, far = open_[left], arc[left], far[left]
        order = np.lexsort((far, arc))
        farthest = order[np.diff(arc[order], append=-1) != 0]
        chosen[open_[farthest]] = True
        open_ = np.delete(open_, farthest)
    return chosen


def _spaced(areas: Areas, corners: Bool, spacing: float) -> tuple[Areas, Bool]:
    """The contours with points at equal distances between corners, at most `spacing` mm, and which points to choose."""
    length = _edge_lengths(areas)
    ends = np.flatnonzero(corners)
    along = np.cumsum(length) - length  # mm of contour before each point, through all rings
    arc = np.add.reduceat(length, ends)
    count = np.maximum(np.ceil(arc / spacing - _STILL), 1).astype(np.int64) - 1
    which = np.repeat(np.arange(len(ends)), count)
    number = consecutive(np.zeros_like(count), count) + 1
    place = along[ends][which] + arc[which] * number / (count[which] + 1)
    edge = np.searchsorted(along, place, side="right") - 1
    share = np.clip((place - along[edge]) / np.maximum(length[edge], _STILL), 0.0, 1.0)
    dense, original = _with_points(areas, edge, share)
    chosen = np.ones(len(original), np.bool_)
    chosen[original] = corners
    return dense, chosen
