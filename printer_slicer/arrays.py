"""Types of arrays, and what is asked of ragged arrays everywhere: runs, rings, numbers of distinct values."""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = [
    "Bool",
    "Float",
    "Int",
    "boxes",
    "consecutive",
    "distinct",
    "following_around",
    "frozen_array",
    "lengths",
    "median",
    "numbered",
    "per_layer",
    "placed",
    "previous_around",
    "renumbered",
    "run_begins",
]

Float = NDArray[np.float64]
Int = NDArray[np.int64]
Bool = NDArray[np.bool_]
_Number = TypeVar("_Number", np.int64, np.float64)


def frozen_array(values: ArrayLike, dtype: type, shape: tuple[int, ...]) -> NDArray:  # type: ignore[type-arg]
    """A read-only contiguous array of `dtype`; `shape` is checked, -1 means any length.

    An array that is already read-only, contiguous and of that type is used as it is; a writable one is
    viewed, so the caller who built it should not write to it any more.
    """
    array: NDArray = np.ascontiguousarray(values, dtype=dtype)  # type: ignore[type-arg]
    have = array.shape
    # Asked thousands of times for each part: what is alike but for its length is known at once.
    if (have[1:] != shape[1:] or have[:1] != shape[:1] != (-1,)) and not _fits(have, shape):
        raise ValueError(f"expected shape {shape}, got {have}")
    view = array.view()
    view.setflags(write=False)
    return view


def _fits(have: tuple[int, ...], shape: tuple[int, ...]) -> bool:
    """Whether a shape is the wanted one, in which -1 stands for any length."""
    return len(have) == len(shape) and all(want in (-1, one) for want, one in zip(shape, have, strict=True))


def per_layer(value: float | Float, n_layers: int) -> Float:
    """(n_layers,) the value of each layer; a single number holds for all of them.

    Raises:
        ValueError: an array of another length, or a value that is not a number.
    """
    array = np.asarray(value, dtype=np.float64)
    if array.shape not in ((), (n_layers,)):
        raise ValueError(f"expected one value or one per layer ({n_layers}), got shape {array.shape}")
    if np.isnan(array).any():
        raise ValueError("a value of a layer is not a number")
    return np.asarray(np.broadcast_to(array, (n_layers,)))


def consecutive(first: Int, count: Int) -> Int:
    """`first[i], first[i] + 1, ...` (`count[i]` numbers) for every i, one after the other."""
    result: Int = np.repeat(first - (np.cumsum(count) - count), count)
    result += np.arange(len(result))
    return result


def following_around(start: Int, closed: bool | Bool = True) -> Int:
    """(N,) the item after each, in rings of items: after the last of a ring comes its first.

    Args:
        start: (R + 1,) ring `i` has the items `start[i]:start[i + 1]`, which may be none.
        closed: (R,) which are rings, or whether all are; in the others the last item is followed by itself.
    """
    first, last = start[:-1], start[1:] - 1
    some = last >= first
    following = np.arange(1, int(start[-1]) + 1)
    following[last[some]] = np.where(closed, first, last)[some]
    return following


def previous_around(start: Int) -> Int:
    """(N,) the item before each, in rings of items: the inverse of `following_around`."""
    first, last = start[:-1], start[1:] - 1
    some = last >= first
    previous = np.arange(-1, int(start[-1]) - 1)
    previous[first[some]] = last[some]
    return previous


def boxes(points: Float | Int, start: Int, owner: Int, n_owners: int) -> tuple[Float, Float]:
    """(n_owners, 2) lowest and highest corner of the box around what each owns; infinite, inside out, where nothing.

    Args:
        points: (N, 2)
        start: (R + 1,) run `i` of points is `points[start[i]:start[i + 1]]`; none is empty.
        owner: (R,) of each run, ascending.
        n_owners: how many there are.
    """
    low = np.full((n_owners, 2), np.inf)
    high = -low
    first = np.flatnonzero(run_begins(owner))
    used = owner[first]
    for axis, column in enumerate(np.ascontiguousarray(points.T) if len(used) else ()):
        low[used, axis] = np.minimum.reduceat(column, start[first])
        high[used, axis] = np.maximum.reduceat(column, start[first])
    return low, high


def median(values: Float) -> float:
    """The median of (n,) values, n > 0; `np.median` imports masked arrays for it, which takes 5 ms."""
    ordered = np.sort(values)
    return float((ordered[(len(values) - 1) // 2] + ordered[len(values) // 2]) / 2)


def lengths(xy: Float, start: Int, closed: bool | Bool = True) -> Float:
    """(M,) mm of each line.

    Args:
        xy: (N, 2) mm.
        start: (M + 1,) line `i` has the points `xy[start[i]:start[i + 1]]`, one at least.
        closed: (M,) which return to their first point, which they do not repeat; or whether all do.
    """
    if len(start) < 2:
        return np.zeros(0)
    x, y = np.ascontiguousarray(xy.T)
    following = following_around(start, closed)
    return np.add.reduceat(np.hypot(x.take(following) - x, y.take(following) - y), start[:-1])


def distinct(values: NDArray[_Number]) -> NDArray[_Number]:
    """(m,) each of the values (n,) once, ascending: `numpy.unique`, which loads masked arrays to do it."""
    ordered = np.sort(values)
    return ordered.compress(run_begins(ordered))


def numbered(values: NDArray[_Number]) -> tuple[NDArray[_Number], Int]:
    """(m,) each of the values (n,) once, ascending, and (n,) the place of each value among these; see `distinct`."""
    order = np.argsort(values)
    ordered = values.take(order)
    begins = run_begins(ordered)
    place = np.zeros(len(values), np.int64)
    place[order] = np.cumsum(begins) - 1
    return ordered.compress(begins), place


def run_begins(values: NDArray[_Number]) -> Bool:
    """(n,) whether each value differs from the one before; the first one does."""
    begins = np.ones(len(values), np.bool_)
    np.not_equal(values[1:], values[:-1], out=begins[1:])
    return begins


def renumbered(items: Int, n_items: int) -> tuple[Int, Int]:
    """(m,) those of the items from 0 to `n_items` that occur in `items`, ascending, and `items` in numbers of these."""
    used = np.zeros(n_items, np.bool_)
    used[items] = True
    number = np.cumsum(used) - 1
    return np.flatnonzero(used), number[items]


def placed(xy: Float, place: Int) -> Float:
    """(n, 2) points, each at its place: a permutation of them.

    A point is stored as one complex number, at a sixth of the cost of two numbers.
    """
    result = np.zeros(len(xy), np.complex128)
    result[place] = np.ascontiguousarray(xy).view(np.complex128).ravel()
    return result.view(np.float64).reshape(-1, 2)
