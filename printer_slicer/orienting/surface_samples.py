"""Samples of a surface: points with the area around them and the direction it faces."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from printer_slicer.arrays import Int, frozen_array
from printer_slicer.geometry.raster import Float32
from printer_slicer.values import Struct, force_setattr

__all__ = ["SurfaceSamples", "TurnedSamples", "pool_samples", "sample_surface"]

_LONGEST_EDGE: Final = 1.5  # spacings; facets with longer edges are divided
_NORMAL_STEPS: Final = 5  # of a component of the normal from 0 to 1
_MAX_SAMPLES: Final = 40_000  # more are pooled


class SurfaceSamples(Struct, frozen=True, eq=False):
    """Places on a surface, which stand for all of it.

    Attributes:
        points: (3, n) mm.
        normals: (3, n) unit vectors that point out of the part.
        area: (n,) mm².
    """

    points: Float32
    normals: Float32
    area: Float32

    def __post_init__(self) -> None:
        force_setattr(self, "area", frozen_array(self.area, np.float32, (-1,)))
        for name in ("points", "normals"):
            force_setattr(self, name, frozen_array(getattr(self, name), np.float32, (3, len(self.area))))


class TurnedSamples(NamedTuple):
    """Samples of a part that is turned and stands on z = 0.

    Attributes:
        points: (3, n) mm.
        rise: (n,) vertical component of the normals, 1 where the surface faces up.
        area: (n,) mm².
        spacing: distance between samples, mm.
    """

    points: Float32
    rise: Float32
    area: Float32
    spacing: float


def sample_surface(corners: Float32, area_vectors: Float32, spacing: float) -> SurfaceSamples:
    """Return samples of triangles, not much farther apart than `spacing` mm.

    Large facets are divided at the middle of their longest edge. If there are very many samples, those that are near
    each other and face the same way are pooled.

    Args:
        corners: (3, 3, F) coordinates of the first, second and third corners, mm.
        area_vectors: (3, F) the area of each facet in mm², times its normal.
        spacing: mm.
    """
    limit = (_LONGEST_EDGE * spacing) ** 2
    points, vectors = [], []
    parts, area = corners, area_vectors
    while area.shape[1]:
        large = _measure_edges(parts).max(axis=0) > limit
        small = np.flatnonzero(~large)
        points.append(_find_middles(parts).take(small, axis=1))
        vectors.append(area.take(small, axis=1))
        rest = np.flatnonzero(large)
        parts, area = _halve(parts.take(rest, axis=2)), np.tile(area.take(rest, axis=1) / np.float32(2), 2)
    samples = _make_samples(np.concatenate(points, axis=1), np.concatenate(vectors, axis=1))
    return samples if len(samples.area) <= _MAX_SAMPLES else pool_samples(samples, spacing, _NORMAL_STEPS)


def _find_middles(corners: Float32) -> Float32:
    """Return the middles (3, n) of triangles with corners (3, 3, n)."""
    return np.asarray((corners[0] + corners[1] + corners[2]) / np.float32(3))


def _measure_edges(corners: Float32) -> Float32:
    """Return the squared lengths (3, n) of the edges, each from corner i to i + 1, mm²."""
    squares = np.zeros((3, corners.shape[2]), np.float32)
    for corner in range(3):
        edge = corners[corner - 2] - corners[corner]
        edge *= edge
        np.add(edge[0], edge[1], out=squares[corner])
        squares[corner] += edge[2]
    return squares


def _halve(corners: Float32) -> Float32:
    """Return the halves (3, 3, 2 n) of triangles, divided at the middle of the longest edge."""
    longest = _measure_edges(corners).argmax(axis=0)
    turn = (longest + np.arange(3)[:, None]) % 3
    a, b, c = np.take_along_axis(corners, turn[:, None, :], axis=0)
    middle = (a + b) / np.float32(2)
    return np.concatenate([np.stack([a, middle, c]), np.stack([middle, b, c])], axis=2)


def _make_samples(points: Float32, vectors: Float32) -> SurfaceSamples:
    """Return samples at points (3, n) with these area vectors (3, n)."""
    x, y, z = vectors
    area = np.sqrt(x * x + y * y + z * z)
    solid = np.flatnonzero(area > 0)
    area = area.take(solid)
    return SurfaceSamples(points.take(solid, axis=1), vectors.take(solid, axis=1) / area, area)


def pool_samples(samples: SurfaceSamples, cell: float, normal_steps: int) -> SurfaceSamples:
    """Return fewer samples: those in the same cube of `cell` mm that face about the same way become one.

    Args:
        samples: of a surface.
        cell: mm.
        normal_steps: number of steps into which a component of the normal from 0 to 1 is divided.
    """
    key = _number_pools(samples, cell, normal_steps)
    order = np.argsort(key)
    ordered = key[order]
    start = np.flatnonzero(np.append(True, ordered[1:] != ordered[:-1])[: len(key)])
    area = samples.area.take(order)
    total = np.add.reduceat(area, start) if len(start) else area
    points, normals = (
        np.stack([np.add.reduceat(column.take(order) * area, start) for column in values]) / total
        for values in (samples.points, samples.normals)
    )
    length = np.sqrt((normals**2).sum(axis=0))
    return SurfaceSamples(points, normals / np.maximum(length, np.float32(1e-30)), total)


def _number_pools(samples: SurfaceSamples, cell: float, normal_steps: int) -> Int:
    """Return the number (n,) of the pool of each sample."""
    key = np.zeros(len(samples.area), np.int64)
    for column in samples.points:
        key = (key << 14) + ((column - column.min(initial=np.inf)) / np.float32(cell)).astype(np.int32)
    for column in samples.normals:
        key = (key << 6) + np.rint(column * np.float32(normal_steps)).astype(np.int32) + normal_steps
    return key
