"""Filter contacts that steeper contacts cover everywhere, because they add nothing to a bound."""

from __future__ import annotations

from typing import Final

import numpy as np

from printer_slicer.arrays import Bool, Float
from printer_slicer.surface.range_maximum import level_of, note_range, spread_maxima

__all__ = ["Envelope"]

_BIN: Final = 0.01  # mm
_MOST_BINS: Final = 1 << 16


class Envelope:
    """The steepest rise at every height, in bins of z: what lies under it everywhere adds nothing to any run.

    A contact counts in a run from its lowest z on, or from the start of the run if it reaches over that; so does each
    other one. Where others that are steeper cover all of its heights, whatever it would add they add too. They may
    themselves be covered by others; the steepest of all stay.
    """

    def __init__(self, bottom: float, size: float, n: int) -> None:
        self._bottom, self._size, self._n = bottom, size, n
        # Covers of 2^k bins, by k and the first of them.
        self._covers = np.zeros((n.bit_length(), n))
        self._least: list[Float] = [np.zeros(n)]

    @classmethod
    def over(cls, bottom: float, top: float) -> Envelope:
        """An empty one for a part between two heights, mm."""
        n = int(np.clip((top - bottom) / _BIN, 1, _MOST_BINS))
        return cls(bottom, max((top - bottom) / n, 1e-12), n)

    def add(self, low: Float, high: Float, rise: Float) -> None:
        """Contacts (n,) that cover whole bins."""
        first = np.maximum(np.ceil((low - self._bottom) / self._size).astype(np.int64), 0)
        last = np.minimum(np.floor((high - self._bottom) / self._size).astype(np.int64), self._n) - 1
        some = np.flatnonzero(first <= last)
        first, last, rise = first[some], last[some], rise[some]
        note_range(self._covers, first, last, rise)
        # The least of 2^k bins from each on.
        self._least = [spread_maxima(self._covers.copy())]
        for k in range(len(self._covers) - 1):
            shorter = self._least[-1]
            self._least.append(np.minimum(shorter[: -(1 << k)], shorter[1 << k :]))

    def shows(self, low: Float, high: Float, rise: Float) -> Bool:
        """(n,) which contacts are not under it everywhere."""
        first, last = (
            np.clip(np.floor((z - self._bottom) / self._size).astype(np.int64), 0, self._n - 1)
            for z in (low, high)
        )
        level = level_of(first, last)
        least = np.zeros(len(rise))
        for k, table in enumerate(self._least):
            some = np.flatnonzero(level == k)
            least[some] = np.minimum(table[first[some]], table[last[some] + 1 - (1 << k)])
        return np.asarray(rise >= least)
