"""Convex hull of points in space."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from printer_slicer.arrays import Bool, Float, Int
from printer_slicer.geometry.vectors import dot, norm

__all__ = ["find_hull_facets"]

_JOGGLE: Final = 1e-5  # of the size; by so much points are moved at random while facets are found
_FLATTEST: Final = 1e-9  # of the size; points that span less have no hull


class _Facets(NamedTuple):
    """Facets of a hull, as lists: removed ones stay, but are not alive.

    Attributes:
        corners: three indices of points per facet, counter-clockwise seen from outside.
        normals, offsets: unit normals, and distance of each plane from the origin along the normal.
        alive: whether the facet belongs to the hull.
    """

    corners: Int
    normals: Float
    offsets: Float
    alive: Bool


def find_hull_facets(points: Float, tolerance: float, most: int = 300) -> Int:
    """Return the facets (F, 3) of the convex hull as indices of points, counter-clockwise seen from outside.

    Each step adds the point that is farthest outside, so the hull of few points already resembles that of all.
    The result is empty if the points lie in a plane.

    Args:
        points: (N, 3) mm.
        tolerance: points that are less far outside are left out, mm.
        most: maximum number of points that are added.

    Source: Barber, Dobkin and Huhdanpaa, The Quickhull algorithm for convex hulls, 1996.
    """
    start = _find_simplex(points)
    if start is None:
        return np.zeros((0, 3), np.int64)
    # Points that are almost in a plane would see some of its facets, but not others.
    points = points + _JOGGLE * np.ptp(points) * np.random.default_rng(0).uniform(-1.0, 1.0, points.shape)
    facets = _make_facets(points, start)
    far, owner = _find_outside(points, facets, np.arange(len(start)))
    for _ in range(most):
        index = int(far.argmax())
        if far[index] <= tolerance:
            break
        height = facets.normals @ points[index] - facets.offsets
        visible = facets.alive & (height > 0)
        corners = _list_horizon(facets.corners[visible], index)
        first = len(facets.alive)
        facets = _replace_facets(facets, visible, _make_facets(points, corners))
        moved = np.flatnonzero(visible[owner])
        new = np.arange(first, len(facets.alive))
        far[moved], owner[moved] = _find_outside(points[moved], facets, new)
    return facets.corners[facets.alive]


def _find_simplex(points: Float) -> Int | None:
    """Return the facets (4, 3) of a tetrahedron of four far points; None if the points lie in a plane."""
    a = int(points[:, 0].argmin())
    gap = points - points[a]
    distance = (gap**2).sum(axis=1)
    b = int(distance.argmax())
    size = float(np.sqrt(distance[b]))
    along = gap[b] / max(size, 1e-300)
    across = ((gap - np.outer(gap @ along, along)) ** 2).sum(axis=1)
    c = int(across.argmax())
    normal = np.cross(gap[b], gap[c])
    height = gap @ (normal / max(float(np.linalg.norm(normal)), 1e-300))
    d = int(np.abs(height).argmax())
    if min(float(np.sqrt(across[c])), abs(float(height[d]))) <= _FLATTEST * size:
        return None
    if height[d] > 0:
        b, c = c, b
    return np.array([[a, b, c], [a, d, b], [b, d, c], [c, d, a]])


def _make_facets(points: Float, corners: Int) -> _Facets:
    """Return facets with the given corners (n, 3)."""
    a, b, c = points[corners].transpose(1, 0, 2)
    (ux, uy, uz), (vx, vy, vz) = (b - a).T, (c - a).T
    normals = np.stack([uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx], axis=1)
    normals /= np.maximum(norm(normals), 1e-300)[:, None]
    return _Facets(corners, normals, dot(normals, a), np.ones(len(corners), np.bool_))


def _replace_facets(facets: _Facets, visible: Bool, new: _Facets) -> _Facets:
    """Return facets without the `visible` ones, followed by new ones."""
    kept = facets._replace(alive=facets.alive & ~visible)
    return _Facets(*(np.concatenate(pair) for pair in zip(kept, new, strict=True)))


def _list_horizon(corners: Int, apex: int) -> Int:
    """Return the facets (n, 3) from the outline of removed facets (m, 3) to a new point."""
    edges = {edge for a, b, c in corners.tolist() for edge in ((a, b), (b, c), (c, a))}
    outline = sorted((a, b) for a, b in edges if (b, a) not in edges)
    return np.array([(a, b, apex) for a, b in outline], np.int64).reshape(-1, 3)


def _find_outside(points: Float, facets: _Facets, of: Int) -> tuple[Float, Int]:
    """Return for each point (n, 3) how far it lies outside the facets `of` (m,), mm, and of which one the farthest."""
    if not len(points) or not len(of):
        return np.zeros(len(points)), np.zeros(len(points), np.int64)
    height = points @ facets.normals[of].T - facets.offsets[of]
    best = height.argmax(axis=1)
    return height[np.arange(len(points)), best], of[best]
