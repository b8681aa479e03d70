"""Rings that are known to block each route."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from printer_slicer.arrays import Bool, Int, consecutive, distinct

__all__ = ["KnownObstacles"]


@dataclass(frozen=True, slots=True, eq=False)
class KnownObstacles:
    """Which rings are known to stand in which way.

    Attributes:
        key: ascending, way times `n_rings` plus ring.
        n_rings: of the ground.
    """

    key: Int
    n_rings: int

    @property
    def pairs(self) -> tuple[Int, Int]:
        """Ways, ascending, and rings."""
        way, ring = np.divmod(self.key, max(self.n_rings, 1))
        return way, ring

    def holds(self, way: Int, ring: Int) -> Bool:
        """(n,) which of some pairs are known."""
        asked = way * self.n_rings + ring
        place = np.searchsorted(self.key, asked)
        return np.asarray(np.append(self.key, -1)[place] == asked)

    def joined(self, way: Int, ring: Int) -> KnownObstacles:
        """With more pairs."""
        return KnownObstacles(distinct(np.concatenate([self.key, way * self.n_rings + ring])), self.n_rings)

    def of(self, ways: Int) -> KnownObstacles:
        """Those of some ways (n,), ascending, which are then 0, 1, ...."""
        first = np.searchsorted(self.key, ways * self.n_rings)
        count = np.searchsorted(self.key, (ways + 1) * self.n_rings) - first
        own = np.repeat(np.arange(len(ways)) - ways, count)
        return KnownObstacles(self.key[consecutive(first, count)] + own * self.n_rings, self.n_rings)
