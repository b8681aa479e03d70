"""Pairs of routes and the rings that are known to block them."""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Bool, Int, consecutive, distinct
from printer_slicer.values import Struct

__all__ = ["KnownObstacles"]


class KnownObstacles(Struct, frozen=True, eq=False):
    """Pairs of a route and a ring that blocks it.

    Attributes:
        key: (K,) route times `n_rings` plus ring, ascending.
        n_rings: number of rings of the routing field.
    """

    key: Int
    n_rings: int

    @property
    def pairs(self) -> tuple[Int, Int]:
        """Routes (K,), ascending, and rings (K,)."""
        route, ring = np.divmod(self.key, max(self.n_rings, 1))
        return route, ring

    def contains(self, route: Int, ring: Int) -> Bool:
        """Return a mask (n,) of the given pairs of a route and a ring that are known."""
        key = route * self.n_rings + ring
        place = np.searchsorted(self.key, key)
        return np.asarray(np.append(self.key, -1)[place] == key)

    def with_pairs(self, route: Int, ring: Int) -> KnownObstacles:
        """Return these pairs together with new pairs of a route and a ring."""
        return KnownObstacles(distinct(np.concatenate([self.key, route * self.n_rings + ring])), self.n_rings)

    def select_routes(self, routes: Int) -> KnownObstacles:
        """Return the pairs of the routes with these indices (n,), ascending; the routes are renumbered from 0."""
        first = np.searchsorted(self.key, routes * self.n_rings)
        count = np.searchsorted(self.key, (routes + 1) * self.n_rings) - first
        own = np.repeat(np.arange(len(routes)) - routes, count)
        return KnownObstacles(self.key[consecutive(first, count)] + own * self.n_rings, self.n_rings)
