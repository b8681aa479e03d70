"""Array types, and functions for ragged arrays, runs, rings and distinct values."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = [
    "Bool",
    "Float",
    "Int",
    "SmallInt",
    "bounding_boxes",
    "compact_ids",
    "concatenate_pairs",
    "consecutive",
    "distinct",
    "frozen_array",
    "interpolate_rows",
    "median",
    "next_in_ring",
    "per_layer",
    "polyline_lengths",
    "previous_in_ring",
    "reorder_points",
    "run_starts",
    "unique_inverse",
]

Float = NDArray[np.float64]
Int = NDArray[np.int64]
Bool = NDArray[np.bool_]
SmallInt = NDArray[np.signedinteger]
"""Signed integers of any width."""
_Number = TypeVar("_Number", np.int64, np.float64)


def frozen_array(values: ArrayLike, dtype: type, shape: tuple[int, ...]) -> NDArray:  # type: ignore[type-arg]
    """Return a read-only contiguous array of `dtype`; check its shape, in which -1 means any length.

    The data is copied only if it is not contiguous or has another type. Otherwise the result is a view, so the caller
    must not write to `values` afterwards.

    Raises:
        ValueError: the array has another shape.
    """
    array: NDArray = np.ascontiguousarray(values, dtype=dtype)  # type: ignore[type-arg]
    have = array.shape
    # Called thousands of times per part, so the common case is tested first: a shape that differs only in the length.
    if (have[1:] != shape[1:] or have[:1] != shape[:1] != (-1,)) and not _shape_fits(have, shape):
        raise ValueError(f"expected shape {shape}, got {have}")
    view = array.view()
    view.setflags(write=False)
    return view


def interpolate_rows(x: Float, known: Float, values: Float) -> Float:
    """Interpolate each row of values (H, n) at `x` (m,), (H, m): the results of `np.interp`, for all rows at once.

    Args:
        x: positions.
        known: (n,) positions of the values, ascending; at least one.
        values: (H, n).
    """
    if len(known) == 1:
        return np.repeat(values, len(x), axis=1)
    left = np.clip(np.searchsorted(known, x, side="right") - 1, 0, len(known) - 2)
    low = values.take(left, axis=1)
    rise = values.take(left + 1, axis=1) - low
    found = rise / (known.take(left + 1) - known.take(left)) * (x - known.take(left)) + low
    found[:, x <= known[0]] = values[:, :1]
    found[:, x >= known[-1]] = values[:, -1:]
    return np.asarray(found)


def _shape_fits(have: tuple[int, ...], shape: tuple[int, ...]) -> bool:
    """Return whether a shape matches the expected one, in which -1 means any length."""
    return len(have) == len(shape) and all(want in (-1, one) for want, one in zip(shape, have, strict=True))


def per_layer(value: float | Float, n_layers: int) -> Float:
    """Return the value (n_layers,) of each layer; a single number applies to all layers.

    Raises:
        ValueError: the array has another length, or contains a value that is not a number.
    """
    array = np.asarray(value, dtype=np.float64)
    if array.shape not in ((), (n_layers,)):
        raise ValueError(f"expected one value or one per layer ({n_layers}), got shape {array.shape}")
    if np.isnan(array).any():
        raise ValueError("the value of a layer is NaN")
    return np.asarray(np.broadcast_to(array, (n_layers,)))


def consecutive(first: Int, count: Int) -> Int:
    """Return ranges one after the other: `count[i]` numbers `first[i], first[i] + 1, ...` for each i."""
    result: Int = np.repeat(first - (np.cumsum(count) - count), count)
    result += np.arange(len(result))
    return result


def next_in_ring(start: Int, closed: bool | Bool = True) -> Int:
    """Return the index (N,) of the next item in each ring; the last item of a ring is followed by the first.

    Args:
        start: (R + 1,) ring `i` has the items `start[i]:start[i + 1]`; it may be empty.
        closed: (R,) whether each is closed, or one value for all. The last item of an open line is followed by itself.
    """
    first, last = start[:-1], start[1:] - 1
    some = last >= first
    following = np.arange(1, int(start[-1]) + 1)
    following[last[some]] = np.where(closed, first, last)[some]
    return following


def previous_in_ring(start: Int) -> Int:
    """Return the index (N,) of the previous item in each ring; this is the inverse of `next_in_ring`."""
    first, last = start[:-1], start[1:] - 1
    some = last >= first
    previous = np.arange(-1, int(start[-1]) - 1)
    previous[first[some]] = last[some]
    return previous


def bounding_boxes(points: Float | Int, start: Int, owner: Int, n_owners: int) -> tuple[Float, Float]:
    """Return the bounding box of each owner's points: lower and upper corners, (n_owners, 2) each.

    An owner without points has an inverted, infinite box.

    Args:
        points: (N, 2)
        start: (R + 1,) run `i` of points is `points[start[i]:start[i + 1]]`; none is empty.
        owner: (R,) owner of each run, ascending.
        n_owners: number of owners.
    """
    low = np.full((n_owners, 2), np.inf)
    high = -low
    first = np.flatnonzero(run_starts(owner))
    used = owner[first]
    for axis, column in enumerate(np.ascontiguousarray(points.T) if len(used) else ()):
        low[used, axis] = np.minimum.reduceat(column, start[first])
        high[used, axis] = np.maximum.reduceat(column, start[first])
    return low, high


def median(values: Float) -> float:
    """Return the median of values (n,), n > 0, without the import of masked arrays (5 ms) by `np.median`."""
    ordered = np.sort(values)
    return float((ordered[(len(values) - 1) // 2] + ordered[len(values) // 2]) / 2)


def polyline_lengths(xy: Float, start: Int, closed: bool | Bool = True) -> Float:
    """Return the length (M,) of each polyline, mm.

    Args:
        xy: (N, 2) mm.
        start: (M + 1,) polyline `i` has the points `xy[start[i]:start[i + 1]]`, at least one.
        closed: (M,) whether each polyline is closed without repeating its first point, or one value for all.
    """
    if len(start) < 2:
        return np.zeros(0)
    x, y = np.ascontiguousarray(xy.T)
    following = next_in_ring(start, closed)
    return np.add.reduceat(np.hypot(x.take(following) - x, y.take(following) - y), start[:-1])


def concatenate_pairs(found: Iterable[tuple[Int, Int]]) -> tuple[Int, Int]:
    """Concatenate batches of index pairs (n,), (n,)."""
    one, other = zip((np.zeros(0, np.int64), np.zeros(0, np.int64)), *found, strict=True)
    return np.concatenate(one), np.concatenate(other)


def distinct(values: NDArray[_Number]) -> NDArray[_Number]:
    """Return the distinct values, ascending, as `numpy.unique` does, but without importing masked arrays."""
    ordered = np.sort(values)
    return ordered.compress(run_starts(ordered))


def unique_inverse(values: NDArray[_Number]) -> tuple[NDArray[_Number], Int]:
    """Return the distinct values (m,), ascending, and the index (n,) of each value among them; see `distinct`."""
    order = np.argsort(values)
    ordered = values.take(order)
    begins = run_starts(ordered)
    place = np.zeros(len(values), np.int64)
    place[order] = np.cumsum(begins) - 1
    return ordered.compress(begins), place


def run_starts(values: NDArray[_Number]) -> Bool:
    """Return a mask (n,) of values that start a run, that is, differ from the value before."""
    begins = np.ones(len(values), np.bool_)
    np.not_equal(values[1:], values[:-1], out=begins[1:])
    return begins


def compact_ids(items: Int, n_items: int) -> tuple[Int, Int]:
    """Return the distinct ids (m,) in `items`, ascending, and `items` with each id replaced by its index among them."""
    used = np.zeros(n_items, np.bool_)
    used[items] = True
    number = np.cumsum(used) - 1
    return np.flatnonzero(used), number[items]


def reorder_points(xy: Float, place: Int) -> Float:
    """Return the points (n, 2) in another order: point `i` moves to index `place[i]`; `place` is a permutation.

    Each point is moved as one complex number, which takes a sixth of the time of two columns.
    """
    result = np.zeros(len(xy), np.complex128)
    result[place] = np.ascontiguousarray(xy).view(np.complex128).ravel()
    return result.view(np.float64).reshape(-1, 2)
