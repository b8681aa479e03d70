"""Routes as ragged polylines, and moving their corners away from the walls they turn around."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from printer_slicer.arrays import Float, Int, consecutive
from printer_slicer.geometry.facet_topology import spread
from printer_slicer.geometry.segment_index import OutlineIndex
from printer_slicer.travels.graphs import FoundRoutes
from printer_slicer.travels.routing_field import Corners

__all__ = ["Routes", "build_routes", "drop_repeated_points", "ease_corners", "straight"]

_TRIES = (1.0, 0.5, 0.0)  # of the way that corners are moved


@dataclass(frozen=True, slots=True, eq=False)
class Routes:
    """Polylines (W,) on layers.

    Attributes:
        xy: (N, 2) mm, with both ends of each.
        count: (W,) points of each, 2 or more.
        layer: (W,) ascending.
    """

    xy: Float
    count: Int
    layer: Int

    @property
    def ends(self) -> tuple[Float, Float]:
        """(W, 2) where each begins, and where it ends."""
        last = np.cumsum(self.count)
        return self.xy[last - self.count], self.xy[last - 1]

    @property
    def legs(self) -> tuple[Int, Int]:
        """(E,) the route of each leg, and the point at which it begins; it ends at the next one."""
        route, place = spread(self.count)
        inner = np.flatnonzero(place < self.count[route] - 1)
        return route[inner], inner

    def length(self) -> Float:
        """(W,) mm."""
        route, point = self.legs
        step = np.hypot(*(self.xy[point + 1] - self.xy[point]).T)
        return np.bincount(route, weights=step, minlength=len(self.count)).astype(np.float64)

    def crossings(self, outlines: OutlineIndex) -> Int:
        """(W,) how often each crosses outlines of its layer."""
        route, point = self.legs
        hits = outlines.crossings(self.xy[point], self.xy[point + 1], self.layer[route])
        return np.bincount(route, weights=hits, minlength=len(self.count)).astype(np.int64)

    def take(self, some: Int) -> Routes:
        """Some of them, ascending."""
        first = np.cumsum(self.count) - self.count
        return Routes(self.xy[consecutive(first[some], self.count[some])], self.count[some], self.layer[some])

    def replaced(self, some: Int, by: Routes) -> Routes:
        """These with `some` (n,) of them, ascending, replaced."""
        order = np.arange(len(self.count))
        order[some] = len(self.count) + np.arange(len(some))
        count = np.concatenate([self.count, by.count])
        first = (np.cumsum(count) - count)[order]
        xy = np.concatenate([self.xy, by.xy])[consecutive(first, count[order])]
        return Routes(xy, count[order], self.layer)


def straight(begin: Float, end: Float, layer: Int) -> Routes:
    """Routes from `begin` to `end` (W, 2)."""
    return Routes(np.stack([begin, end], axis=1).reshape(-1, 2), np.full(len(layer), 2), layer)


def build_routes(
    ends: Routes, entries: tuple[Float, Float], found: FoundRoutes, corners: Corners
) -> tuple[Routes, Int]:
    """The routes that were found, as tight as they are, and (C,) which of their points are corners.

    Args:
        ends: (W,) routes of which only the ends count.
        entries: (W, 2) after the begin and before the end of each.
        found: (W,) the corners between these.
        corners: of the ground.
    """
    count = found.count + 4
    first = np.cumsum(count) - count
    xy = np.zeros((int(count.sum()), 2))
    last = first + count - 1
    xy[first], xy[last] = ends.ends
    xy[first + 1], xy[last - 1] = entries
    owner, place = spread(found.count)
    own = first[owner] + 2 + place
    xy[own] = corners.place[found.corners]
    return Routes(xy, count, ends.layer), own


def ease_corners(
    tight: Routes, own: Int, step: Float, most: tuple[Int, Float], outlines: OutlineIndex
) -> tuple[Routes, Int]:
    """The routes with corners farther away from what they turn around, and how many outlines each crosses.

    Not beyond the middle of what is free there, and not where more outlines are crossed or a route becomes too long.

    Args:
        tight: (W,) routes.
        own: (C,) which of their points are corners.
        step: (C, 2) by which these are moved at most, mm.
        most: (W,) outlines and (W,) mm: a route that crosses more, or is longer, stays tight.
        outlines: that shall not be crossed.
    """
    owner = np.repeat(np.arange(len(tight.count)), tight.count)[own]
    hit, _, share = outlines.crossed(tight.xy[own], tight.xy[own] + 2 * step, tight.layer[owner])
    free = np.ones(len(own))
    np.minimum.at(free, hit, share)
    hits, result = np.zeros(len(tight.count), np.int64), tight
    left = np.arange(len(tight.count))
    for part in _TRIES:
        again = np.zeros(len(tight.count), np.bool_)
        again[left] = True
        xy = result.xy.copy()
        moved = again[owner]
        xy[own[moved]] = tight.xy[own[moved]] + (part * free[:, None] * step)[moved]
        result = Routes(xy, tight.count, tight.layer)
        tried = result.take(left)
        hits[left] = tried.crossings(outlines)
        left = left[(hits[left] > most[0][left]) | (tried.length() > most[1][left])]
        if not len(left):
            break
    return result, hits


def drop_repeated_points(routes: Routes) -> Routes:
    """The routes without points that stand where the one before does."""
    route, place = spread(routes.count)
    kept = (place == 0) | (np.abs(np.diff(routes.xy, axis=0, prepend=np.inf)).max(axis=1) > 0)
    count = np.bincount(route[kept], minlength=len(routes.count))
    return Routes(routes.xy[kept], count.astype(np.int64), routes.layer)
