"""Query the outlines of layers: distance to points, points inside, and crossings with straight lines."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from printer_slicer.arrays import Bool, Float, Int
from printer_slicer.geometry.areas import Areas
from printer_slicer.geometry.polyline_tree import PolylineTree
from printer_slicer.geometry.ring_queries import crossing_shares
from printer_slicer.geometry.vectors import nearest_share

__all__ = ["OutlineIndex", "SegmentIndex", "distance_to_segments"]

_QUERIES_AT_ONCE = 1 << 12  # per batch, because each may touch the boxes of thousands of long segments


class SegmentIndex:
    """Segments on layers in one search tree.

    Each layer has its own cell on a square grid, so that one query serves points of many layers. The cells are so far
    apart that the nearest segment to a point is never on another layer, if its own layer has any. Distances use
    the original positions; only the search uses the shifted ones.
    """

    def __init__(
        self, ends: tuple[Float, Float], layer: Int, n_layers: int, box: tuple[Float, Float]
    ) -> None:
        """Build the tree.

        Args:
            ends: (S, 2) start and (S, 2) end points of the segments, mm.
            layer: (S,) layer of each segment.
            n_layers: number of layers.
            box: lowest and highest corner (2,) of a box around all points to be queried, mm.
        """
        self._begin, self._end = ends
        self._n_layers = n_layers
        self._filled = np.bincount(layer, minlength=n_layers) > 0
        self._right = float(self._begin[:, 0].max(initial=box[1][0]))
        room = np.maximum(box[1], self._begin.max(axis=0, initial=-np.inf))
        room -= np.minimum(box[0], self._begin.min(axis=0, initial=np.inf))
        # Segments of the same layer are within one diagonal, those of other layers are more than one diagonal away.
        self._pitch = 2.5 * float(np.hypot(*room)) + 1.0
        cell = self._cell_offset(layer)
        moved = np.stack([self._begin + cell, self._end + cell], axis=1)
        self._tree = PolylineTree(moved) if len(moved) else None

    def nearest(self, points: Float, layer: Int) -> Int:
        """Return for each point (P, 2) the nearest segment (P,) of its layer; -1 if the layer is empty."""
        result = np.full(len(points), -1, np.int64)
        known = np.flatnonzero(self._filled[layer])
        if self._tree is not None and len(known):
            result[known] = self._tree.nearest(points[known] + self._cell_offset(layer[known]))
        return result

    def distance(self, points: Float, layer: Int) -> Float:
        """Return the distance (P,) from each point (P, 2) to the nearest segment of its layer, mm; inf if empty."""
        nearest = self.nearest(points, layer)
        result = np.full(len(points), np.inf)
        known = nearest >= 0
        segment = nearest[known]
        result[known] = distance_to_segments(points[known], self._begin[segment], self._end[segment])
        return result

    def find_touching(self, low: Float, high: Float, layer: Int) -> Iterator[tuple[Int, Int]]:
        """Yield batches of pairs of a box and a segment of its `layer` (P,) whose bounding box touches it.

        Args:
            low: (P, 2) mm, a corner of each box.
            high: (P, 2) mm, the opposite corner.
            layer: (P,) layer of each box.
        """
        if self._tree is None:
            return
        for first in range(0, len(low), _QUERIES_AT_ONCE):
            some = slice(first, first + _QUERIES_AT_ONCE)
            cell = self._cell_offset(layer[some])
            box, segment = self._tree.query_boxes(low[some] + cell, high[some] + cell)
            yield box + first, segment

    def find_crossings(self, begin: Float, end: Float, layer: Int) -> tuple[Int, Int, Float]:
        """Find where lines from `begin` to `end` (P, 2) cross segments of their `layer` (P,), unordered.

        A segment includes only one of its ends, so a line through a corner crosses exactly one of the two segments.

        Returns:
            The line (X,), the segment that it crosses (X,), and the position along the line (X,), 0 to 1.
        """
        none = np.zeros(0, np.int64)
        found = [(none, none, np.zeros(0))]
        for line, segment in self.find_touching(begin, end, layer):
            share = crossing_shares(
                begin.take(line, axis=0),
                end.take(line, axis=0),
                self._begin.take(segment, axis=0),
                self._end.take(segment, axis=0),
            )
            cross = ~np.isnan(share)
            found.append((line[cross], segment[cross], share[cross]))
        return _concatenate_columns(found)

    def count_crossings(self, begin: Float, end: Float, layer: Int) -> Int:
        """Count how often (P,) lines from `begin` to `end` (P, 2) cross segments of their `layer` (P,)."""
        return np.bincount(self.find_crossings(begin, end, layer)[0], minlength=len(begin)).astype(np.int64)

    def _cell_offset(self, layer: Int) -> Float:
        """Return the offset (P, 2) of the cell of each layer."""
        side = int(np.ceil(np.sqrt(self._n_layers)))
        return np.column_stack(np.divmod(layer, side)) * self._pitch


class OutlineIndex(SegmentIndex):
    """Outlines of all layers: segment i starts at point i of the areas, and ends at the next point of the ring."""

    def __init__(self, areas: Areas, low: Float, high: Float) -> None:
        """Build the tree from clean areas, and the corners (2,) of a box around all points to be queried, mm."""
        ends = areas.xy, areas.xy[areas.following]
        super().__init__(ends, areas.point_layer, areas.n_layers, (low, high))

    def is_inside(self, points: Float, layer: Int) -> Bool:
        """Return a mask (P,) of points (P, 2) inside the area of their `layer` (P,)."""
        if self._tree is None or not len(points):
            return np.zeros(len(points), np.bool_)
        far = np.column_stack([np.full(len(points), self._right), points[:, 1]])
        cell = self._cell_offset(layer)
        point, segment = self._tree.query_boxes(points + cell, far + cell)
        (x, y), (ax, ay), (bx, by) = points[point].T, self._begin[segment].T, self._end[segment].T
        # A segment includes its lower end only, so that a ray through a corner counts once.
        rising, falling = (ay <= y) & (by > y), (ay > y) & (by <= y)
        left = (bx - ax) * (y - ay) - (by - ay) * (x - ax)
        crossed = (rising & (left > 0)) | (falling & (left < 0))
        return np.asarray(np.bincount(point[crossed], minlength=len(points)) % 2 == 1)


def _concatenate_columns(found: list[tuple[Int, Int, Float]]) -> tuple[Int, Int, Float]:
    """Concatenate the arrays of several batches, column by column."""
    one, other, number = zip(*found, strict=True)
    return np.concatenate(one), np.concatenate(other), np.concatenate(number)


def distance_to_segments(points: Float, begin: Float, end: Float) -> Float:
    """Return the distance (P,) from each point (P, 2) to its segment from `begin` to `end` (P, 2), mm."""
    line, gap = end - begin, points - begin
    # Coordinates relative to the start: for a short segment far from the origin, absolute ones lose digits.
    return np.asarray(np.hypot(*(gap - nearest_share(gap, line)[:, None] * line).T))
