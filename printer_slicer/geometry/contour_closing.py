"""Close open contours: join each loose end to the start of another contour, whatever the input order."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from printer_slicer.arrays import Bool, Float, Int
from printer_slicer.geometry.facet_topology import expand_counts, may_have_neighbours
from printer_slicer.geometry.ring_queries import crosses_any_edge
from printer_slicer.values import Struct

__all__ = ["Chords", "LooseEnds", "close_with_chords", "join_near_ends"]

_TIERS = (1e-6, 1e-3, 1e-2, 0.1, 0.3)
"""mm; search radii, from small to large: near ends are joined first, so that few are left for the larger radii."""
_PAIRS_PER_END = 20
_MAX_PAIRS = 200_000
"""Limits for the search. A surface with more pairs of loose ends than this, in total and per end, is too damaged to
close; the search would take minutes without a useful result."""


class LooseEnds(Struct, frozen=True, eq=False):
    """Loose ends of the contours of all planes.

    Attributes:
        xy: (N, 2) mm, all nodes.
        plane: (N,) plane of each node.
        tails: (n,) nodes without a successor.
        heads: (n,) nodes without a predecessor; each plane has as many as it has tails.
    """

    xy: Float
    plane: Int
    tails: Int
    heads: Int

    @classmethod
    def of(cls, following: Int, xy: Float, plane: Int) -> LooseEnds:
        """Find the loose ends, given the successor of each node or -1."""
        is_head = np.ones(len(following), np.bool_)
        is_head[following[following >= 0]] = False
        return cls(xy, plane, np.flatnonzero(following < 0), np.flatnonzero(is_head))

    @property
    def n_pairs(self) -> int:
        """Number of pairs of a tail and a head on the same plane."""
        return int((np.bincount(self.plane[self.tails]) ** 2).sum())

    def without(self, joined: Chords) -> LooseEnds:
        """Return the loose ends that the chords `joined` do not use."""
        return LooseEnds(
            self.xy,
            self.plane,
            self.tails[~np.isin(self.tails, joined.tail)],
            self.heads[~np.isin(self.heads, joined.head)],
        )


class Chords(Struct, frozen=True, eq=False):
    """Straight lines that close contours.

    Attributes:
        tail: (C,) node at which each chord starts.
        head: (C,) node at which it ends.
        width: (C,) mm, its length.
    """

    tail: Int
    head: Int
    width: Float

    @classmethod
    def none(cls) -> Chords:
        """Return an empty set of chords."""
        return cls(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0))

    @classmethod
    def merged(cls, parts: Sequence[Chords]) -> Chords:
        """Concatenate several sets of chords."""
        return cls(
            np.concatenate([chords.tail for chords in parts]),
            np.concatenate([chords.head for chords in parts]),
            np.concatenate([chords.width for chords in parts]),
        )


def join_near_ends(loose: LooseEnds, reach: float) -> Chords:
    """Join loose ends of a plane by chords of at most `reach` mm, the shortest first, each end once.

    Raises:
        OverflowError: too many ends lie near each other.
    """
    chords = Chords.none()
    for radius in (*(tier for tier in _TIERS if tier < reach), reach):
        if not len(loose.tails):
            break
        found = _choose_shortest(loose, *_find_pairs_within(loose, radius))
        chords, loose = Chords.merged([chords, found]), loose.without(found)
    return chords


def _find_pairs_within(loose: LooseEnds, radius: float) -> tuple[Int, Int]:
    """Return all pairs (tail, head) on the same plane that are at most the radius apart.

    Cells are as wide as the radius and numbered by plane, row, column, so the three cells of a row in which a near head
    can lie have consecutive numbers. Tails are searched in the order of their cells, to stay in the processor's cache.

    Raises:
        OverflowError: there are too many pairs.
    """
    node = np.concatenate([loose.tails, loose.heads])
    maybe = may_have_neighbours(loose.xy[node], radius, plane=loose.plane[node])
    tails, heads = loose.tails[maybe[: len(loose.tails)]], loose.heads[maybe[len(loose.tails) :]]
    if not len(tails) or not len(heads):
        return tails[:0], heads[:0]
    key, row = _number_cells(loose, np.concatenate([tails, heads]), radius)
    by_tail, by_head = (np.argsort(part, kind="stable") for part in (key[: len(tails)], key[len(tails) :]))
    tails, tail_key = tails[by_tail], key[: len(tails)][by_tail]
    heads, head_key = heads[by_head], key[len(by_tail) :][by_head]
    found, total = list[tuple[Int, Int]](), 0
    for shift in (-row, 0, row):
        first = np.searchsorted(head_key, tail_key + (shift - 1))
        last = np.searchsorted(head_key, tail_key + (shift + 1), side="right")
        total += int((last - first).sum())
        if total > _PAIRS_PER_END * len(loose.tails) + _MAX_PAIRS:
            raise OverflowError
        owner, place = expand_counts(last - first)
        tail, head = tails[owner], heads[first[owner] + place]
        near = ((loose.xy[tail] - loose.xy[head]) ** 2).sum(axis=1) <= radius**2
        found.append((tail[near], head[near]))
    return np.concatenate([tail for tail, _ in found]), np.concatenate([head for _, head in found])


def _number_cells(loose: LooseEnds, node: Int, width: float) -> tuple[Int, int]:
    """Return the cell number (n,) of each node, and the difference between the numbers of neighbouring rows.

    There is an unused cell between rows and between planes. Cells are wider where 62 bits would not be enough.
    """
    xy, plane = loose.xy[node], loose.plane[node]
    row_length = 1 << (62 - (int(plane.max()) + 1).bit_length()) // 2
    low, high = xy.min(axis=0), xy.max(axis=0)
    width = max(width, float((high - low).max()) / (row_length - 4))
    column, row = np.floor((xy - low) / width).astype(np.int64).T + 1
    return (plane * row_length + row) * row_length + column, row_length


def _choose_shortest(loose: LooseEnds, tail: Int, head: Int) -> Chords:
    """Choose pairs greedily: the shortest first, then the shortest that does not use its ends, and so on.

    Each round takes every pair that is the shortest one for both of its ends, which gives the same result.
    """
    gap = loose.xy[tail] - loose.xy[head]
    width = np.hypot(gap[:, 0], gap[:, 1])
    # Positions of the ends decide ties, so that the result does not depend on the order of the nodes.
    order = np.lexsort((*loose.xy[head].T, *loose.xy[tail].T, width))
    tail, head, width = tail[order], head[order], width[order]
    chosen = np.zeros(len(tail), np.bool_)
    left = np.arange(len(tail))
    best_tail, best_head = np.zeros(len(loose.xy), np.int64), np.zeros(len(loose.xy), np.int64)
    while len(left):
        # Written backward, so that the shortest pair wins.
        best_tail[tail[left[::-1]]] = left[::-1]
        best_head[head[left[::-1]]] = left[::-1]
        mutual = left[(best_tail[tail[left]] == left) & (best_head[head[left]] == left)]
        chosen[mutual] = True
        used = np.isin(tail[left], tail[mutual]) | np.isin(head[left], head[mutual])
        left = left[~used]
    return Chords(tail[chosen], head[chosen], width[chosen])


def close_with_chords(
    loose: LooseEnds, begin: Float, end: Float, segment_plane: Int, n_pairs: int = 0
) -> Chords:
    """Join loose ends of a plane by chords of any length that cross nothing, the shortest first.

    Args:
        loose: the remaining loose ends.
        begin: (S, 2) mm, start points of the segments of all contours.
        end: (S, 2) mm, their end points.
        segment_plane: (S,) plane of each segment.
        n_pairs: number of pairs already compared on other planes; they count toward the limit.

    Returns:
        The chords. If every chord between some ends would cross a contour, these ends and those of all planes above
        stay loose.

    Raises:
        OverflowError: there are too many pairs to try.
    """
    chords = Chords.none()
    planes, counts = np.unique(loose.plane[loose.tails], return_counts=True)
    if n_pairs + loose.n_pairs > _MAX_PAIRS:
        raise OverflowError
    order = np.argsort(segment_plane, kind="stable")
    begin, end, segment_plane = begin[order], end[order], segment_plane[order]
    for plane, count in zip(planes.tolist(), counts.tolist(), strict=True):
        here = slice(*np.searchsorted(segment_plane, [plane, plane + 1]))
        tails = loose.tails[loose.plane[loose.tails] == plane]
        heads = loose.heads[loose.plane[loose.heads] == plane]
        found = _choose_crossing_free_chords(loose.xy, tails, heads, begin[here], end[here])
        chords = Chords.merged([chords, found])
        if len(found.tail) < count:
            break
    return chords


def _choose_crossing_free_chords(xy: Float, tails: Int, heads: Int, begin: Float, end: Float) -> Chords:
    """Find chords on one plane, the shortest first, that cross neither a segment nor each other."""
    gap = xy[tails][:, None] - xy[heads][None]
    width = np.hypot(gap[:, :, 0], gap[:, :, 1]).ravel()
    tail, head = np.repeat(tails, len(heads)), np.tile(heads, len(tails))
    order = np.lexsort((*xy[head].T, *xy[tail].T, width))
    used: set[int] = set()
    chosen = []
    for k in order.tolist():
        ends = int(tail[k]), int(head[k]) + len(xy)  # separate numbers for tails and heads
        if used.isdisjoint(ends) and not _chord_crosses_segment(xy[tail[k]], xy[head[k]], begin, end):
            used.update(ends)
            chosen.append(k)
            begin, end = np.vstack([begin, xy[tail[k]]]), np.vstack([end, xy[head[k]]])
    return Chords(tail[chosen], head[chosen], width[chosen])


def _chord_crosses_segment(start: Float, stop: Float, begin: Float, end: Float) -> bool:
    """Return whether a chord crosses a segment that does not share an end with it."""
    apart: Bool = np.ones(len(begin), np.bool_)
    for point in (start, stop):
        apart &= (begin != point).any(axis=1) & (end != point).any(axis=1)
    if not apart.any():
        return False
    return bool(crosses_any_edge(start[None], stop[None], begin[apart], end[apart])[0])
