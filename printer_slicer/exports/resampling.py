"""Smooth and resample contours within a proven bound of the original.

`smooth` and `resample` guarantee for each ring, and so for the contours of a layer:

- The Hausdorff distance between the old and the new ring is at most `bound`.
- No ring is lost, inverted, or made to cross or touch itself or another ring. The nesting of the rings stays the same.

Proof for moved points. Every point p of a ring moves by at most r(p) <= bound. A point on an edge moves with a fixed
mix of both ends, so by no more than the larger of the two. This pairs old and new points, in both directions, within
the bound. If another ring is at distance d from an edge, both ends of the edge move by less than d / 2, and so do those
of the other ring. So the rings never meet during the move, and their nesting (the winding number of one about any point
of the other) cannot change. Self-intersection is checked afterwards: the points of edges that meet, and all points of a
ring whose area changed its sign, move back, until no moved edge meets another. Each round moves at least one point
back, so it ends.

Proof for removed points. The remaining points lie on the old ring. Between two of them an arc of the old ring is
replaced by a chord, but only if all corners of the arc are within r <= bound of the chord. The set of points within r
of a segment is convex, so it contains the whole arc. The arc runs from one end of the chord to the other, so each point
of the chord is the projection of a point of the arc within r. The convex hull of both is within 2 r of the arc.
If another ring is at distance d from the arc, r < d / 4 on both sides: the hulls do not meet, and neither do the rings
while arcs become chords inside them. If chords of a ring meet, their arcs get their points back, and so does a ring
whose area changed its sign.

Sources: Desbrun, Meyer, Schröder & Barr, Implicit fairing of irregular meshes using diffusion and curvature flow,
1999 (the mean weighted towards nearer neighbours); Douglas & Peucker, Algorithms for the reduction of the number of
points required to represent a digitized line or its caricature, 1973.
"""

from __future__ import annotations

from math import isfinite
from typing import Final

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, consecutive
from printer_slicer.errors import UsageError
from printer_slicer.exports.ring_clearance import find_ring_contacts, measure_clearance
from printer_slicer.geometry import Areas
from printer_slicer.geometry.segment_index import distance_to_segments

__all__ = ["resample", "smooth"]

_MOVED: Final = 0.9  # fraction of the bound for moving points; the rest is for removing points
_PASSES: Final = 8  # number of smoothing passes
_STEP_FRACTION: Final = 0.6  # of the distance to the mean of its neighbours, per pass
# Spacing of the points added beside a corner, in bounds; a right angle becomes three turns of 24 to 48 degrees.
_STEP: Final = 0.75
_MOVE_FRACTION: Final = 0.49  # of the distance to another ring: how far a point may move
_CHORD_FRACTION: Final = 0.24  # of the distance to another ring: how far a chord may deviate
_STILL: Final = 1e-9  # mm; less than this is rounding
_MAX_POINTS: Final = 20_000_000


def smooth(areas: Areas, bound: float) -> Areas:
    """Smooth contours; old and new contours are at most `bound` mm apart.

    Points are added beside corners, all points move toward the mean of their neighbours within the bound, and added
    points that are not needed are removed. Long straight edges stay in place. Convex shapes become slightly smaller (a
    circle of 1 mm radius with a bound of 0.05 mm: by 0.0025 mm). Where the bound or another contour allows no movement,
    the contour stays unchanged. See the module docstring for the proof.

    Args:
        areas: clean areas.
        bound: mm, over 0.

    Raises:
        UsageError: the bound is not over 0.
    """
    if not (bound > 0 and isfinite(bound)):
        raise UsageError(
            f"a contour cannot be smoothed within {bound:g} mm", remedy="Choose a bound greater than 0"
        )
    if not areas.n_rings:
        return areas
    refined, original = _add_corner_points(areas, _STEP * bound, _PASSES)
    moved = _move_points(refined, _MOVED * bound)
    # Points added on an edge that did not move are not needed.
    still = (moved.xy == refined.xy).all(axis=1)
    around = still[refined.following] & still & still[refined.previous]
    keep = original | ~around
    kept = _select_points(moved, keep)
    # Points that did not move keep the straight edges between them in place.
    return _select_points(kept, _mark_needed_points(kept, original[keep] | still[keep], (1 - _MOVED) * bound))


def resample(areas: Areas, spacing: float, bound: float) -> Areas:
    """Resample contours to points at most `spacing` mm apart; old and new contours are at most `bound` mm apart.

    Corners that the bound requires stay; between them the points lie on the old contour at equal distances. With a
    bound of 0 the contour is the same line with more points. See the module docstring for the proof.

    Args:
        areas: clean areas.
        spacing: mm, over 0; inf: only remove points that are not needed.
        bound: mm, 0 or more.

    Raises:
        UsageError: the spacing is not over 0 or needs more than 20 million points, or the bound is under 0.
    """
    if not spacing > 0:
        raise UsageError(f"points cannot be {spacing:g} mm apart", remedy="Choose a distance greater than 0")
    if not (bound >= 0 and isfinite(bound)):
        raise UsageError(
            f"a contour cannot be resampled within {bound:g} mm", remedy="Choose a bound of 0 or more"
        )
    if not areas.n_rings:
        return areas
    if float(areas.ring_length().sum()) / spacing > _MAX_POINTS:
        raise UsageError(
            f"a distance of {spacing:g} mm between points gives more than {_MAX_POINTS // 10**6} million points",
            remedy="Choose a larger distance",
        )
    corners = _mark_needed_points(areas, _mark_ring_thirds(areas), bound)
    dense, chosen = _add_spaced_points(areas, corners, spacing)
    return _select_points(dense, _mark_needed_points(dense, chosen, bound))


def _measure_edges(areas: Areas) -> Float:
    """Return the length (N,) of each edge, mm."""
    return np.asarray(np.hypot(*(areas.xy[areas.following] - areas.xy).T))


def _select_points(areas: Areas, keep: Bool) -> Areas:
    """Return the stack with only the points for which `keep` (N,) is true, at least three per ring."""
    count = np.add.reduceat(keep, areas.ring_start[:-1], dtype=np.int64)
    return Areas(areas.xy[keep], np.append(0, np.cumsum(count)), areas.ring_layer, areas.n_layers)


def _add_points(areas: Areas, edge: Int, share: Float) -> tuple[Areas, Bool]:
    """Add points on edges; return the new contours, and a mask (N + P,) of the points that existed before.

    Args:
        areas: the contours.
        edge: (P,) edge of each new point, ascending.
        share: (P,) fraction of the edge's length from its first point, 0 to 1, ascending on each edge.
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


def _add_corner_points(areas: Areas, step: float, reach: int) -> tuple[Areas, Bool]:
    """Add `reach` points, `step` mm apart, on both sides of each corner; also return a mask of the earlier points.

    Edges that are too short for all these points are divided evenly.
    """
    length = _measure_edges(areas)
    short = length <= 2 * reach * step
    count = np.where(short, np.maximum(np.ceil(length / step) - 1, 0), 2 * reach).astype(np.int64)
    edge = np.repeat(np.arange(len(length)), count)
    number = consecutive(np.zeros_like(count), count) + 1
    even = number / (count[edge] + 1)
    one = step / np.maximum(length[edge], step)
    ends = np.where(number <= reach, number * one, 1 - (2 * reach + 1 - number) * one)
    return _add_points(areas, edge, np.where(short[edge], even, ends))


def _move_points(areas: Areas, bound: float) -> Areas:
    """Move points by at most `bound` mm to smooth rings, so that no ring meets itself or another ring."""
    room = measure_clearance(areas, bound / _MOVE_FRACTION)
    limit = np.minimum(bound, _MOVE_FRACTION * np.minimum(room, room[areas.previous]))
    step = _compute_displacement(areas, limit)
    sign = np.sign(areas.ring_area())
    sizes = np.diff(areas.ring_start)
    check = np.ones(areas.n_rings, np.bool_)
    while check.any():
        moved = Areas(areas.xy + step, areas.ring_start, areas.ring_layer, areas.n_layers)
        back = np.repeat(np.sign(moved.ring_area()) != sign, sizes)
        index = np.flatnonzero(np.repeat(check, sizes))
        for edge in find_ring_contacts(moved.select(check)):
            back[index[edge]] = True
            back[areas.following[index[edge]]] = True
        back &= (step != 0).any(axis=1)
        step[back] = 0.0
        check = np.logical_or.reduceat(back, areas.ring_start[:-1])
    return Areas(areas.xy + step, areas.ring_start, areas.ring_layer, areas.n_layers)


def _compute_displacement(areas: Areas, limit: Float) -> Float:
    """Return the displacement (N, 2) of each point, mm, at most `limit` (N,) long.

    In each pass a point moves toward the mean of its neighbours, weighted towards the nearer one. Points on a straight
    line do not move, and convex shapes stay convex. A filter with backward steps, which keeps the size of circles, left
    bumps of a third of the rounding beside each corner.
    """
    following, previous = areas.following, areas.previous
    weight = 1.0 / np.maximum(_measure_edges(areas), _STILL)
    share = weight / (weight + weight[previous])
    rest = 1 - share
    columns = [np.ascontiguousarray(column) for column in areas.xy.T]
    steps = [np.zeros(len(areas.xy)), np.zeros(len(areas.xy))]
    for _ in range(_PASSES):
        for axis, column in enumerate(columns):
            here = column + steps[axis]
            steps[axis] += _STEP_FRACTION * (share * here[following] + rest * here[previous] - here)
        held = np.minimum(1.0, limit / np.maximum(np.hypot(*steps), _STILL))
        steps = [step * held for step in steps]
    moved = np.stack(steps, axis=1)
    moved[np.hypot(*steps) < _STILL] = 0.0
    return moved


# Removing points


def _mark_ring_thirds(areas: Areas) -> Bool:
    """Return a mask (N,) of three points of each ring: the first, and the points one third and two thirds around it."""
    chosen = np.zeros(len(areas.xy), np.bool_)
    start, sizes = areas.ring_start[:-1], np.diff(areas.ring_start)
    for third in range(3):
        chosen[start + third * sizes // 3] = True
    return chosen


def _mark_needed_points(areas: Areas, chosen: Bool, bound: float) -> Bool:
    """Return a mask (N,) of points to keep: the chosen points, and all points that valid chords need.

    A chord is valid if it is close enough to its arc and meets no other.

    Args:
        areas: the contours.
        chosen: (N,) mask of points that stay: the first and at least two more of each ring.
        bound: mm.
    """
    tolerance = np.minimum(
        bound, _CHORD_FRACTION * measure_clearance(areas, max(bound / _CHORD_FRACTION, _STILL))
    )
    chosen = _keep_farthest_corners(areas, chosen, tolerance)
    sign, sizes = np.sign(areas.ring_area()), np.diff(areas.ring_start)
    check = np.logical_or.reduceat(~chosen, areas.ring_start[:-1])
    while check.any():
        made = _select_points(areas, chosen)
        arc = np.cumsum(chosen) - 1  # the chord that replaces each old edge
        back = np.repeat(np.sign(made.ring_area()) != sign, sizes)
        index = np.flatnonzero(np.repeat(check, np.diff(made.ring_start)))
        for chord in find_ring_contacts(made.select(check)):
            back |= np.bincount(index[chord], minlength=len(made.xy))[arc] > 0
        back &= ~chosen
        chosen = chosen | back
        check = np.logical_or.reduceat(back, areas.ring_start[:-1])
    return chosen


def _keep_farthest_corners(areas: Areas, chosen: Bool, tolerance: Float) -> Bool:
    """Extend the mask of points to keep (N,) until every chord is within `tolerance` (N,) of the edges it replaces.

    Starting from the chosen points, add the farthest corner of each arc that is too far from its chord, until none is.
    """
    chosen = chosen.copy()
    ring_end = np.repeat(areas.ring_start[1:], np.diff(areas.ring_start))
    first = np.repeat(areas.ring_start[:-1], np.diff(areas.ring_start))
    open_ = np.flatnonzero(~chosen)
    while len(open_):
        ends = np.flatnonzero(chosen)
        least = np.minimum.reduceat(tolerance, ends)
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


def _add_spaced_points(areas: Areas, corners: Bool, spacing: float) -> tuple[Areas, Bool]:
    """Add equally spaced points between corners, at most `spacing` mm apart; also return a mask of chosen points."""
    length = _measure_edges(areas)
    ends = np.flatnonzero(corners)
    along = np.cumsum(length) - length  # mm of contour before each point, counted through all rings
    arc = np.add.reduceat(length, ends)
    count = np.maximum(np.ceil(arc / spacing - _STILL), 1).astype(np.int64) - 1
    which = np.repeat(np.arange(len(ends)), count)
    number = consecutive(np.zeros_like(count), count) + 1
    place = along[ends][which] + arc[which] * number / (count[which] + 1)
    edge = np.searchsorted(along, place, side="right") - 1
    share = np.clip((place - along[edge]) / np.maximum(length[edge], _STILL), 0.0, 1.0)
    dense, original = _add_points(areas, edge, share)
    chosen = np.ones(len(original), np.bool_)
    chosen[original] = corners
    return dense, chosen
