"""The shortest ways, found by learning what stands in them.

At first only the rings are known that the straight way crosses. The shortest way that avoids what is known is never
longer than the shortest of all; if it meets no other ring it is that one, otherwise the rings that it meets become
known. Corners are first looked at where ways pass that are hardly longer than the straight one, and farther away only
where there is none.
"""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Float, Int
from printer_slicer.geometry.facet_topology import spread
from printer_slicer.travels.graphs import FoundRoutes, RouteQueries, estimate_work, find_cheapest_routes
from printer_slicer.travels.known_obstacles import KnownObstacles
from printer_slicer.travels.routing_field import RoutingField

__all__ = ["find_routes"]

_LONGER = np.array([0.5, 2.0, 8.0, 32.0, np.inf])  # mm than the straight way: where it is sought
_ROUNDS = 24  # of learning; what is not found then is far from straight
_AT_ONCE = 1 << 20  # legs that are looked at: what is compared stays small
_WORK = 1 << 26  # legs that are looked at in all: seconds; ways that are left then are straight


def find_routes(asked: RouteQueries, ground: RoutingField) -> FoundRoutes:
    """Find the shortest routes, including tolls for crossed outlines."""
    n_ways, straight, work = len(asked.own), asked.straight, 0
    there, level = np.zeros(n_ways, np.bool_), np.zeros(n_ways, np.int64)
    left, none = np.flatnonzero(straight <= asked.limit), np.zeros(0, np.int64)
    of_way, passed = [none], [none]
    known = KnownObstacles(none, ground.areas.n_rings).joined(
        *_own(asked, ground, asked.begin, asked.end, np.arange(n_ways))
    )
    for _ in range(_ROUNDS):
        reach = np.minimum(straight + _LONGER[np.minimum(level, len(_LONGER) - 1)], asked.limit)
        parts, looked = _parts(left, asked, reach, known, ground)
        work += looked
        if work > _WORK:
            break
        for some in parts:
            found = find_cheapest_routes(asked.take(some), reach[some], known.of(some), ground)
            way, ring = _met(found, asked.take(some), ground)
            new = ~known.holds(some[way], ring)
            known = known.joined(some[way[new]], ring[new])
            level[some[~found.there]] += 1
            there[some] = found.there
            there[some[way[new]]] = False
            good = there[some]
            of_way.append(np.repeat(some[good], found.count[good]))
            passed.append(found.take(np.flatnonzero(good)).corners)
        left = left[~there[left] & (level[left] < len(_LONGER))]
        left = left[(level[left] == 0) | (straight[left] + _LONGER[level[left] - 1] < asked.limit[left])]
        if not len(left):
            break
    way, corners = np.concatenate(of_way), np.concatenate(passed)
    order = np.argsort(way, kind="stable")
    return FoundRoutes(there, corners[order], np.bincount(way, minlength=n_ways).astype(np.int64))


def _parts(
    left: Int, asked: RouteQueries, reach: Float, known: KnownObstacles, ground: RoutingField
) -> tuple[list[Int], int]:
    """The ways `left` (n,), some at a time, and how many legs are looked at for them."""
    if not len(left):
        return [], 0
    work = np.cumsum(estimate_work(asked.take(left), reach[left], known.of(left), ground))
    return np.split(left, np.searchsorted(work, np.arange(_AT_ONCE, work[-1], _AT_ONCE))), int(work[-1])


def _met(found: FoundRoutes, asked: RouteQueries, ground: RoutingField) -> tuple[Int, Int]:
    """Which of the ways that are there meet which rings of their field."""
    count = np.where(found.there, found.count + 2, 0)
    first = np.cumsum(count) - count
    owner, place = spread(count)
    xy = np.zeros((len(owner), 2))
    some = np.flatnonzero(found.there)
    xy[first[some]], xy[first[some] + count[some] - 1] = asked.begin[some], asked.end[some]
    xy[(place > 0) & (place < count[owner] - 1)] = ground.corners.place[found.corners]
    leg = np.flatnonzero(place < count[owner] - 1)
    return _own(asked, ground, xy[leg], xy[leg + 1], owner[leg])


def _own(asked: RouteQueries, ground: RoutingField, begin: Float, end: Float, way: Int) -> tuple[Int, Int]:
    """The ways (n,) whose legs from `begin` to `end` (n, 2) meet rings of their own field, and these rings."""
    leg, ring = ground.met(begin, end, asked.layer[way])
    own = ground.own[ring] == asked.own[way[leg]]
    return way[leg[own]], ring[own]
