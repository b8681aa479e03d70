"""The shape of a part in axes of its own, with samples of its surface and the corners of its convex hull.

The axes are the principal axes of the surface, from its centroid. So a part has the same shape however it lies in its
file, except for rounding.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from printer_slicer.arrays import Float, Int, compact_ids, frozen_array
from printer_slicer.errors import MeshError
from printer_slicer.geometry.raster import Float32
from printer_slicer.geometry.solid_hull import find_hull_facets
from printer_slicer.geometry.vectors import norm
from printer_slicer.orienting.surface_samples import SurfaceSamples, pool_samples, sample_surface
from printer_slicer.values import Struct, force_setattr

__all__ = ["PartShape", "measure_shape"]

_N_SAMPLES: Final = 12_000  # roughly; so many samples of equal size would cover the surface
_MAX_STEPS: Final = 500  # between samples, per length of the shape
_COARSE_CELLS: Final = 12  # per length of the shape, in which samples are pooled for rough ratings
_COARSE_STEPS: Final = 4  # of a component of the normal, for the same purpose
_HULL_CELLS: Final = (
    64  # per length of the shape; of the corners in a cell, only the outermost counts for the hull
)
_HULL_TOLERANCE: Final = 2e-4  # of the size
_MAX_CELLS: Final = 128  # along an axis
_RADIUS_STEPS: Final = 1 << 30
_FLAT_STEPS: Final = 64  # of a component of the normal from 0 to 1; facets of a flat have the same
_MAX_FLATS: Final = 60
_MIN_FLAT: Final = 2e-3  # area of a flat, relative to the surface
_SYMMETRIC: Final = 1e-4  # third moment, relative to the size, below which a shape counts as symmetric


class PartShape(Struct, frozen=True, eq=False):
    """A part in axes of its own.

    Attributes:
        axes: (3, 3) the axes as rows, in coordinates of the file.
        samples: of the surface, at about 12 000 places or more.
        coarse: fewer samples of the same surface, for rough ratings.
        flats: (n, 3) unit normals of the largest flats of the surface, the largest first.
        hull: (H, 3) corners of the convex hull, mm.
        hull_facets: (F, 3) indices of corners.
        center: (3,) centre of mass, mm.
        volume: mm³.
        spacing: distance between samples, mm.
    """

    axes: Float
    samples: SurfaceSamples
    coarse: SurfaceSamples
    flats: Float
    hull: Float
    hull_facets: Int
    center: Float
    volume: float
    spacing: float

    def __post_init__(self) -> None:
        for name, shape in (("axes", (3, 3)), ("flats", (-1, 3)), ("hull", (-1, 3)), ("center", (3,))):
            force_setattr(self, name, frozen_array(getattr(self, name), np.float64, shape))
        force_setattr(self, "hull_facets", frozen_array(self.hull_facets, np.int64, (-1, 3)))

    @property
    def area(self) -> float:
        """Area of the surface, mm²."""
        return float(self.samples.area.sum())


def measure_shape(triangles: Float, name: str = "part") -> PartShape:
    """Measure the shape of triangles (F, 3, 3), mm; if they are inverted, they are turned round together.

    Raises:
        MeshError: no triangle has an area.
    """
    origin = triangles.reshape(-1, 3)[0]
    # Single precision is enough for samples, and takes half the time.
    corners = np.subtract(triangles.reshape(-1, 9).T, np.tile(origin, 3)[:, None], order="C").reshape(
        3, 3, -1
    )
    columns = corners.astype(np.float32)
    vectors, volume, center = _integrate(columns)
    area = np.sqrt(_square(vectors))
    if not area.any():
        raise MeshError(
            f"{name}: the facets have no area", remedy="Check the unit and the corners of the facets"
        )
    middle = (columns[0] + columns[1] + columns[2]) / np.float32(3)
    centroid = (middle @ area / max(float(area.sum()), 1e-30))[:, None]
    axes = _find_axes(middle - centroid, columns - centroid, area)
    narrow = axes.astype(np.float32)
    own = np.stack([narrow @ (corner - centroid) for corner in columns])
    size = float(own.max() - own.min())
    spacing = max(float(np.sqrt(area.sum() / _N_SAMPLES)), size / _MAX_STEPS)
    vectors = (-narrow if volume < 0 else narrow) @ vectors
    samples = sample_surface(own, vectors, spacing)
    outer = _find_outer_corners(own, size / _HULL_CELLS)
    exact = (corners.transpose(1, 0, 2).reshape(3, -1)[:, outer] - centroid).T @ axes.T
    facets = find_hull_facets(exact, _HULL_TOLERANCE * size)
    used, numbers = compact_ids(facets.ravel(), len(exact))
    return PartShape(
        axes,
        samples,
        pool_samples(samples, size / _COARSE_CELLS, _COARSE_STEPS),
        _compute_normals(corners[:, :, _find_flats(vectors, area)], volume < 0) @ axes.T,
        exact[used] if len(facets) else exact,
        numbers.reshape(-1, 3),
        axes @ (center - centroid[:, 0]) if abs(volume) > 1e-9 * size**3 else np.zeros(3),
        abs(volume),
        spacing,
    )


def _square(vectors: Float32) -> Float32:
    """Return the squared lengths (n,) of vectors (3, n)."""
    x, y, z = vectors
    return np.asarray(x * x + y * y + z * z)


def _integrate(columns: Float32) -> tuple[Float32, float, Float]:
    """Return area vectors (3, F) in mm², the volume in mm³ and the centre of mass (3,) of corners (3, 3, F)."""
    a, b, c = columns
    ab, ac = b - a, c - a
    across = np.stack([ab[i - 2] * ac[i - 1] - ab[i - 1] * ac[i - 2] for i in range(3)])
    six = (a[0] * across[0] + a[1] * across[1] + a[2] * across[2]).astype(np.float64)
    volume = float(six.sum()) / 6
    moment = (a + b + c).astype(np.float64) @ six / 24
    return (across / 2).astype(np.float32), volume, moment / volume if volume else np.zeros(3)


def _find_axes(middle: Float32, corners: Float32, area: Float32) -> Float:
    """Return the principal axes (3, 3) of the surface as rows, the longest first; their signs come from its skewness.

    Args:
        middle: (3, F) middles of the facets, from the centroid.
        corners: (3, 3, F) their corners, from the centroid.
        area: (F,) mm².
    """
    moments = 9 * (middle * area) @ middle.T + sum((corner * area) @ corner.T for corner in corners)
    _, vectors = np.linalg.eigh(moments.astype(np.float64))
    first, second = (_point_to_skewness(axis, middle, area) for axis in vectors.T[:0:-1])
    return np.stack([first, second, np.cross(first, second)])


def _point_to_skewness(axis: Float, middle: Float32, area: Float32) -> Float:
    """Return an axis (3,) or its opposite, towards which the middles (3, F) of the facets reach farther."""
    along = axis.astype(np.float32) @ middle
    cubes = area * along * along * along
    return -axis if cubes.sum() < -_SYMMETRIC * np.abs(cubes).sum() else axis


def _find_flats(vectors: Float32, area: Float32) -> Int:
    """Return the largest facet (n,) of each of the largest flats of a surface, the largest flat first.

    A flat is what faces almost the same way.

    Args:
        vectors: (3, F) area of each facet in mm², times its normal.
        area: (F,) mm².
    """
    key = np.zeros(len(area), np.int64)
    for column in vectors:
        step = np.rint(column * (np.float32(_FLAT_STEPS) / np.maximum(area, np.float32(1e-30))))
        key = (key << 10) + step.astype(np.int32) + _FLAT_STEPS
    order = np.argsort(-area)
    order = order[np.argsort(key[order], kind="stable")]
    first = np.flatnonzero(np.diff(key[order], prepend=-1))
    total = np.add.reduceat(area[order], first)
    largest = np.argsort(-total, kind="stable")[:_MAX_FLATS]
    return np.asarray(order[first[largest[total[largest] > _MIN_FLAT * area.sum()]]])


def _compute_normals(corners: Float, is_inverted: bool) -> Float:
    """Return the unit normals (n, 3) of facets with corners (3, 3, n), in full precision."""
    a, b, c = corners.transpose(0, 2, 1)
    normals = np.cross(b - a, c - a) * (-1.0 if is_inverted else 1.0)
    return np.asarray(normals / np.maximum(norm(normals), 1e-300)[:, None])


def _find_outer_corners(corners: Float32, cell: float) -> Int:
    """Return the indices of the corner farthest from the origin in each cube of `cell` mm.

    `corners` (3, 3, F) count corner by corner.
    """
    x, y, z = corners.transpose(1, 0, 2).reshape(3, -1)
    key = np.zeros(x.shape, np.int64)
    for axis in (x, y, z):
        key = key * _MAX_CELLS + ((axis - axis.min()) * np.float32(1 / cell)).astype(np.int32)
    radius = np.sqrt(x * x + y * y + z * z)
    rank = (radius * np.float32(_RADIUS_STEPS / max(float(radius.max()), 1e-30))).astype(np.int64)
    order = np.argsort(key * (2 * _RADIUS_STEPS) + rank)
    ordered = key[order]
    return np.asarray(order[np.append(ordered[1:] != ordered[:-1], True)])
