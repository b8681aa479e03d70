"""Remove contacts that steeper contacts cover everywhere, because they add nothing to a bound."""

from __future__ import annotations

from typing import Final

import numpy as np

from printer_slicer.arrays import Bool, Float
from printer_slicer.surface.range_maximum import find_table_level, propagate_maxima, store_range

__all__ = ["Envelope"]

_BIN: Final = 0.01  # mm
_MAX_BINS: Final = 1 << 16


class Envelope:
    """The steepest rise in each bin of z; contacts that are less steep everywhere add nothing to a bound.

    A contact counts in a run from its lowest z on, or from the start of the run if that is higher. If steeper contacts
    cover all of its heights, they add at least as much to every run. They may in turn be covered by others; the
    steepest ones remain.
    """

    def __init__(self, bottom: float, size: float, n: int) -> None:
        self._bottom, self._size, self._n = bottom, size, n
        # Steepest cover of 2^k bins, by k and the first bin.
        self._covers = np.zeros((n.bit_length(), n))
        self._least: list[Float] = [np.zeros(n)]

    @classmethod
    def between_heights(cls, bottom: float, top: float) -> Envelope:
        """Return an empty envelope for a part between two heights, mm."""
        n = int(np.clip((top - bottom) / _BIN, 1, _MAX_BINS))
        return cls(bottom, max((top - bottom) / n, 1e-12), n)

    def add(self, low: Float, high: Float, rise: Float) -> None:
        """Add contacts (n,) to the envelope; only contacts that cover whole bins change it."""
        first = np.maximum(np.ceil((low - self._bottom) / self._size).astype(np.int64), 0)
        last = np.minimum(np.floor((high - self._bottom) / self._size).astype(np.int64), self._n) - 1
        some = np.flatnonzero(first <= last)
        first, last, rise = first[some], last[some], rise[some]
        store_range(self._covers, first, last, rise)
        # Minimum over 2^k bins, by first bin.
        self._least = [propagate_maxima(self._covers.copy())]
        for k in range(len(self._covers) - 1):
            shorter = self._least[-1]
            self._least.append(np.minimum(shorter[: -(1 << k)], shorter[1 << k :]))

    def is_uncovered(self, low: Float, high: Float, rise: Float) -> Bool:
        """Return a mask (n,) of contacts that reach the envelope at some height."""
        first, last = (
            np.clip(np.floor((z - self._bottom) / self._size).astype(np.int64), 0, self._n - 1)
            for z in (low, high)
        )
        level = find_table_level(first, last)
        least = np.zeros(len(rise))
        for k, table in enumerate(self._least):
            some = np.flatnonzero(level == k)
            least[some] = np.minimum(table[first[some]], table[last[some] + 1 - (1 << k)])
        return np.asarray(rise >= least)
