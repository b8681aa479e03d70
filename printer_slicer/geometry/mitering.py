"""Outlines moved to the side, corner by corner, for whole stacks at once.

Each edge is moved along its normal, and neighbours are prolonged or shortened to where they meet. What is left of
rings that are moved too far runs around the wrong way, or crosses itself: the positive rule of a union takes it away.
Inner corners of more than 60°, and all where an edge would be shortened by more than its length, are not joined but led
through the corner they come from, so that what is too much forms loops the wrong way round. (Clipper2 does that at all
inner corners, which makes a crossing of every point of a curve.)
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, next_in_ring
from printer_slicer.geometry.polygons import MITER_LIMIT

__all__ = ["miter_rings"]

_ROUND: Final = (
    0.5  # cosine of the turn up to which inner corners are joined where their edges are long enough
)
_BACK: Final = (
    -0.999
)  # of one after which the outline goes back where it came from: a tip, to whichever side it turns


class _Corners(NamedTuple):
    """Corners (N,): directions of the edges before and after, cosine and sine of the turn, length of the edge after."""

    before: tuple[Float, Float]
    after: tuple[Float, Float]
    cosine: Float
    sine: Float
    length: Float


def miter_rings(xy: Int, start: Int, distance: Float, limit: float = MITER_LIMIT) -> tuple[Int, Int]:
    """Rings moved outward, which is to the right, with their corners prolonged to points.

    Args:
        xy: (N, 2) steps of the grid.
        start: (R + 1,) where each ring begins, and the end of the last.
        distance: (R,) steps, not 0; inward if negative.
        limit: corners with a point farther away than this many distances are cut off square.

    Returns:
        (n, 2) steps, and (R + 1,) where each ring begins: rings that may cross themselves and each other. Rings without
        area have no points.
    """
    following = next_in_ring(start)
    new = np.flatnonzero((xy[:, 0] != xy[:, 0].take(following)) | (xy[:, 1] != xy[:, 1].take(following)))
    if len(new) < len(xy):
        xy, start = xy.take(new, axis=0), np.searchsorted(new, start)
        following = next_in_ring(start)
    x, y = xy.T.astype(np.float64)
    by = np.repeat(distance, np.diff(start))
    corners = _corners((x, y), following)
    outer = (corners.sine * by >= 0) | (corners.cosine <= _BACK)
    cut = outer & (limit**2 * (1 + corners.cosine) <= 2)
    led = ~outer & ((corners.cosine < _ROUND) | _swallowed(corners, by, cut, following))
    count = 1 + cut + 2 * led
    end = np.cumsum(count)
    share = by / (1 + np.maximum(corners.cosine, _BACK))
    (vx, vy), (ux, uy) = corners.before, corners.after
    moved = np.zeros((len(end) + int((count - 1).sum()), 2))
    moved[end - count] = np.column_stack([x + (uy + vy) * share, y - (ux + vx) * share])
    for which, build in ((cut, _cut_off), (led, _led_through)):
        some = np.flatnonzero(which)
        for place, points in enumerate(build(corners, some, by.take(some))):
            moved[end[some] - count[some] + place] = xy.take(some, axis=0) + np.column_stack(points)
    return np.rint(moved).astype(np.int64), np.append(0, end).take(start)


def _corners(points: tuple[Float, Float], following: Int) -> _Corners:
    ux, uy = (column.take(following) - column for column in points)
    length = np.sqrt(ux * ux + uy * uy)
    ux, uy = ux / length, uy / length
    vx, vy = np.zeros((2, len(ux)))
    vx[following], vy[following] = ux, uy
    return _Corners((vx, vy), (ux, uy), vx * ux + vy * uy, vx * uy - vy * ux, length)


def _swallowed(corners: _Corners, by: Float, cut: Bool, following: Int) -> Bool:
    """(N,) corners at an edge that would be shortened by more than its length."""
    # A turn to the left gives both of its edges the tangent of half of it times the distance.
    gained = by * np.where(cut, 0.0, corners.sine / (1 + np.maximum(corners.cosine, _BACK)))
    short = corners.length + gained + gained.take(following) < 0
    result = short.copy()
    result[following] |= short
    return result


_Points = tuple[tuple[Float, Float], ...]


def _cut_off(corners: _Corners, some: Int, by: Float) -> _Points:
    """Both ends of the side that cuts a corner off at the distance, seen from the corner."""
    (vx, vy), (ux, uy) = (
        tuple(column.take(some) for column in way) for way in (corners.before, corners.after)
    )
    out_x, out_y = vx - ux, vy - uy
    size = np.hypot(out_x, out_y) / np.abs(by)
    out_x, out_y = out_x / size, out_y / size
    half = np.tan(np.arccos(np.clip(corners.cosine.take(some), -1, 1)) / 4) * np.sign(by)
    return (out_x + out_y * half, out_y - out_x * half), (out_x - out_y * half, out_y + out_x * half)


def _led_through(corners: _Corners, some: Int, by: Float) -> _Points:
    """The end of the edge before, the corner itself, and the beginning of the edge after, seen from the corner."""
    (vx, vy), (ux, uy) = (
        tuple(column.take(some) for column in way) for way in (corners.before, corners.after)
    )
    return (vy * by, -vx * by), (0 * by, 0 * by), (uy * by, -ux * by)
