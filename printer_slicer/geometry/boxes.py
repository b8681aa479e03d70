"""Rectangles on layers, and which of them overlap."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from printer_slicer.geometry.areas import Areas, Bool, Float, Int, boxes, consecutive

__all__ = ["Boxes"]

_PAIRS_AT_ONCE = 1 << 18  # what is compared stays small


@dataclass(frozen=True, slots=True, eq=False)
class Boxes:
    """Rectangles along the axes, one of them a point or a line at times.

    Attributes:
        low: (B, 2) mm.
        high: (B, 2) mm.
        layer: (B,).
    """

    low: Float
    high: Float
    layer: Int

    @classmethod
    def of_sides(cls, areas: Areas) -> Boxes:
        """Around each side of areas, in the order of the points at which they begin."""
        begin, end = areas.xy, areas.xy.take(areas.following, axis=0)
        return cls(np.minimum(begin, end), np.maximum(begin, end), areas.point_layer)

    @classmethod
    def of_rings(cls, areas: Areas) -> Boxes:
        """Around each ring."""
        low, high = boxes(areas.xy, areas.ring_start, np.arange(areas.n_rings), areas.n_rings)
        return cls(low, high, areas.ring_layer)

    def grown(self, reach: float | Float) -> Boxes:
        """Larger by `reach` mm, of all or of each (B,), to all four sides."""
        room = np.reshape(reach, (-1, 1))
        return Boxes(self.low - room, self.high + room, self.layer)

    def take(self, items: Int | Bool) -> Boxes:
        """Some of them."""
        return Boxes(self.low[items], self.high[items], self.layer[items])

    def overlapping(self, other: Boxes) -> tuple[Int, Int]:
        """Pairs of one of these and one of the others that overlap or touch, on one layer; in no order."""
        found = [(np.zeros(0, np.int64),) * 2]
        for own, others in self._beside(other):
            hit = (self.low[own, 1] <= other.high[others, 1]) & (other.low[others, 1] <= self.high[own, 1])
            found.append((own[hit], others[hit]))
        return np.concatenate([own for own, _ in found]), np.concatenate([others for _, others in found])

    def neighbours(self) -> tuple[Int, Int]:
        """Pairs of different ones that overlap or touch, on one layer; each pair once, in no order."""
        found = [(np.zeros(0, np.int64),) * 2]
        if len(self.layer):
            aside = self.layer * (float(self.high[:, 0].max() - self.low[:, 0].min()) + 1.0)
            low, high = self.low[:, 0] + aside, self.high[:, 0] + aside
            for a, b in _begun_within(low, high, low, "left"):
                hit = (low[b] > low[a]) | (b > a)
                hit &= (self.low[a, 1] <= self.high[b, 1]) & (self.low[b, 1] <= self.high[a, 1])
                found.append((a[hit], b[hit]))
        return np.concatenate([a for a, _ in found]), np.concatenate([b for _, b in found])

    def touched(self, other: Boxes) -> Bool:
        """(B,) whether each overlaps or touches any of the others on its layer."""
        result = np.zeros(len(self.layer), np.bool_)
        result[self.overlapping(other)[0]] = True
        return result

    def _beside(self, other: Boxes) -> Iterator[tuple[Int, Int]]:
        """Pairs that overlap along the first axis, some at a time: one of both begins within the other."""
        if not len(self.layer) or not len(other.layer):
            return
        # One axis for all layers, which stand apart from each other on it.
        ends = np.concatenate([self.low[:, 0], other.low[:, 0], self.high[:, 0], other.high[:, 0]])
        pitch = float(ends.max() - ends.min()) + 1.0
        (low, high), (other_low, other_high) = (
            (boxes.low[:, 0] + boxes.layer * pitch, boxes.high[:, 0] + boxes.layer * pitch)
            for boxes in (self, other)
        )
        for own, others in _begun_within(low, high, other_low, "left"):
            yield own, others
        for others, own in _begun_within(other_low, other_high, low, "right"):
            yield own, others


def _begun_within(low: Float, high: Float, begin: Float, side: str) -> Iterator[tuple[Int, Int]]:
    """Pairs of an interval and one that begins within it; where both begin alike only if `side` is left."""
    order = np.argsort(begin, kind="stable")
    begin = begin[order]
    first = np.searchsorted(begin, low, side="left" if side == "left" else "right")
    count = np.maximum(np.searchsorted(begin, high, side="right") - first, 0)
    before = np.cumsum(count)
    start = 0
    while start < len(count):
        done = int(before[start - 1]) if start else 0
        stop = max(int(np.searchsorted(before, done + _PAIRS_AT_ONCE, side="right")), start + 1)
        some = np.arange(start, stop)
        yield np.repeat(some, count[some]), order[consecutive(first[some], count[some])]
        start = stop
