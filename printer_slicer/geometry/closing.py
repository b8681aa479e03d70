"""Open contours: which loose end goes on at which loose beginning, in whatever order they are given."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from printer_slicer.geometry.areas import Bool, Float, Int
from printer_slicer.geometry.inside import any_crossing
from printer_slicer.geometry.planes import spread

__all__ = ["Chords", "LooseEnds", "close_by_chords", "close_near"]

_TIERS = (1e-6, 1e-3, 1e-2, 0.1, 0.3)
"""mm; ends are looked for this near before they are looked for farther away, so that few are left for that."""
_PAIRS_PER_END = 20
_MANY_PAIRS = 200_000
"""Where each loose end has more than so many others near it, and there are more than so many in all, or where more
pairs than these are left to try chords between, a surface is in shreds: looking on would take minutes, for nothing."""


@dataclass(frozen=True, slots=True, eq=False)
class LooseEnds:
    """Nodes of the contours of all planes that have nothing after them, and as many that have nothing before them.

    Attributes:
        xy: (N, 2) mm, all nodes.
        plane: (N,) of each node.
        tails: (n,) nodes without a follower.
        heads: (n,) nodes that follow none; as many on each plane as there are tails.
    """

    xy: Float
    plane: Int
    tails: Int
    heads: Int

    @classmethod
    def of(cls, following: Int, xy: Float, plane: Int) -> LooseEnds:
        """From the follower of each node, -1 where there is none."""
        is_head = np.ones(len(following), np.bool_)
        is_head[following[following >= 0]] = False
        return cls(xy, plane, np.flatnonzero(following < 0), np.flatnonzero(is_head))

    def without(self, joined: Chords) -> LooseEnds:
        """Those that are left when the chords are drawn."""
        return LooseEnds(
            self.xy,
            self.plane,
            self.tails[~np.isin(self.tails, joined.tail)],
            self.heads[~np.isin(self.heads, joined.head)],
        )


@dataclass(frozen=True, slots=True, eq=False)
class Chords:
    """Straight ways that close contours.

    Attributes:
        tail: (C,) node at which each begins.
        head: (C,) node at which it ends.
        width: (C,) mm, its length.
    """

    tail: Int
    head: Int
    width: Float

    @classmethod
    def none(cls) -> Chords:
        """No chord."""
        return cls(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0))

    def merge(self, other: Chords) -> Chords:
        """Both together."""
        return Chords(
            np.concatenate([self.tail, other.tail]),
            np.concatenate([self.head, other.head]),
            np.concatenate([self.width, other.width]),
        )


def close_near(loose: LooseEnds, reach: float) -> Chords:
    """Chords of at most `reach` mm between loose ends of a plane, the shortest first, every end once.

    Raises:
        OverflowError: too many ends lie near each other to be compared.
    """
    chords = Chords.none()
    for radius in (*(tier for tier in _TIERS if tier < reach), reach):
        if not len(loose.tails):
            break
        found = _shortest_first(loose, *_near(loose, radius))
        chords, loose = chords.merge(found), loose.without(found)
    return chords


def _near(loose: LooseEnds, radius: float) -> tuple[Int, Int]:
    """All pairs (tail, head) of one plane not farther apart than the radius."""
    xy, plane = loose.xy, loose.plane
    cell = (
        np.floor(xy[loose.tails] / radius).astype(np.int64),
        np.floor(xy[loose.heads] / radius).astype(np.int64),
    )
    head_key = _cell_key(cell[1], plane[loose.heads])
    order = np.argsort(head_key, kind="stable")
    head_key, heads = head_key[order], loose.heads[order]
    found: list[tuple[Int, Int]] = []
    total = 0
    for shift in np.ndindex(3, 3):
        key = _cell_key(cell[0] + np.array(shift) - 1, plane[loose.tails])
        first, last = np.searchsorted(head_key, key), np.searchsorted(head_key, key, side="right")
        total += int((last - first).sum())
        if total > _PAIRS_PER_END * len(key) + _MANY_PAIRS:
            raise OverflowError
        owner, place = spread(last - first)
        tail, head = loose.tails[owner], heads[first[owner] + place]
        gap = xy[tail] - xy[head]
        near = (plane[tail] == plane[head]) & ((gap**2).sum(axis=1) <= radius**2)
        found.append((tail[near], head[near]))
    return np.concatenate([tail for tail, _ in found]), np.concatenate([head for _, head in found])


def _cell_key(cell: Int, plane: Int) -> NDArray[np.uint64]:
    """(n,) one number for cell and plane; different ones may share it, so whoever uses it looks again."""
    x, y = cell.T.astype(np.uint64)
    mixed = x * np.uint64(0x9E3779B97F4A7C15) ^ y * np.uint64(0xC2B2AE3D27D4EB4F)
    return np.asarray(mixed ^ plane.astype(np.uint64) * np.uint64(0x165667B19E3779F9))


def _shortest_first(loose: LooseEnds, tail: Int, head: Int) -> Chords:
    """Of the pairs the shortest, then the shortest of those that do not use its ends, and so on.

    In each round every pair is taken that is the shortest of both of its ends; that comes to the same.
    """
    gap = loose.xy[tail] - loose.xy[head]
    width = np.hypot(gap[:, 0], gap[:, 1])
    # Ties are decided by where the ends lie, not by their numbers.
    order = np.lexsort((*loose.xy[head].T, *loose.xy[tail].T, width))
    tail, head, width = tail[order], head[order], width[order]
    chosen = np.zeros(len(tail), np.bool_)
    left = np.arange(len(tail))
    best_tail, best_head = np.zeros(len(loose.xy), np.int64), np.zeros(len(loose.xy), np.int64)
    while len(left):
        # The last to write is the first of the order.
        best_tail[tail[left[::-1]]] = left[::-1]
        best_head[head[left[::-1]]] = left[::-1]
        mutual = left[(best_tail[tail[left]] == left) & (best_head[head[left]] == left)]
        chosen[mutual] = True
        used = np.isin(tail[left], tail[mutual]) | np.isin(head[left], head[mutual])
        left = left[~used]
    return Chords(tail[chosen], head[chosen], width[chosen])


def close_by_chords(loose: LooseEnds, begin: Float, end: Float, segment_plane: Int) -> Chords:
    """Chords of any length between loose ends of a plane: the shortest first that crosses nothing.

    Args:
        loose: ends that are left.
        begin: (S, 2) mm, where the segments of all contours begin.
        end: (S, 2) mm, where they end.
        segment_plane: (S,).

    Returns:
        The chords; ends between which every chord would cross a contour are left loose, and so are those of all planes
        above.

    Raises:
        OverflowError: there are too many ends to try.
    """
    chords = Chords.none()
    planes, counts = np.unique(loose.plane[loose.tails], return_counts=True)
    if (counts**2).sum() > _MANY_PAIRS:
        raise OverflowError
    order = np.argsort(segment_plane, kind="stable")
    begin, end, segment_plane = begin[order], end[order], segment_plane[order]
    for plane, count in zip(planes.tolist(), counts.tolist(), strict=True):
        here = slice(*np.searchsorted(segment_plane, [plane, plane + 1]))
        tails = loose.tails[loose.plane[loose.tails] == plane]
        heads = loose.heads[loose.plane[loose.heads] == plane]
        found = _uncrossed(loose.xy, tails, heads, begin[here], end[here])
        chords = chords.merge(found)
        if len(found.tail) < count:
            break
    return chords


def _uncrossed(xy: Float, tails: Int, heads: Int, begin: Float, end: Float) -> Chords:
    """Chords of one plane, the shortest first, that cross neither a segment nor each other."""
    gap = xy[tails][:, None] - xy[heads][None]
    width = np.hypot(gap[:, :, 0], gap[:, :, 1]).ravel()
    tail, head = np.repeat(tails, len(heads)), np.tile(heads, len(tails))
    order = np.lexsort((*xy[head].T, *xy[tail].T, width))
    used: set[int] = set()
    chosen = []
    for k in order.tolist():
        ends = int(tail[k]), int(head[k]) + len(xy)  # tails and heads are numbered apart
        if used.isdisjoint(ends) and not _crosses(xy[tail[k]], xy[head[k]], begin, end):
            used.update(ends)
            chosen.append(k)
            begin, end = np.vstack([begin, xy[tail[k]]]), np.vstack([end, xy[head[k]]])
    return Chords(tail[chosen], head[chosen], width[chosen])


def _crosses(start: Float, stop: Float, begin: Float, end: Float) -> bool:
    """Whether a chord crosses a segment that does not share an end with it."""
    apart: Bool = np.ones(len(begin), np.bool_)
    for point in (start, stop):
        apart &= (begin != point).any(axis=1) & (end != point).any(axis=1)
    if not apart.any():
        return False
    return bool(any_crossing(start[None], stop[None], begin[apart], end[apart])[0])
