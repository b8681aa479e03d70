"""Triangulate the polygons of OBJ, PLY and OFF files."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Final

import numpy as np

from printer_slicer.mesh_io.limits import check_facets

if TYPE_CHECKING:
    from pathlib import Path

    from printer_slicer.arrays import Float, Int
    from printer_slicer.mesh_io.limits import Limits

__all__ = ["to_integers", "triangulate_polygons"]

MAX_CORNERS: Final = 64
"""A polygon with more corners becomes a fan from its first corner even if it is not convex."""
BLOCK: Final = 1 << 16
"""Number of polygon corners processed at a time."""
FOLD_TOLERANCE: Final = -1e-9
"""A facet is folded over if its area in the direction of its polygon is below this fraction of the polygon's area."""


def to_integers(values: Float) -> Int:
    """Convert floats that were read from a text to integers.

    Raises:
        ValueError: a float is not a whole number.
    """
    if not (np.abs(values) < 1 << 53).all() or not (values == np.rint(values)).all():
        raise ValueError("a vertex number is not a whole number")
    numbers: Int = values.astype(np.int64)
    return numbers


def triangulate_polygons(vertices: Float, counts: Int, corners: Int, path: Path, limits: Limits) -> Float:
    """Split polygons into facets.

    A polygon becomes a fan from its first corner. If that fan folds over, because the polygon is not convex, the fan
    with the least area is used; it covers exactly the polygon if one corner sees all of it. Polygons with fewer than
    three corners have no facets.

    Args:
        vertices: (V, 3).
        counts: (P,) number of corners of each polygon.
        corners: (sum of counts,) vertex indices.
        path: for messages.
        limits: for the number of facets.

    Returns:
        Corners (T, 3, 3) of the facets, in the order of the polygons.

    Raises:
        MeshError: there are too many facets.
        ValueError: a vertex does not exist.
    """
    if len(corners) and not (corners.min() >= 0 and corners.max() < len(vertices)):
        wrong = int(np.flatnonzero((corners < 0) | (corners >= len(vertices)))[0])
        polygon = int(np.searchsorted(np.cumsum(counts), wrong, side="right"))
        raise ValueError(f"face {polygon + 1} uses vertex {corners[wrong]} of {len(vertices)}")
    if len(counts) and (counts == 3).all():
        check_facets(len(counts), path, limits)
        return np.asarray(vertices[corners.reshape(-1, 3)])
    first_corner = np.cumsum(counts) - counts
    counts, first_corner = counts[counts >= 3], first_corner[counts >= 3]
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
            points = vertices[corners[first_corner[rows, None] + np.arange(size)]]
            triangles[first[rows, None] + np.arange(size - 2)] = _make_fans(points)
    return triangles


def _make_fans(points: Float) -> Float:
    """Split polygons (P, N, 3) into facets (P, N - 2, 3, 3); may change which corner in `points` comes first."""
    size = points.shape[1]
    if 3 < size <= MAX_CORNERS:
        crosses = _compute_fan_normals(points)
        total = crosses.sum(axis=1)
        along = np.einsum("pni,pi->pn", crosses, total)
        folded = (along < FOLD_TOLERANCE * np.square(total).sum(axis=1)[:, None]).any(axis=1)
        points[folded] = _start_at_best_corner(points[folded])
    fans = np.zeros((len(points), size - 2, 3, 3))
    fans[:, :, 0], fans[:, :, 1], fans[:, :, 2] = points[:, :1], points[:, 1:-1], points[:, 2:]
    return fans


def _start_at_best_corner(points: Float) -> Float:
    """Return the polygons (P, N, 3), each starting at the corner whose fan has the least area."""
    best = points.copy()
    least = np.full(len(points), np.inf)
    for apex in range(points.shape[1] if len(points) else 0):
        turned = np.roll(points, -apex, axis=1)
        area = np.linalg.norm(_compute_fan_normals(turned), axis=2).sum(axis=1)
        better = area < least
        best[better], least[better] = turned[better], area[better]
    return best


def _compute_fan_normals(points: Float) -> Float:
    """Return the normals (P, N - 2, 3) of fans from the first corners; their lengths are twice the areas."""
    return np.asarray(np.cross(points[:, 1:-1] - points[:, :1], points[:, 2:] - points[:, :1]))
