"""Find the largest of the values whose range covers each position.

A range is covered by two overlapping ones whose length is a power of two; those are noted by length and start, and
handed down from each length to its half: the sparse table of Bender and Farach-Colton, 2000, filled from above.
"""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Float, Int

__all__ = ["level_of", "note_range", "paint_maxima", "spread_maxima"]


def level_of(first: Int, last: Int) -> Int:
    """(n,) the greatest k with 2^k no more than the length of the range from `first` to `last`, inclusive."""
    # frexp is exact for integers: length = m * 2^e with 0.5 <= m < 1, so e - 1 is floor(log2(length)).
    return np.asarray(np.frexp((last - first + 1).astype(np.float64))[1].astype(np.int64) - 1)


def note_range(notes: Float, first: Int, last: Int, value: Float) -> None:
    """Note values (n,), all at least 0, of ranges from `first` to `last`, inclusive, in a table (K, n) by level."""
    level = level_of(first, last)
    np.maximum.at(notes, (level, first), value)
    np.maximum.at(notes, (level, last + 1 - (1 << level)), value)


def spread_maxima(notes: Float) -> Float:
    """(n,) the largest value over each place; the table (K, n) is used up."""
    for level in range(len(notes) - 1, 0, -1):
        half = 1 << (level - 1)
        np.maximum(notes[level - 1], notes[level], out=notes[level - 1])
        np.maximum(notes[level - 1, half:], notes[level, :-half], out=notes[level - 1, half:])
    return np.asarray(notes[0])


def paint_maxima(first: Int, last: Int, value: Float, n: int) -> Float:
    """(n,) the largest of the values, all at least 0, whose range `first` to `last` (inclusive) covers each place."""
    if len(first) == 0:
        return np.zeros(n)
    notes = np.zeros((int(level_of(first, last).max()) + 1, n))
    note_range(notes, first, last, value)
    return spread_maxima(notes)
