"""The legs of which a way may be made: from corner to corner that is seen from it.

A shortest way turns only at corners that stick into its field, and passes each so that both sides of the corner lie on
the same hand. A corner that lies on a way no longer than `l` has distances to the two ends that add up to no more than
`l`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, consecutive, run_starts
from printer_slicer.geometry.facet_topology import spread
from printer_slicer.geometry.vectors import cross
from printer_slicer.travels.known_obstacles import KnownObstacles
from printer_slicer.travels.routing_field import OFF, RoutingField
from printer_slicer.travels.shortest_paths import GraphEdges, find_shortest_paths

__all__ = ["FoundRoutes", "RouteQueries", "estimate_work", "find_cheapest_routes"]

_MOST = 1024  # corners that are looked at for a way, those that make it least longer
_AHEAD = 32  # corners farther along the way to which legs are looked at: where there are no more, all of them


@dataclass(frozen=True, slots=True, eq=False)
class RouteQueries:
    """Ways to be found.

    Attributes:
        begin, end: (W, 2) mm.
        layer: (W,) on which they are.
        own: (W,) the field of the ground in which both ends lie.
        limit: (W,) mm; longer ways are of no use.
        free: (W,) mm of tolls that no way can avoid, and that do not count.
    """

    begin: Float
    end: Float
    layer: Int
    own: Int
    limit: Float
    free: Float

    def take(self, some: Int) -> RouteQueries:
        """Some of them."""
        names = ("begin", "end", "layer", "own", "limit", "free")
        return RouteQueries(*(getattr(self, name)[some] for name in names))

    @property
    def straight(self) -> Float:
        """(W,) mm from begin to end."""
        return np.asarray(np.hypot(*(self.end - self.begin).T))


@dataclass(frozen=True, slots=True, eq=False)
class FoundRoutes:
    """Ways that were found.

    Attributes:
        there: (W,) for which of those asked for there is one within its limit.
        corners: of the ground, that these pass, one after the other.
        count: (W,) how many of them each way passes, 0 where there is none.
    """

    there: Bool
    corners: Int
    count: Int

    def take(self, some: Int) -> FoundRoutes:
        """Some of them."""
        first = np.cumsum(self.count) - self.count
        corners = self.corners[consecutive(first[some], self.count[some])]
        return FoundRoutes(self.there[some], corners, self.count[some])


def estimate_work(asked: RouteQueries, reach: Float, known: KnownObstacles, ground: RoutingField) -> Int:
    """(W,) how many legs are looked at for each way, about."""
    way, ring = known.pairs
    _, count = _window(asked, reach, way, ring, ground)
    total = np.bincount(way, weights=count, minlength=len(asked.own)).astype(np.int64)
    seen = np.minimum(total, _MOST)
    return np.asarray(total + seen * np.minimum(seen, _AHEAD))


def find_cheapest_routes(
    asked: RouteQueries, reach: Float, known: KnownObstacles, ground: RoutingField
) -> FoundRoutes:
    """The shortest ways of no more than `reach` (W,) mm, tolls counted, if there were only the known rings."""
    n_ways = len(asked.own)
    seen = _seen(asked, reach, known, ground)
    begin, end = (np.arange(n_ways) + len(seen.way) + more for more in (0, n_ways))
    meeting = ground.met(asked.begin, asked.end, asked.layer)
    straight = _priced(asked.straight, np.arange(n_ways), meeting, known, ground)
    links = [
        GraphEdges(begin, end, straight),
        *_spokes((asked.begin, begin), (asked.end, end), asked, seen, known, ground),
        *_chords(reach, asked, seen, known, ground),
    ]
    cost, nodes, count = find_shortest_paths(GraphEdges.joined(links), begin, end, len(seen.way) + 2 * n_ways)
    there = cost <= reach + asked.free
    return FoundRoutes(there, seen.corner[nodes[np.repeat(there, count)]], np.where(there, count, 0))


@dataclass(frozen=True, slots=True, eq=False)
class _Seen:
    """The corners that may be on each way: (S,) entries, by way, and along it.

    Attributes:
        way: (S,) of each.
        corner: (S,) of the ground.
        coming, going: (S,) mm from the begin of the way, and to its end.
        count: (W,) how many each way has.
    """

    way: Int
    corner: Int
    coming: Float
    going: Float
    count: Int


def _window(asked: RouteQueries, reach: Float, way: Int, ring: Int, ground: RoutingField) -> tuple[Int, Int]:
    """(n,) the first corner of each ring that may lie on the way with it, and how many follow, by their x."""
    middle, half = (asked.begin + asked.end)[:, 0] / 2, (asked.end - asked.begin)[:, 1] / 2
    wide = np.sqrt(np.maximum(reach**2 / 4 - half**2, 0.0))  # of the ellipse around both ends
    return ground.between((middle - wide)[way], (middle + wide)[way], ring)


def _seen(asked: RouteQueries, reach: Float, known: KnownObstacles, ground: RoutingField) -> _Seen:
    """The corners of known rings within the ellipse of each way."""
    way, ring = known.pairs
    first, count = _window(asked, reach, way, ring, ground)
    way, corner = np.repeat(way, count), consecutive(first, count)
    place = ground.corners.place[corner]
    coming, going = (np.hypot(*(place - ends[way]).T) for ends in (asked.begin, asked.end))
    near = np.flatnonzero(coming + going <= reach[way])
    order = near[np.lexsort(((coming + going)[near], way[near]))]
    total = np.bincount(way[order], minlength=len(asked.own))
    kept = order[spread(total)[1] < _MOST]
    kept = kept[np.lexsort(((coming - going)[kept], way[kept]))]
    return _Seen(way[kept], corner[kept], coming[kept], going[kept], np.minimum(total, _MOST))


_Ends = tuple[Float, Int]  # (W, 2) places and (W,) nodes


def _spokes(  # noqa: PLR0917 - both ends are of one kind
    begin: _Ends, end: _Ends, asked: RouteQueries, seen: _Seen, known: KnownObstacles, ground: RoutingField
) -> list[GraphEdges]:
    """The legs from the begins of ways to corners, and from corners to the ends."""
    made, rank = [], spread(seen.count)[1]
    last = seen.count[seen.way] - 1 - rank
    for (ends, nodes), length, ahead in ((begin, seen.coming, rank), (end, seen.going, last)):
        some = np.flatnonzero(ahead < _AHEAD)
        if np.isinf(ground.toll):  # a leg that crosses the outline of its corner may leave it on any hand
            some = some[_passes(ends[seen.way[some]], seen.corner[some], ground)]
        way = seen.way[some]
        meeting = ground.met(ends[way], ground.corners.place[seen.corner[some]], asked.layer[way])
        made.append((nodes[way], some, _priced(length[some], way, meeting, known, ground)))
    (near, first, out), (far, last, back) = made
    return [GraphEdges(near, first, out), GraphEdges(last, far, back)]


def _chords(
    reach: Float, asked: RouteQueries, seen: _Seen, known: KnownObstacles, ground: RoutingField
) -> list[GraphEdges]:
    """The legs between corners of the same way, in both directions."""
    place = ground.corners.place
    more = np.minimum(seen.count[seen.way] - spread(seen.count)[1] - 1, _AHEAD)
    one = np.repeat(np.arange(len(seen.way)), more)
    other = consecutive(np.arange(len(seen.way)) + 1, more)
    a, b = seen.corner[one], seen.corner[other]
    some = np.flatnonzero(_passes(place[a], b, ground))
    some = some[_passes(place[b[some]], a[some], ground)]
    one, other, a, b = one[some], other[some], a[some], b[some]
    length = np.hypot(*(place[b] - place[a]).T)
    around = np.minimum(seen.coming[one] + seen.going[other], seen.coming[other] + seen.going[one])
    way = seen.way[one]
    some = np.flatnonzero((length + around <= reach[way]) & (length > OFF))
    one, other, a, b, way = (values[some] for values in (one, other, a, b, way))
    length = length[some]
    # The same two corners are seen from many ways: what stands between them is looked up once.
    key = np.minimum(a, b) * len(place) + np.maximum(a, b)
    order = np.argsort(key, kind="stable")
    begins = run_starts(key[order])
    first, number = order[begins], np.zeros(len(key), np.int64)
    number[order] = np.cumsum(begins) - 1
    p, q = np.divmod(key[first], max(len(place), 1))
    met, ring = ground.met(place[p], place[q], asked.layer[way[first]])
    order = np.argsort(met, kind="stable")
    times = np.bincount(met, minlength=len(first))
    begin = (np.cumsum(times) - times)[number]
    leg = np.repeat(np.arange(len(way)), times[number])
    rings = ring[order][consecutive(begin, times[number])]
    cost = _priced(length, way, (leg, rings), known, ground)
    return [GraphEdges(one, other, cost), GraphEdges(other, one, cost)]


def _priced(
    length: Float, way: Int, meeting: tuple[Int, Int], known: KnownObstacles, ground: RoutingField
) -> Float:
    """(n,) mm of legs with the tolls of the known rings that they meet; inf where they may not go."""
    leg, ring = meeting
    hits = np.bincount(leg[known.holds(way[leg], ring)], minlength=len(length))
    return np.asarray(length + np.where(hits > 0, ground.toll * np.maximum(hits, 1), 0.0))


def _passes(place: Float, corner: Int, ground: RoutingField) -> Bool:
    """(n,) whether a leg from `place` (n, 2) passes the corner (n,) with both of its sides on the same hand."""
    corners = ground.corners
    tip = corners.tip[corner]
    leg = tip - place
    one, other = cross(leg, corners.before[corner] - tip), cross(leg, corners.after[corner] - tip)
    return np.asarray(one * other >= 0)
