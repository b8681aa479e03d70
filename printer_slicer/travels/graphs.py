"""Visibility graphs for travels: the legs from corner to corner that a route may use.

A shortest route turns only at corners that stick into its field, and passes each with both sides of the corner on the
same side of the route. A corner on a route of length `l` lies in an ellipse: its distances to the two ends of the
route add up to at most `l`.
"""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, consecutive, run_starts
from printer_slicer.geometry.facet_topology import expand_counts
from printer_slicer.geometry.vectors import cross
from printer_slicer.travels.known_obstacles import KnownObstacles
from printer_slicer.travels.routing_field import OFF, RoutingField
from printer_slicer.travels.shortest_paths import GraphEdges, find_shortest_paths
from printer_slicer.values import Struct

__all__ = ["FoundRoutes", "RouteQueries", "estimate_work", "find_cheapest_routes"]

_MAX_CORNERS = 1024  # considered for each route; those with the shortest detours
_AHEAD = 32  # legs from a corner lead at most to this many of the next corners along the route


class RouteQueries(Struct, frozen=True, eq=False):
    """Routes to search for.

    Attributes:
        begin, end: (W, 2) mm.
        layer: (W,) layer of each route.
        own: (W,) the field in which both ends lie.
        limit: (W,) mm; longer routes are not used.
        free: (W,) mm, crossing costs that no route can avoid, and that do not count.
    """

    begin: Float
    end: Float
    layer: Int
    own: Int
    limit: Float
    free: Float

    def take(self, indices: Int) -> RouteQueries:
        """Return the queries with the given indices."""
        names = ("begin", "end", "layer", "own", "limit", "free")
        return RouteQueries(*(getattr(self, name)[indices] for name in names))

    @property
    def straight(self) -> Float:
        """Straight distances (W,) from begin to end, mm."""
        return np.asarray(np.hypot(*(self.end - self.begin).T))


class FoundRoutes(Struct, frozen=True, eq=False):
    """Routes that were found.

    Attributes:
        is_found: (W,) whether a route within the limit was found.
        corners: (C,) indices of the corners on the routes, one route after the other.
        count: (W,) number of corners on each route; 0 where no route was found.
    """

    is_found: Bool
    corners: Int
    count: Int

    def take(self, indices: Int) -> FoundRoutes:
        """Return the routes with the given indices."""
        first = np.cumsum(self.count) - self.count
        corners = self.corners[consecutive(first[indices], self.count[indices])]
        return FoundRoutes(self.is_found[indices], corners, self.count[indices])


def estimate_work(queries: RouteQueries, reach: Float, known: KnownObstacles, field: RoutingField) -> Int:
    """Estimate the number of legs (W,) to examine for each route."""
    route, ring = known.pairs
    _, count = _find_corner_range(queries, reach, route, ring, field)
    total = np.bincount(route, weights=count, minlength=len(queries.own)).astype(np.int64)
    candidates = np.minimum(total, _MAX_CORNERS)
    return np.asarray(total + candidates * np.minimum(candidates, _AHEAD))


def find_cheapest_routes(
    queries: RouteQueries, reach: Float, known: KnownObstacles, field: RoutingField
) -> FoundRoutes:
    """Find the cheapest routes of at most `reach` (W,) mm with crossing costs, considering only the known rings."""
    n_routes = len(queries.own)
    candidates = _find_candidates(queries, reach, known, field)
    begin, end = (np.arange(n_routes) + len(candidates.route) + more for more in (0, n_routes))
    crossings = field.find_crossed_rings(queries.begin, queries.end, queries.layer)
    straight = _add_crossing_costs(queries.straight, np.arange(n_routes), crossings, known, field)
    links = [
        GraphEdges(begin, end, straight),
        *_find_legs_to_ends((queries.begin, begin), (queries.end, end), queries, candidates, known, field),
        *_find_legs_between_corners(reach, queries, candidates, known, field),
    ]
    cost, nodes, count = find_shortest_paths(
        GraphEdges.joined(links), begin, end, len(candidates.route) + 2 * n_routes
    )
    is_found = cost <= reach + queries.free
    return FoundRoutes(
        is_found, candidates.corner[nodes[np.repeat(is_found, count)]], np.where(is_found, count, 0)
    )


class _CandidateCorners(Struct, frozen=True, eq=False):
    """Corners that may lie on each route, sorted by route and along the route.

    Attributes:
        route: (S,) route of each entry.
        corner: (S,) index of the corner.
        coming, going: (S,) mm from the start of the route, and to its end.
        count: (W,) number of entries of each route.
    """

    route: Int
    corner: Int
    coming: Float
    going: Float
    count: Int


def _find_corner_range(
    queries: RouteQueries, reach: Float, route: Int, ring: Int, field: RoutingField
) -> tuple[Int, Int]:
    """Return the first corner (n,) and the number of corners (n,), by x, of each ring that may lie on its route."""
    middle, half = (queries.begin + queries.end)[:, 0] / 2, (queries.end - queries.begin)[:, 1] / 2
    wide = np.sqrt(np.maximum(reach**2 / 4 - half**2, 0.0))  # of the ellipse around both ends
    return field.find_corners_between((middle - wide)[route], (middle + wide)[route], ring)


def _find_candidates(
    queries: RouteQueries, reach: Float, known: KnownObstacles, field: RoutingField
) -> _CandidateCorners:
    """Find the corners of known rings within the ellipse around each route."""
    route, ring = known.pairs
    first, count = _find_corner_range(queries, reach, route, ring, field)
    route, corner = np.repeat(route, count), consecutive(first, count)
    place = field.corners.place[corner]
    coming, going = (np.hypot(*(place - ends[route]).T) for ends in (queries.begin, queries.end))
    near = np.flatnonzero(coming + going <= reach[route])
    order = near[np.lexsort(((coming + going)[near], route[near]))]
    total = np.bincount(route[order], minlength=len(queries.own))
    kept = order[expand_counts(total)[1] < _MAX_CORNERS]
    kept = kept[np.lexsort(((coming - going)[kept], route[kept]))]
    return _CandidateCorners(
        route[kept], corner[kept], coming[kept], going[kept], np.minimum(total, _MAX_CORNERS)
    )


_Ends = tuple[Float, Int]  # (W, 2) positions and (W,) nodes


def _find_legs_to_ends(  # noqa: PLR0917 - both ends are of one kind
    begin: _Ends,
    end: _Ends,
    queries: RouteQueries,
    candidates: _CandidateCorners,
    known: KnownObstacles,
    field: RoutingField,
) -> list[GraphEdges]:
    """Return the legs from the starts of routes to corners, and from corners to the ends."""
    made, rank = [], expand_counts(candidates.count)[1]
    last = candidates.count[candidates.route] - 1 - rank
    for (ends, nodes), length, ahead in ((begin, candidates.coming, rank), (end, candidates.going, last)):
        some = np.flatnonzero(ahead < _AHEAD)
        if np.isinf(field.toll):  # a leg that may cross the outline of its corner may pass it on any side
            some = some[_passes_on_one_side(ends[candidates.route[some]], candidates.corner[some], field)]
        route = candidates.route[some]
        crossings = field.find_crossed_rings(
            ends[route], field.corners.place[candidates.corner[some]], queries.layer[route]
        )
        made.append((nodes[route], some, _add_crossing_costs(length[some], route, crossings, known, field)))
    (near, first, out), (far, last, back) = made
    return [GraphEdges(near, first, out), GraphEdges(last, far, back)]


def _find_legs_between_corners(
    reach: Float,
    queries: RouteQueries,
    candidates: _CandidateCorners,
    known: KnownObstacles,
    field: RoutingField,
) -> list[GraphEdges]:
    """Return the legs between corners of the same route, in both directions."""
    place = field.corners.place
    more = np.minimum(candidates.count[candidates.route] - expand_counts(candidates.count)[1] - 1, _AHEAD)
    one = np.repeat(np.arange(len(candidates.route)), more)
    other = consecutive(np.arange(len(candidates.route)) + 1, more)
    a, b = candidates.corner[one], candidates.corner[other]
    some = np.flatnonzero(_passes_on_one_side(place[a], b, field))
    some = some[_passes_on_one_side(place[b[some]], a[some], field)]
    one, other, a, b = one[some], other[some], a[some], b[some]
    length = np.hypot(*(place[b] - place[a]).T)
    around = np.minimum(
        candidates.coming[one] + candidates.going[other], candidates.coming[other] + candidates.going[one]
    )
    route = candidates.route[one]
    some = np.flatnonzero((length + around <= reach[route]) & (length > OFF))
    one, other, a, b, route = (values[some] for values in (one, other, a, b, route))
    length = length[some]
    # Many routes share the same pair of corners: look up the obstacles between them once.
    key = np.minimum(a, b) * len(place) + np.maximum(a, b)
    order = np.argsort(key, kind="stable")
    begins = run_starts(key[order])
    first, number = order[begins], np.zeros(len(key), np.int64)
    number[order] = np.cumsum(begins) - 1
    p, q = np.divmod(key[first], max(len(place), 1))
    met, ring = field.find_crossed_rings(place[p], place[q], queries.layer[route[first]])
    order = np.argsort(met, kind="stable")
    times = np.bincount(met, minlength=len(first))
    begin = (np.cumsum(times) - times)[number]
    leg = np.repeat(np.arange(len(route)), times[number])
    rings = ring[order][consecutive(begin, times[number])]
    cost = _add_crossing_costs(length, route, (leg, rings), known, field)
    return [GraphEdges(one, other, cost), GraphEdges(other, one, cost)]


def _add_crossing_costs(
    length: Float, route: Int, crossings: tuple[Int, Int], known: KnownObstacles, field: RoutingField
) -> Float:
    """Return the cost (n,) of legs, mm: length plus crossing costs of known rings; inf for forbidden legs."""
    leg, ring = crossings
    hits = np.bincount(leg[known.contains(route[leg], ring)], minlength=len(length))
    return np.asarray(length + np.where(hits > 0, field.toll * np.maximum(hits, 1), 0.0))


def _passes_on_one_side(place: Float, corner: Int, field: RoutingField) -> Bool:
    """Return a mask (n,) of legs from `place` (n, 2) to a corner (n,) whose two edges are on one side of the leg."""
    corners = field.corners
    tip = corners.tip[corner]
    leg = tip - place
    one, other = cross(leg, corners.before[corner] - tip), cross(leg, corners.after[corner] - tip)
    return np.asarray(one * other >= 0)
