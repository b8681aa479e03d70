"""Compute the maximum at each position of values that each hold over a range of positions.

Two overlapping ranges with a power of two as length cover any range. They are stored by length and start, then passed
down from each length to its half: the sparse table of Bender and Farach-Colton, 2000, filled from the top.
"""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Float, Int

__all__ = ["compute_range_maxima", "find_table_level", "propagate_maxima", "store_range"]


def find_table_level(first: Int, last: Int) -> Int:
    """Return the greatest k (n,) for which 2^k is at most the length of the range `first` to `last`, inclusive."""
    # frexp is exact for integers: length = m * 2^e with 0.5 <= m < 1, so e - 1 is floor(log2(length)).
    return np.asarray(np.frexp((last - first + 1).astype(np.float64))[1].astype(np.int64) - 1)


def store_range(table: Float, first: Int, last: Int, value: Float) -> None:
    """Store values (n,) >= 0 that hold from `first` to `last`, inclusive, in the table (K, n)."""
    level = find_table_level(first, last)
    flat, row = table.reshape(-1), level * table.shape[1]  # one index is several times faster than two
    np.maximum.at(flat, row + first, value)
    np.maximum.at(flat, row + last + 1 - (1 << level), value)


def propagate_maxima(table: Float) -> Float:
    """Return the largest stored value (n,) at each position; overwrites the table (K, n)."""
    for level in range(len(table) - 1, 0, -1):
        half = 1 << (level - 1)
        np.maximum(table[level - 1], table[level], out=table[level - 1])
        np.maximum(table[level - 1, half:], table[level, :-half], out=table[level - 1, half:])
    return np.asarray(table[0])


def compute_range_maxima(first: Int, last: Int, value: Float, n: int) -> Float:
    """Return for each of n positions the largest value >= 0 whose range `first` to `last` (inclusive) contains it."""
    if len(first) == 0:
        return np.zeros(n)
    table = np.zeros((int(find_table_level(first, last).max()) + 1, n))
    store_range(table, first, last, value)
    return propagate_maxima(table)
