"""Convex hull of points."""

from __future__ import annotations

from typing import Final

import numpy as np

from printer_slicer.arrays import Bool, Float
from printer_slicer.geometry.areas import Areas

__all__ = ["convex_hull"]

_ROUNDING: Final = 2.0**-50  # largest rounding error of a cross product, relative to its two terms


def convex_hull(points: Float) -> Areas:
    """Return the convex hull of points (N, 2) as a stack of one layer; empty if they span no area.

    It begins at its leftmost point, the lowest of several, and has no points on the straight line between others.

    Source: Andrew, Another efficient algorithm for convex hulls in two dimensions, 1979.
    """
    ordered = points[np.lexsort((points[:, 1], points[:, 0]))]
    ordered = ordered[(np.diff(ordered, axis=0, prepend=np.nan) != 0).any(axis=1)]
    lower, upper = _find_right_side(ordered), _find_right_side(ordered[::-1])
    ring = lower[:-1] + upper[:-1]
    return Areas.from_rings([[np.array(ring, np.float64)]]) if len(ring) > 2 else Areas.empty(1)


def _find_right_side(points: Float) -> list[list[float]]:
    """Return the corners of the hull from the first to the last of sorted points (N, 2), on the right of this way."""
    while len(points) > 2:
        unneeded = np.concatenate([[False], _turns_right(points[:-2], points[1:-1], points[2:]), [False]])
        if not unneeded.any():
            break
        points = points[~unneeded]
    corners: list[list[float]] = []
    for point in points.tolist():
        while len(corners) > 1 and not _is_left_turn(corners[-2], corners[-1], point):
            corners.pop()
        corners.append(point)
    return corners


def _turns_right(before: Float, at: Float, after: Float) -> Bool:
    """Return where (n,) the way through three points (n, 2) turns right, by more than rounding errors."""
    (one_x, one_y), (other_x, other_y) = (at - before).T, (after - at).T
    left, right = one_x * other_y, one_y * other_x
    return np.asarray(right - left > _ROUNDING * (np.abs(left) + np.abs(right)))


def _is_left_turn(before: list[float], at: list[float], after: list[float]) -> bool:
    """Return whether the way through three points turns left; exact."""
    left, right = (at[0] - before[0]) * (after[1] - at[1]), (at[1] - before[1]) * (after[0] - at[0])
    if abs(left - right) > _ROUNDING * (abs(left) + abs(right)):
        return left > right
    ratios = [value.as_integer_ratio() for point in (before, at, after) for value in point]
    unit = max(below for _, below in ratios)  # all are powers of two
    ax, ay, bx, by, cx, cy = (above * (unit // below) for above, below in ratios)
    return (bx - ax) * (cy - by) > (by - ay) * (cx - bx)
