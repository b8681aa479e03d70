"""Offset rings with mitered corners, for whole stacks at once.

Each edge is moved along its normal, and neighbours are extended or shortened to their intersection. Rings that are
moved too far change direction or cross themselves; a union with the positive fill rule removes these parts. Some
inner corners are not joined: those that turn by more than 60°, and those with an edge that would be shortened by more
than its length. There the outline passes through the original corner, so that the excess forms loops in the wrong
direction. (Clipper2 does this at all inner corners, which makes a crossing at every point of a curve.)
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, next_in_ring
from printer_slicer.geometry.polygons import MITER_LIMIT

__all__ = ["miter_rings"]

# Cosine of the largest turn at which inner corners are joined, if their edges are long enough.
_GENTLE: Final = 0.5
# Cosine of a turn after which the outline runs back along itself: a tip, whichever side it turns to.
_BACK: Final = -0.999


class _Corners(NamedTuple):
    """Corners of rings.

    Attributes:
        before: direction of the previous edge, x (N,) and y (N,).
        after: direction of the next edge, x (N,) and y (N,).
        cosine: (N,) cosine of the turn.
        sine: (N,) sine of the turn.
        length: (N,) length of the next edge.
    """

    before: tuple[Float, Float]
    after: tuple[Float, Float]
    cosine: Float
    sine: Float
    length: Float


def miter_rings(xy: Int, start: Int, distance: Float, limit: float = MITER_LIMIT) -> tuple[Int, Int]:
    """Move rings outward, to their right, and extend their corners to points.

    Args:
        xy: (N, 2) grid steps.
        start: (R + 1,) offset of each ring, and the end of the last one.
        distance: (R,) grid steps, not 0; inward if negative.
        limit: corners with a point farther away than this many distances are cut off square.

    Returns:
        Points (n, 2) in grid steps, and the offset (R + 1,) of each ring. The rings may cross themselves and each
        other. Rings without area have no points.
    """
    following = next_in_ring(start)
    new = np.flatnonzero((xy[:, 0] != xy[:, 0].take(following)) | (xy[:, 1] != xy[:, 1].take(following)))
    if len(new) < len(xy):
        xy, start = xy.take(new, axis=0), np.searchsorted(new, start)
        following = next_in_ring(start)
    x, y = xy.T.astype(np.float64)
    by = np.repeat(distance, np.diff(start))
    corners = _measure_corners((x, y), following)
    outer = (corners.sine * by >= 0) | (corners.cosine <= _BACK)
    cut = outer & (limit**2 * (1 + corners.cosine) <= 2)
    through = ~outer & ((corners.cosine < _GENTLE) | _has_vanishing_edge(corners, by, cut, following))
    count = 1 + cut + 2 * through
    end = np.cumsum(count)
    share = by / (1 + np.maximum(corners.cosine, _BACK))
    (vx, vy), (ux, uy) = corners.before, corners.after
    moved = np.zeros((len(end) + int((count - 1).sum()), 2))
    moved[end - count] = np.column_stack([x + (uy + vy) * share, y - (ux + vx) * share])
    for which, build in ((cut, _cut_off_corner), (through, _pass_through_corner)):
        some = np.flatnonzero(which)
        for place, points in enumerate(build(corners, some, by.take(some))):
            moved[end[some] - count[some] + place] = xy.take(some, axis=0) + np.column_stack(points)
    return np.rint(moved).astype(np.int64), np.append(0, end).take(start)


def _measure_corners(points: tuple[Float, Float], following: Int) -> _Corners:
    """Compute directions, turns and edge lengths from x (N,) and y (N,) of the points."""
    ux, uy = (column.take(following) - column for column in points)
    length = np.sqrt(ux * ux + uy * uy)
    ux, uy = ux / length, uy / length
    vx, vy = np.zeros((2, len(ux)))
    vx[following], vy[following] = ux, uy
    return _Corners((vx, vy), (ux, uy), vx * ux + vy * uy, vx * uy - vy * ux, length)


def _has_vanishing_edge(corners: _Corners, by: Float, cut: Bool, following: Int) -> Bool:
    """Return a mask (N,) of corners at an edge that would be shortened by more than its length."""
    # A turn to the left lengthens both of its edges by the distance times the tangent of half the turn.
    gained = by * np.where(cut, 0.0, corners.sine / (1 + np.maximum(corners.cosine, _BACK)))
    short = corners.length + gained + gained.take(following) < 0
    result = short.copy()
    result[following] |= short
    return result


_Points = tuple[tuple[Float, Float], ...]


def _cut_off_corner(corners: _Corners, indices: Int, by: Float) -> _Points:
    """Return both ends of the side that cuts off a corner at distance `by`, relative to the corner."""
    (vx, vy), (ux, uy) = (
        tuple(column.take(indices) for column in direction) for direction in (corners.before, corners.after)
    )
    out_x, out_y = vx - ux, vy - uy
    size = np.hypot(out_x, out_y) / np.abs(by)
    out_x, out_y = out_x / size, out_y / size
    # With the functions that the kernel calls; those of numpy may round otherwise.
    cosine = np.clip(corners.cosine.take(indices), -1, 1).tolist()
    half = np.array([math.tan(math.acos(one) / 4) for one in cosine]) * np.sign(by)
    return (out_x + out_y * half, out_y - out_x * half), (out_x - out_y * half, out_y + out_x * half)


def _pass_through_corner(corners: _Corners, indices: Int, by: Float) -> _Points:
    """Return the end of the previous edge, the corner, and the start of the next edge, relative to the corner."""
    (vx, vy), (ux, uy) = (
        tuple(column.take(indices) for column in direction) for direction in (corners.before, corners.after)
    )
    return (vy * by, -vx * by), (0 * by, 0 * by), (uy * by, -ux * by)
