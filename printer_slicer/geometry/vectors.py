"""Products of vectors given row by row, and the places on segments nearest to points."""

from __future__ import annotations

from functools import reduce
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from printer_slicer.arrays import Float

__all__ = ["cross", "dot", "feet", "nearest_share", "norm"]

_Number = TypeVar("_Number", np.float64, np.int64)


def dot(a: Float, b: Float) -> Float:
    """(...,) scalar products of vectors (..., d); column by column, a third of the time of a sum along the rows."""
    return reduce(np.add, (a[..., axis] * b[..., axis] for axis in range(a.shape[-1])))


def cross(a: NDArray[_Number], b: NDArray[_Number]) -> NDArray[_Number]:
    """(...,) cross products of vectors (..., 2): positive where `b` points to the left of `a`.

    Whole numbers up to 10 m in steps of 0.01 µm fit into 64 bits.
    """
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def norm(vectors: Float) -> Float:
    """(...,) lengths of vectors (..., d); a tenth of the time of `numpy.hypot` over columns that are not contiguous."""
    return np.sqrt(dot(vectors, vectors))


def nearest_share(gap: Float, way: Float) -> Float:
    """(...,) how far along a way (..., d), from 0 to 1, it comes nearest to what lies `gap` (..., d) from its begin.

    A way of no length is nearest at its begin.
    """
    length2 = dot(way, way)
    return np.clip(dot(gap, way) / np.where(length2 > 0, length2, 1.0), 0.0, 1.0)


def feet(points: Float, begin: Float, end: Float) -> tuple[Float, Float]:
    """(..., d) the places nearest to points on the segments that go with them, and (...,) their shares of the way.

    Args:
        points: (..., d) mm, of as many dimensions as there are.
        begin: (..., d) mm, of each segment.
        end: (..., d) mm.
    """
    way = end - begin
    share = nearest_share(points - begin, way)
    return begin + share[..., None] * way, share
