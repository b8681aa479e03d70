"""Facets from the polygons that OBJ, PLY and OFF files are made of."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Final

import numpy as np

from printer_slicer.mesh_io.limits import check_facets

if TYPE_CHECKING:
    from pathlib import Path

    from printer_slicer.arrays import Float, Int
    from printer_slicer.mesh_io.limits import Limits

__all__ = ["triangulate_polygons", "whole"]

MOST_CORNERS: Final = 64
"""Polygons of more corners, where they are not convex, are fans from their first corner: others are not tried."""
BLOCK: Final = 1 << 16
"""Corners of polygons looked at together."""
AGAINST: Final = -1e-9
"""A facet that faces against its polygon by more than this share of it is folded over its neighbours."""


def whole(values: Float) -> Int:
    """Whole numbers as they come out of a text.

    Raises:
        ValueError: one is none.
    """
    if not (np.abs(values) < 1 << 53).all() or not (values == np.rint(values)).all():
        raise ValueError("a vertex number is not a whole number")
    numbers: Int = values.astype(np.int64)
    return numbers


def triangulate_polygons(vertices: Float, counts: Int, corners: Int, path: Path, limits: Limits) -> Float:
    """(T, 3, 3) corners of the facets that polygons are cut into, in their order.

    A polygon is cut into a fan from its first corner. Where that folds, since the polygon is not convex, the corner
    whose fan has the least area is taken: the polygon itself, wherever one of its corners sees all of it. Polygons of
    less than three corners have no facets.

    Args:
        vertices: (V, 3).
        counts: (P,) corners of each polygon.
        corners: (sum of counts,) indices of their vertices.
        path: for messages.
        limits: of the number of facets.

    Raises:
        MeshError: too many facets.
        ValueError: a vertex that there is not.
    """
    if len(corners) and not (corners.min() >= 0 and corners.max() < len(vertices)):
        wrong = int(np.flatnonzero((corners < 0) | (corners >= len(vertices)))[0])
        polygon = int(np.searchsorted(np.cumsum(counts), wrong, side="right"))
        raise ValueError(f"face {polygon + 1} uses vertex {corners[wrong]} of {len(vertices)}")
    if len(counts) and (counts == 3).all():
        check_facets(len(counts), path, limits)
        return np.asarray(vertices[corners.reshape(-1, 3)])
    begin = np.cumsum(counts) - counts
    counts, begin = counts[counts >= 3], begin[counts >= 3]
    n_facets = counts - 2
    check_facets(int(n_facets.sum()), path, limits)
    first = np.cumsum(n_facets) - n_facets
    triangles = np.zeros((int(n_facets.sum()), 3, 3))
    by_size = np.argsort(counts, kind="stable")
    ends = np.flatnonzero(np.diff(counts[by_size], prepend=-1, append=-1))
    for start, end in pairwise(ends.tolist()):
        size = int(counts[by_size[start]])
        step = max(BLOCK // size, 1)
        for at in range(start, end, step):
            rows = by_size[at : min(at + step, end)]
            points = vertices[corners[begin[rows, None] + np.arange(size)]]
            triangles[first[rows, None] + np.arange(size - 2)] = _fans(points)
    return triangles


def _fans(points: Float) -> Float:
    """(P, N - 2, 3, 3) facets of polygons (P, N, 3), whose corners may be turned on."""
    size = points.shape[1]
    if 3 < size <= MOST_CORNERS:
        crosses = _crosses(points)
        total = crosses.sum(axis=1)
        along = np.einsum("pni,pi->pn", crosses, total)
        folded = (along < AGAINST * np.square(total).sum(axis=1)[:, None]).any(axis=1)
        points[folded] = _from_best_corner(points[folded])
    fans = np.zeros((len(points), size - 2, 3, 3))
    fans[:, :, 0], fans[:, :, 1], fans[:, :, 2] = points[:, :1], points[:, 1:-1], points[:, 2:]
    return fans


def _from_best_corner(points: Float) -> Float:
    """(P, N, 3) the polygons, each beginning with the corner whose fan has the least area."""
    best = points.copy()
    least = np.full(len(points), np.inf)
    for apex in range(points.shape[1] if len(points) else 0):
        turned = np.roll(points, -apex, axis=1)
        area = np.linalg.norm(_crosses(turned), axis=2).sum(axis=1)
        better = area < least
        best[better], least[better] = turned[better], area[better]
    return best


def _crosses(points: Float) -> Float:
    """(P, N - 2, 3) twice the area of each facet of the fans from the first corners, along their normals."""
    return np.asarray(np.cross(points[:, 1:-1] - points[:, :1], points[:, 2:] - points[:, :1]))
