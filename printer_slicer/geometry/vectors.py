"""Products and rotations of vectors, points in triangles and distances from them, nearest points on segments."""

from __future__ import annotations

from functools import reduce
from math import cos, radians, sin
from typing import Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from printer_slicer.arrays import Bool, Float

__all__ = [
    "are_in_triangles",
    "cosine_and_sine",
    "cross",
    "dot",
    "measure_distances_from_triangles",
    "nearest_on_segments",
    "nearest_share",
    "norm",
]

_Number = TypeVar("_Number", np.float64, np.int64)
_QUARTERS: Final = {0.0: (1.0, 0.0), 90.0: (0.0, 1.0), 180.0: (-1.0, 0.0), 270.0: (0.0, -1.0)}


def cosine_and_sine(degrees: float) -> tuple[float, float]:
    """Return cosine and sine of an angle; exact for quarter turns, so that horizontal facets stay horizontal."""
    return _QUARTERS.get(degrees % 360.0, (cos(radians(degrees)), sin(radians(degrees))))


def dot(a: Float, b: Float) -> Float:
    """Return the scalar products (...,) of vectors (..., d).

    Adding column by column takes a third of the time of a sum along the rows.
    """
    return reduce(np.add, (a[..., axis] * b[..., axis] for axis in range(a.shape[-1])))


def cross(a: NDArray[_Number], b: NDArray[_Number]) -> NDArray[_Number]:
    """Return the cross products (...,) of vectors (..., 2): positive where `b` points to the left of `a`.

    Products of integer lengths up to 10 m in steps of 0.01 µm fit into 64 bits.
    """
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def are_in_triangles(points: Float, corners: Float, beside: float) -> Bool:
    """Return which points (n, 2) are in their triangle (n, 3, 2), counter-clockwise, or up to `beside` outside it."""
    result = np.ones(len(points), np.bool_)
    for begin, end in ((0, 1), (1, 2), (2, 0)):
        side = corners[:, end] - corners[:, begin]
        result &= cross(side, points - corners[:, begin]) >= -beside * np.hypot(side[:, 0], side[:, 1])
    return result


def norm(vectors: Float) -> Float:
    """Return the lengths (...,) of vectors (..., d).

    This takes a tenth of the time of `numpy.hypot` over columns that are not contiguous.
    """
    return np.sqrt(dot(vectors, vectors))


def nearest_share(gap: Float, way: Float) -> Float:
    """Return the position (...,) along a segment, from 0 to 1, that is nearest to a point.

    The result for a segment without length is 0.

    Args:
        gap: (..., d) vector from the start of the segment to the point.
        way: (..., d) vector from the start of the segment to its end.
    """
    length2 = dot(way, way)
    return np.clip(dot(gap, way) / np.where(length2 > 0, length2, 1.0), 0.0, 1.0)


def nearest_on_segments(points: Float, begin: Float, end: Float) -> tuple[Float, Float]:
    """Return the nearest points (..., d) on segments, and their positions (...,) along the segments, from 0 to 1.

    Args:
        points: (..., d) mm, in any number of dimensions.
        begin: (..., d) mm, start of the segment for each point.
        end: (..., d) mm, its end.
    """
    way = end - begin
    share = nearest_share(points - begin, way)
    return begin + share[..., None] * way, share


def measure_distances_from_triangles(points: Float, corners: Float) -> Float:
    """Return the distance (n,) of each point (n, 3) from its triangle (n, 3, 3), mm."""
    end = np.roll(corners, -1, axis=1)
    way, gap = end - corners, points[:, None] - corners
    beside = norm(points[:, None] - nearest_on_segments(points[:, None], corners, end)[0]).min(axis=1)
    normal = np.cross(way[:, 0], way[:, 1])
    size = norm(normal)
    is_over = (dot(np.cross(way, gap), normal[:, None]) >= 0).all(axis=1) & (size > 0)
    return np.asarray(np.where(is_over, np.abs(dot(gap[:, 0], normal)) / np.maximum(size, 1e-300), beside))
