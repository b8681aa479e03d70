"""Rectangles on layers, and which of them overlap."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, boxes, consecutive
from printer_slicer.geometry.areas import Areas

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

    def overlapping(self, other: Boxes) -> tuple[Int, Int]:
        """Pairs of one of these and one of the others that overlap or touch, on one layer; in no order."""
        own_spans, other_spans = _on_one_axis(self, other)
        # Along the axis, of two that overlap one begins within the other.
        found = [self._meeting(other, own, others) for own, others in _begun_within(own_spans, other_spans)]
        found += [
            self._meeting(other, own, others)
            for others, own in _begun_within(other_spans, own_spans, ties=False)
        ]
        return _joined(found)

    def neighbours(self) -> tuple[Int, Int]:
        """Pairs of different ones that overlap or touch, on one layer; each pair once, in no order."""
        (spans,) = _on_one_axis(self)
        low, found = spans[0], []
        for a, b in _begun_within(spans, spans):
            once = (low[b] > low[a]) | (b > a)
            found.append(self._meeting(self, a[once], b[once]))
        return _joined(found)

    def touched(self, other: Boxes) -> Bool:
        """(B,) whether each overlaps or touches any of the others on its layer."""
        result = np.zeros(len(self.layer), np.bool_)
        result[self.overlapping(other)[0]] = True
        return result

    def _meeting(self, other: Boxes, own: Int, others: Int) -> tuple[Int, Int]:
        """Those of some pairs that overlap along the second axis, too."""
        (low, high), (from_, to) = ((one.low[:, 1], one.high[:, 1]) for one in (self, other))
        meet = (low.take(own) <= to.take(others)) & (from_.take(others) <= high.take(own))
        return own[meet], others[meet]


_Spans = tuple[Float, Float]


def _on_one_axis(*many: Boxes) -> list[_Spans]:
    """From where to where boxes reach along the first axis, on which the layers stand apart from each other."""
    ends = np.concatenate([end[:, 0] for one in many for end in (one.low, one.high)])
    ends = ends[np.isfinite(ends)]  # those around nothing are inside out, infinite, and meet nothing
    pitch = float(np.ptp(ends)) + 1.0 if len(ends) else 1.0
    return [(one.low[:, 0] + one.layer * pitch, one.high[:, 0] + one.layer * pitch) for one in many]


def _begun_within(spans: _Spans, others: _Spans, *, ties: bool = True) -> Iterator[tuple[Int, Int]]:
    """Pairs of a span and another one that begins within it; with `ties` also those that begin where it does.

    They come some at a time.
    """
    low, high = spans
    order = np.argsort(others[0], kind="stable")
    begin = others[0][order]
    first = np.searchsorted(begin, low, side="left" if ties else "right")
    count = np.maximum(np.searchsorted(begin, high, side="right") - first, 0)
    before = np.cumsum(count)
    start = 0
    while start < len(count):
        done = int(before[start - 1]) if start else 0
        stop = max(int(np.searchsorted(before, done + _PAIRS_AT_ONCE, side="right")), start + 1)
        some = np.arange(start, stop)
        yield np.repeat(some, count[some]), order[consecutive(first[some], count[some])]
        start = stop


def _joined(found: list[tuple[Int, Int]]) -> tuple[Int, Int]:
    """All pairs that were found."""
    none = np.zeros(0, np.int64)
    return np.concatenate([none, *(a for a, _ in found)]), np.concatenate([none, *(b for _, b in found)])
