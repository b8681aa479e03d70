"""Find the shortest routes with a growing set of known obstacles.

At first only the rings that the straight line crosses are known. The shortest route around the known rings is never
longer than the shortest route around all rings. If it meets no other ring, it is the result; otherwise the rings that
it meets become known. The search starts with corners near the straight line, and considers corners farther away only
if it finds no route.
"""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Float, Int
from printer_slicer.geometry.facet_topology import expand_counts
from printer_slicer.travels.graphs import FoundRoutes, RouteQueries, estimate_work, find_cheapest_routes
from printer_slicer.travels.known_obstacles import KnownObstacles
from printer_slicer.travels.routing_field import RoutingField

__all__ = ["find_routes"]

_LONGER = np.array([0.5, 2.0, 8.0, 32.0, np.inf])  # mm longer than the straight line: search ranges
_ROUNDS = 24  # of the search; a route that is not found by then is far from straight
_AT_ONCE = 1 << 20  # legs per batch, to bound the memory
_WORK = 1 << 26  # legs in total, some seconds; the remaining routes stay straight


def find_routes(queries: RouteQueries, field: RoutingField) -> FoundRoutes:
    """Find the cheapest routes, whose cost is the length plus a cost for each crossed outline."""
    n_routes, straight, work = len(queries.own), queries.straight, 0
    is_found, level = np.zeros(n_routes, np.bool_), np.zeros(n_routes, np.int64)
    left, none = np.flatnonzero(straight <= queries.limit), np.zeros(0, np.int64)
    of_route, passed = [none], [none]
    known = KnownObstacles(none, field.areas.n_rings).with_pairs(
        *_find_rings_of_same_field(queries, field, queries.begin, queries.end, np.arange(n_routes))
    )
    for _ in range(_ROUNDS):
        reach = np.minimum(straight + _LONGER[np.minimum(level, len(_LONGER) - 1)], queries.limit)
        parts, looked = _split_batches(left, queries, reach, known, field)
        work += looked
        if work > _WORK:
            break
        for some in parts:
            found = find_cheapest_routes(queries.take(some), reach[some], known.select_routes(some), field)
            route, ring = _find_obstacles(found, queries.take(some), field)
            new = ~known.contains(some[route], ring)
            known = known.with_pairs(some[route[new]], ring[new])
            level[some[~found.is_found]] += 1
            is_found[some] = found.is_found
            is_found[some[route[new]]] = False
            good = is_found[some]
            of_route.append(np.repeat(some[good], found.count[good]))
            passed.append(found.take(np.flatnonzero(good)).corners)
        left = left[~is_found[left] & (level[left] < len(_LONGER))]
        left = left[(level[left] == 0) | (straight[left] + _LONGER[level[left] - 1] < queries.limit[left])]
        if not len(left):
            break
    route, corners = np.concatenate(of_route), np.concatenate(passed)
    order = np.argsort(route, kind="stable")
    return FoundRoutes(is_found, corners[order], np.bincount(route, minlength=n_routes).astype(np.int64))


def _split_batches(
    left: Int, queries: RouteQueries, reach: Float, known: KnownObstacles, field: RoutingField
) -> tuple[list[Int], int]:
    """Split the routes `left` (n,) into batches, and estimate the number of legs to examine."""
    if not len(left):
        return [], 0
    work = np.cumsum(estimate_work(queries.take(left), reach[left], known.select_routes(left), field))
    return np.split(left, np.searchsorted(work, np.arange(_AT_ONCE, work[-1], _AT_ONCE))), int(work[-1])


def _find_obstacles(found: FoundRoutes, queries: RouteQueries, field: RoutingField) -> tuple[Int, Int]:
    """Return pairs of a found route and a ring of its field that the route meets."""
    count = np.where(found.is_found, found.count + 2, 0)
    first = np.cumsum(count) - count
    owner, place = expand_counts(count)
    xy = np.zeros((len(owner), 2))
    some = np.flatnonzero(found.is_found)
    xy[first[some]], xy[first[some] + count[some] - 1] = queries.begin[some], queries.end[some]
    xy[(place > 0) & (place < count[owner] - 1)] = field.corners.place[found.corners]
    leg = np.flatnonzero(place < count[owner] - 1)
    return _find_rings_of_same_field(queries, field, xy[leg], xy[leg + 1], owner[leg])


def _find_rings_of_same_field(
    queries: RouteQueries, field: RoutingField, begin: Float, end: Float, route: Int
) -> tuple[Int, Int]:
    """Return pairs of a route and a ring of its field that one of its legs meets.

    Args:
        queries: the routes.
        field: the routing field.
        begin: (n, 2) start of each leg.
        end: (n, 2) its end.
        route: (n,) its route.
    """
    leg, ring = field.find_crossed_rings(begin, end, queries.layer[route])
    own = field.own[ring] == queries.own[route[leg]]
    return route[leg[own]], ring[own]
