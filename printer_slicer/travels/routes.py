"""Routes of travels as ragged polylines; corners are moved away from the walls around which routes turn."""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Float, Int, consecutive
from printer_slicer.geometry.facet_topology import expand_counts
from printer_slicer.geometry.segment_index import OutlineIndex
from printer_slicer.travels.graphs import FoundRoutes
from printer_slicer.travels.routing_field import Corners
from printer_slicer.values import Struct

__all__ = ["Routes", "build_routes", "drop_repeated_points", "move_corners_from_walls", "straight_routes"]

_TRIES = (1.0, 0.5, 0.0)  # fractions of the distance by which corners are moved


class Routes(Struct, frozen=True, eq=False):
    """Routes of travels as polylines on layers.

    Attributes:
        xy: (N, 2) mm, points of all routes, including both ends.
        count: (W,) number of points of each route, 2 or more.
        layer: (W,) layer of each route, ascending.
    """

    xy: Float
    count: Int
    layer: Int

    @property
    def ends(self) -> tuple[Float, Float]:
        """Start points (W, 2) and end points (W, 2), mm."""
        last = np.cumsum(self.count)
        return self.xy[last - self.count], self.xy[last - 1]

    @property
    def legs(self) -> tuple[Int, Int]:
        """Route (E,) of each leg, and the point (E,) at which it starts; it ends at the next point."""
        route, place = expand_counts(self.count)
        inner = np.flatnonzero(place < self.count[route] - 1)
        return route[inner], inner

    def length(self) -> Float:
        """Return the length (W,) of each route, mm."""
        route, point = self.legs
        step = np.hypot(*(self.xy[point + 1] - self.xy[point]).T)
        return np.bincount(route, weights=step, minlength=len(self.count)).astype(np.float64)

    def count_crossings(self, outlines: OutlineIndex) -> Int:
        """Count how often (W,) each route crosses outlines of its layer."""
        route, point = self.legs
        hits = outlines.count_crossings(self.xy[point], self.xy[point + 1], self.layer[route])
        return np.bincount(route, weights=hits, minlength=len(self.count)).astype(np.int64)

    def take(self, indices: Int) -> Routes:
        """Return the routes with the given indices, ascending."""
        first = np.cumsum(self.count) - self.count
        count = self.count[indices]
        return Routes(self.xy[consecutive(first[indices], count)], count, self.layer[indices])

    def replace_routes(self, indices: Int, by: Routes) -> Routes:
        """Return all routes, in which the routes at `indices` (n,), ascending, are replaced by the routes `by`."""
        order = np.arange(len(self.count))
        order[indices] = len(self.count) + np.arange(len(indices))
        count = np.concatenate([self.count, by.count])
        first = (np.cumsum(count) - count)[order]
        xy = np.concatenate([self.xy, by.xy])[consecutive(first, count[order])]
        return Routes(xy, count[order], self.layer)


def straight_routes(begin: Float, end: Float, layer: Int) -> Routes:
    """Return straight routes from `begin` to `end` (W, 2), mm."""
    return Routes(np.stack([begin, end], axis=1).reshape(-1, 2), np.full(len(layer), 2), layer)


def build_routes(
    ends: Routes, entries: tuple[Float, Float], found: FoundRoutes, corners: Corners
) -> tuple[Routes, Int]:
    """Build routes that pass close to the corners that the search found.

    Args:
        ends: (W,) routes whose ends are used.
        entries: (W, 2) second point and (W, 2) last but one point of each route.
        found: (W,) the corners between these points.
        corners: corners of the routing field.

    Returns:
        The routes, and the indices (C,) of their points that are corners.
    """
    count = found.count + 4
    first = np.cumsum(count) - count
    xy = np.zeros((int(count.sum()), 2))
    last = first + count - 1
    xy[first], xy[last] = ends.ends
    xy[first + 1], xy[last - 1] = entries
    owner, place = expand_counts(found.count)
    own = first[owner] + 2 + place
    xy[own] = corners.place[found.corners]
    return Routes(xy, count, ends.layer), own


def move_corners_from_walls(
    tight: Routes, own: Int, step: Float, most: tuple[Int, Float], outlines: OutlineIndex
) -> tuple[Routes, Int]:
    """Move the corners of routes away from the walls that they turn around.

    A corner moves at most to the middle of the free space. A route keeps its corners if it would cross more outlines or
    become too long.

    Args:
        tight: (W,) routes close to the walls.
        own: (C,) indices of their points that are corners.
        step: (C, 2) mm, the largest movement of each corner.
        most: (W,) number of outlines that a route may cross, and (W,) its largest length, mm.
        outlines: outlines of the sections.

    Returns:
        The routes, and the number of outlines (W,) that each crosses.
    """
    owner = np.repeat(np.arange(len(tight.count)), tight.count)[own]
    hit, _, share = outlines.find_crossings(tight.xy[own], tight.xy[own] + 2 * step, tight.layer[owner])
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
        hits[left] = tried.count_crossings(outlines)
        left = left[(hits[left] > most[0][left]) | (tried.length() > most[1][left])]
        if not len(left):
            break
    return result, hits


def drop_repeated_points(routes: Routes) -> Routes:
    """Remove points that repeat the previous one."""
    route, place = expand_counts(routes.count)
    kept = (place == 0) | (np.abs(np.diff(routes.xy, axis=0, prepend=np.inf)).max(axis=1) > 0)
    count = np.bincount(route[kept], minlength=len(routes.count))
    return Routes(routes.xy[kept], count.astype(np.int64), routes.layer)
