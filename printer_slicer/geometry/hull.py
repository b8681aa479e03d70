"""The convex hull of points."""

from __future__ import annotations

import numpy as np

from printer_slicer.geometry.areas import Areas, Bool, Float

__all__ = ["convex_hull"]

_ROUNDS = 24  # of dropping whole arrays; what is left then is short enough to be walked point by point


def convex_hull(points: Float) -> Areas:
    """The smallest convex area around points (N, 2), as a stack of one layer; empty where they span no area.

    A point to the left of, or on, the line from its neighbour before to its neighbour behind along a lower side is no
    corner, whoever these neighbours are: so all such points can be dropped at once, again and again.

    Source: Andrew, Another efficient algorithm for convex hulls in two dimensions, 1979, for the two sides.
    """
    ordered = points[np.lexsort((points[:, 1], points[:, 0]))]
    # Of equal points one stays: each would see the other as its neighbour, and both would go.
    new = np.append(True, (np.diff(ordered, axis=0) != 0).any(axis=1))[: len(ordered)]
    ordered = ordered[new]
    ring = np.concatenate([_lower(ordered)[:-1], _lower(ordered[::-1])[:-1]])
    return Areas.from_rings([[ring]])


def _lower(points: Float) -> Float:
    """The corners of the side of the hull that runs with the solid to the left from the first point to the last."""
    for _ in range(_ROUNDS):
        keep = np.ones(len(points), np.bool_)
        keep[1:-1] = _turns_left(points[:-2], points[1:-1], points[2:])
        if keep.all():
            return points
        points = points[keep]
    corners: list[Float] = []
    for point in points:
        while len(corners) > 1 and not _turns_left(corners[-2], corners[-1], point):
            corners.pop()
        corners.append(point)
    return np.array(corners)


def _turns_left(a: Float, b: Float, c: Float) -> Bool:
    """Whether the way from `a` over `b` to `c` turns left, of points or of arrays of them."""
    to, on = b - a, c - b
    return np.asarray(to[..., 0] * on[..., 1] - to[..., 1] * on[..., 0] > 0)
