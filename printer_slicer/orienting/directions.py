"""Directions of a part that may point down to the bed."""

from __future__ import annotations

from typing import Final

import numpy as np

from printer_slicer.arrays import Float
from printer_slicer.geometry.vectors import norm
from printer_slicer.orienting.part_shape import PartShape

__all__ = ["drop_near", "list_directions", "spread_directions"]

_MAX_FLATS: Final = 100
_MIN_FLAT: Final = 1e-3  # area of a flat, relative to the largest
_SAME_FLAT_COSINE: Final = np.cos(np.radians(1.0))
_SAME_DIRECTION_COSINE: Final = np.cos(np.radians(0.2))
_PERPENDICULAR_COSINE: Final = 0.05  # flats with a smaller cosine between them count as perpendicular
_N_SPREAD: Final = 200


def list_directions(shape: PartShape) -> Float:
    """Return unit vectors (D, 3) in the axes of a part, which may point down.

    They are the normals of its flats, and of those of its convex hull, on which it can lie, the largest first; the axes
    and diagonals of a frame of the largest flats; and directions spread evenly over the sphere.
    """
    hull_flats = _list_hull_flats(shape)
    every = [shape.flats, hull_flats, _list_diagonals(hull_flats), spread_directions(_N_SPREAD)]
    return drop_near(np.concatenate(every), _SAME_DIRECTION_COSINE)


def spread_directions(count: int) -> Float:
    """Return `count` unit vectors (count, 3), spread evenly over the sphere.

    Source: Gonzalez, Measurement of areas on a sphere using Fibonacci and latitude-longitude lattices, 2010.
    """
    number = np.arange(count) + 0.5
    z = 1 - 2 * number / count
    longitude = np.pi * (1 + np.sqrt(5)) * number
    radius = np.sqrt(1 - z * z)
    return np.column_stack([radius * np.cos(longitude), radius * np.sin(longitude), z])


def _list_hull_flats(shape: PartShape) -> Float:
    """Return the unit normals (n, 3) of the largest flats of the convex hull, the largest first."""
    if not len(shape.hull_facets):
        return np.zeros((0, 3))
    a, b, c = shape.hull[shape.hull_facets].transpose(1, 0, 2)
    vectors = np.cross(b - a, c - a) / 2
    area = norm(vectors)
    order = np.argsort(-area, kind="stable")
    order = order[area[order] > _MIN_FLAT * area.max()]
    normals = vectors[order] / area[order, None]
    # Each facet belongs to the first, which is the largest, of those that face almost the same way.
    leader = (normals @ normals.T > _SAME_FLAT_COSINE).argmax(axis=1)
    total = np.bincount(leader, area[order], len(order))
    largest = np.argsort(-total, kind="stable")[:_MAX_FLATS]
    return np.asarray(normals[largest[total[largest] > 0]])


def _list_diagonals(flats: Float) -> Float:
    """Return the axes and diagonals (26, 3) of a frame of the largest flats, or of the shape if it has none.

    A frame is three perpendicular axes.
    """
    frame = np.eye(3)
    if len(flats):
        perpendicular = flats[np.abs(flats @ flats[0]) < _PERPENDICULAR_COSINE]
        second = perpendicular[0] if len(perpendicular) else frame[np.abs(flats[0]).argmin()]
        second = second - flats[0] * (second @ flats[0])
        second = second / norm(second)
        frame = np.stack([flats[0], second, np.cross(flats[0], second)])
    steps = np.stack(np.meshgrid(*[(-1.0, 0.0, 1.0)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    steps = steps[(steps != 0).any(axis=1)]
    return np.asarray(steps / norm(steps)[:, None] @ frame)


def drop_near(directions: Float, cosine: float) -> Float:
    """Return unit vectors (n, 3) without those whose cosine with an earlier one is larger than `cosine`."""
    if not len(directions):
        return directions
    first = (directions @ directions.T > cosine).argmax(axis=1)
    return np.asarray(directions[first == np.arange(len(first))])
