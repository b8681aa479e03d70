"""The shortest ways: around corners, from one to the next that is seen from it.

A shortest way turns only at corners that stick into its field, and passes each so that both sides of the corner lie on
the same hand. A corner that lies on a way no longer than `l` has distances to the two ends that add up to no more than
`l`. So few corners are looked at when ways are first sought that are hardly longer than the straight ones, and more of
them only where there is none; what is found first is the shortest.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from printer_slicer.geometry.areas import consecutive
from printer_slicer.geometry.planes import spread
from printer_slicer.geometry.vectors import cross
from printer_slicer.model import Bool, Float, Int
from printer_slicer.travels.ground import OFF, Ground
from printer_slicer.travels.shortest import Links, shortest

__all__ = ["Asked", "Found", "routed"]

_LONGER = (0.5, 2.0, 8.0, 32.0, np.inf)  # mm than the straight way: where it is sought round by round
_MOST = 128  # corners that are looked at for a way, those that make it least longer
_AT_ONCE = 1 << 20  # legs that are looked at: what is compared stays small


@dataclass(frozen=True, slots=True, eq=False)
class Asked:
    """Ways to be found.

    Attributes:
        begin, end: (W, 2) mm.
        own: (W,) the field of the ground in which both lie.
        limit: (W,) mm; longer ways are of no use.
        free: (W,) mm of tolls that no way can avoid, and that do not count.
    """

    begin: Float
    end: Float
    own: Int
    limit: Float
    free: Float

    def take(self, some: Int) -> Asked:
        """Some of them."""
        return Asked(*(getattr(self, name)[some] for name in ("begin", "end", "own", "limit", "free")))


@dataclass(frozen=True, slots=True, eq=False)
class Found:
    """Ways that were found.

    Attributes:
        there: (W,) for which of those asked for there is one within its limit.
        corners: of the ground, that these pass, one after the other.
        count: (W,) how many of them each way passes, 0 where there is none.
    """

    there: Bool
    corners: Int
    count: Int

    def take(self, some: Int) -> Found:
        """Some of them."""
        first = np.cumsum(self.count) - self.count
        corners = self.corners[consecutive(first[some], self.count[some])]
        return Found(self.there[some], corners, self.count[some])


def routed(asked: Asked, ground: Ground) -> Found:
    """The shortest ways, tolls counted."""
    n_ways = len(asked.own)
    there = np.zeros(n_ways, np.bool_)
    straight = np.hypot(*(asked.end - asked.begin).T)
    left, none = np.flatnonzero(straight <= asked.limit), np.zeros(0, np.int64)
    of_way, passed = [none], [none]
    for longer in _LONGER:
        reach = np.minimum(straight + longer, asked.limit)
        for some in _parts(asked, left, reach, ground):
            found = _within(asked.take(some), reach[some], ground)
            there[some[found.there]] = True
            of_way.append(np.repeat(some, found.count))
            passed.append(found.corners)
        left = left[~there[left] & (reach[left] < asked.limit[left])]
        if not len(left):
            break
    way, corners = np.concatenate(of_way), np.concatenate(passed)
    order = np.argsort(way, kind="stable")
    return Found(there, corners[order], np.bincount(way, minlength=n_ways).astype(np.int64))


def _parts(asked: Asked, left: Int, reach: Float, ground: Ground) -> list[Int]:
    """The ways `left` (n,), some at a time."""
    first, last = ground.between(*_spans(asked, reach), own=asked.own)
    count = (last - first)[left]
    work = np.cumsum(count + np.minimum(count, _MOST) ** 2)
    return np.split(left, np.searchsorted(work, np.arange(_AT_ONCE, work[-1], _AT_ONCE))) if len(left) else []


def _spans(asked: Asked, reach: Float) -> tuple[Float, Float]:
    """(W,) the lowest and the highest x of the places from which the ends of a way are together `reach` away."""
    middle, half = (asked.begin + asked.end)[:, 0] / 2, (asked.end - asked.begin) / 2
    wide = np.sqrt(np.maximum(reach**2 / 4 - half[:, 1] ** 2, 0.0))
    return middle - wide, middle + wide


def _within(asked: Asked, reach: Float, ground: Ground) -> Found:
    """The shortest ways of no more than `reach` (W,) mm."""
    n_ways = len(asked.own)
    seen = _candidates(asked, reach, ground)
    begin, end = (np.arange(n_ways) + len(seen.way) + more for more in (0, n_ways))
    links = [
        _spokes(asked.begin, asked, ground, seen).after(begin),
        _spokes(asked.end, asked, ground, seen).before(end),
        Links(begin, end, ground.cost(asked.begin, asked.end, asked.own)),
        *_chords(reach, ground, seen),
    ]
    cost, nodes, count = shortest(Links.joined(links), begin, end, len(seen.way) + 2 * n_ways)
    there = cost <= reach + asked.free
    return Found(there, seen.corner[nodes[np.repeat(there, count)]], np.where(there, count, 0))


@dataclass(frozen=True, slots=True, eq=False)
class _Seen:
    """The corners that may be on each way: (S,) entries, by way.

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


def _candidates(asked: Asked, reach: Float, ground: Ground) -> _Seen:
    """The corners within the ellipse of each way."""
    n_ways = len(asked.own)
    first, last = ground.between(*_spans(asked, reach), own=asked.own)
    count = np.maximum(last - first, 0)
    way, corner = np.repeat(np.arange(n_ways), count), consecutive(first, count)
    place = ground.corners.place[corner]
    coming, going = (np.hypot(*(place - ends[way]).T) for ends in (asked.begin, asked.end))
    near = np.flatnonzero(coming + going <= reach[way])
    order = near[np.lexsort(((coming + going)[near], way[near]))]
    count = np.bincount(way[order], minlength=n_ways)
    kept = order[spread(count)[1] < _MOST]
    return _Seen(way[kept], corner[kept], coming[kept], going[kept], np.minimum(count, _MOST))


def _spokes(ends: Float, asked: Asked, ground: Ground, seen: _Seen) -> _Spokes:
    """The legs between one end (W, 2) of each way and its corners."""
    place = ends[seen.way]
    some = np.flatnonzero(_passes(place, seen.corner, ground))
    way = seen.way[some]
    cost = ground.cost(place[some], ground.corners.place[seen.corner[some]], asked.own[way])
    return _Spokes(way, some, cost)


@dataclass(frozen=True, slots=True, eq=False)
class _Spokes:
    """Legs between an end of a `way` and the entry `seen`, with their `cost`, (n,) each."""

    way: Int
    seen: Int
    cost: Float

    def after(self, begin: Int) -> Links:
        """From the begins (W,) of the ways."""
        return Links(begin[self.way], self.seen, self.cost)

    def before(self, end: Int) -> Links:
        """To the ends (W,) of the ways."""
        return Links(self.seen, end[self.way], self.cost)


def _chords(reach: Float, ground: Ground, seen: _Seen) -> tuple[Links, Links]:
    """The legs between corners of the same way, in both directions."""
    place = ground.corners.place
    more = seen.count[seen.way] - spread(seen.count)[1] - 1
    one = np.repeat(np.arange(len(seen.way)), more)
    other = consecutive(np.arange(len(seen.way)) + 1, more)
    a, b = seen.corner[one], seen.corner[other]
    length = np.hypot(*(place[b] - place[a]).T)
    around = np.minimum(seen.coming[one] + seen.going[other], seen.coming[other] + seen.going[one])
    some = np.flatnonzero((length + around <= reach[seen.way[one]]) & (length > OFF))
    some = some[_passes(place[a[some]], b[some], ground)]
    some = some[_passes(place[b[some]], a[some], ground)]
    # The same two corners are seen from many ways.
    key = np.minimum(a, b)[some] * len(place) + np.maximum(a, b)[some]
    pair, number = np.unique(key, return_inverse=True)
    p, q = np.divmod(pair, max(len(place), 1))
    cost = ground.cost(place[p], place[q], ground.corners.owner[p])[number]
    return Links(one[some], other[some], cost), Links(other[some], one[some], cost)


def _passes(place: Float, corner: Int, ground: Ground) -> Bool:
    """(n,) whether a leg from `place` (n, 2) passes the corner (n,) with both of its sides on the same hand."""
    corners = ground.corners
    tip = corners.tip[corner]
    leg = tip - place
    one, other = cross(leg, corners.before[corner] - tip), cross(leg, corners.after[corner] - tip)
    return np.asarray(one * other >= 0)
