"""Bounding boxes on layers, and the search for overlapping ones."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, bounding_boxes, concatenate_pairs, consecutive
from printer_slicer.geometry.areas import Areas
from printer_slicer.kernel import load_kernel
from printer_slicer.values import Struct

__all__ = ["Boxes"]

_PAIRS_AT_ONCE = 1 << 18  # bounds the memory for comparisons


class Boxes(Struct, frozen=True, eq=False):
    """Axis-aligned boxes; a box may have no width or no height.

    Attributes:
        low: (B, 2) mm, lowest corner.
        high: (B, 2) mm, highest corner.
        layer: (B,) layer of each box.
    """

    low: Float
    high: Float
    layer: Int

    @classmethod
    def of_sides(cls, areas: Areas) -> Boxes:
        """Return the box around each side of areas, in the order of the points at which the sides start."""
        begin, end = areas.xy, areas.xy.take(areas.following, axis=0)
        return cls(np.minimum(begin, end), np.maximum(begin, end), areas.point_layer)

    @classmethod
    def of_rings(cls, areas: Areas) -> Boxes:
        """Return the box around each ring."""
        low, high = bounding_boxes(areas.xy, areas.ring_start, np.arange(areas.n_rings), areas.n_rings)
        return cls(low, high, areas.ring_layer)

    def expand(self, reach: float | Float) -> Boxes:
        """Return the boxes grown by `reach` mm on all four sides; one value for all, or (B,)."""
        room = np.reshape(reach, (-1, 1))
        return Boxes(self.low - room, self.high + room, self.layer)

    def find_overlapping(self, other: Boxes) -> tuple[Int, Int]:
        """Return index pairs (own, other), unordered, of boxes of both sets that overlap or touch on the same layer."""
        kernel = load_kernel()
        if kernel:
            return _read_pairs(kernel.overlapping_boxes(*self._arrays(), *other._arrays()))
        own_spans, other_spans = _project_on_first_axis(self, other)
        # If two intervals on an axis overlap, one of them starts within the other.
        found = [
            self._keep_overlapping_in_y(other, own, others)
            for own, others in _find_starts_within(own_spans, other_spans)
        ]
        found += [
            self._keep_overlapping_in_y(other, own, others)
            for others, own in _find_starts_within(other_spans, own_spans, ties=False)
        ]
        return concatenate_pairs(found)

    def find_neighbours(self) -> tuple[Int, Int]:
        """Return index pairs, unordered, of different boxes that overlap or touch on the same layer, each pair once."""
        kernel = load_kernel()
        if kernel:
            return _read_pairs(kernel.neighbouring_boxes(*self._arrays()))
        (spans,) = _project_on_first_axis(self)
        low, found = spans[0], []
        for a, b in _find_starts_within(spans, spans):
            once = (low[b] > low[a]) | (b > a)
            found.append(self._keep_overlapping_in_y(self, a[once], b[once]))
        return concatenate_pairs(found)

    def touches_any(self, other: Boxes) -> Bool:
        """Return a mask (B,) of boxes that overlap or touch any box of `other` on their layer."""
        result = np.zeros(len(self.layer), np.bool_)
        result[self.find_overlapping(other)[0]] = True
        return result

    def _arrays(self) -> tuple[Float, Float, Int]:
        """Return the arrays as the kernel takes them."""
        low, high = (np.ascontiguousarray(corner, np.float64) for corner in (self.low, self.high))
        return low, high, np.ascontiguousarray(self.layer, np.int64)

    def _keep_overlapping_in_y(self, other: Boxes, own: Int, others: Int) -> tuple[Int, Int]:
        """Keep the pairs that also overlap along the second axis."""
        (low, high), (from_, to) = ((one.low[:, 1], one.high[:, 1]) for one in (self, other))
        meet = (low.take(own) <= to.take(others)) & (from_.take(others) <= high.take(own))
        return own[meet], others[meet]


_Spans = tuple[Float, Float]


def _project_on_first_axis(*many: Boxes) -> list[_Spans]:
    """Return the intervals that boxes cover on the first axis, shifted by layer so that layers do not overlap."""
    ends = np.concatenate([end[:, 0] for one in many for end in (one.low, one.high)])
    ends = ends[np.isfinite(ends)]  # boxes without points have infinite corners
    pitch = float(np.ptp(ends)) + 1.0 if len(ends) else 1.0
    return [(one.low[:, 0] + one.layer * pitch, one.high[:, 0] + one.layer * pitch) for one in many]


def _find_starts_within(spans: _Spans, others: _Spans, *, ties: bool = True) -> Iterator[tuple[Int, Int]]:
    """Yield batches of pairs of a span and another span that starts within it.

    With `ties`, spans that start at the same position count too.
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


def _read_pairs(found: tuple[bytes, bytes]) -> tuple[Int, Int]:
    """Read the pairs that the kernel found."""
    return np.frombuffer(found[0], np.int64), np.frombuffer(found[1], np.int64)
