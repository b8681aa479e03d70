"""Points and ways against the outlines of their layers: how far away, inside or outside, crossed where."""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Bool, Float, Int
from printer_slicer.geometry.areas import Areas
from printer_slicer.geometry.planar import SegmentTree
from printer_slicer.geometry.ring_queries import crossing_shares
from printer_slicer.geometry.vectors import nearest_share

__all__ = ["OutlineIndex", "SegmentIndex", "distance_to_segments"]

_PAIRS_AT_ONCE = 1 << 18  # of ways and segments: what is compared stays small


class SegmentIndex:
    """Segments on layers in one search tree.

    Each layer has a cell of its own on a square lattice, so that one query serves points of many layers. The cells are
    so far apart that the nearest segment to a point is never one of another layer, if its own has any. Distances are
    measured where the segments really are; only the search sees the moved ones.
    """

    def __init__(
        self, ends: tuple[Float, Float], layer: Int, n_layers: int, box: tuple[Float, Float]
    ) -> None:
        """Take begins and ends (S, 2), mm, the layers (S,), and the corners (2,) of the box in which all points lie."""
        self._begin, self._end = ends
        self._n_layers = n_layers
        self._filled = np.bincount(layer, minlength=n_layers) > 0
        self._right = float(self._begin[:, 0].max(initial=box[1][0]))
        room = np.maximum(box[1], self._begin.max(axis=0, initial=-np.inf))
        room -= np.minimum(box[0], self._begin.min(axis=0, initial=np.inf))
        # A segment of the own layer is within one diagonal, one of another layer more than one diagonal away.
        self._pitch = 2.5 * float(np.hypot(*room)) + 1.0
        cell = self._cell(layer)
        moved = np.stack([self._begin + cell, self._end + cell], axis=1)
        self._tree = SegmentTree(moved) if len(moved) else None

    def nearest(self, points: Float, layer: Int) -> Int:
        """(P,) index of the segment of its layer nearest to each point (P, 2); -1 where the layer is empty."""
        result = np.full(len(points), -1, np.int64)
        known = np.flatnonzero(self._filled[layer])
        if self._tree is not None and len(known):
            result[known] = self._tree.nearest(points[known] + self._cell(layer[known]))
        return result

    def distance(self, points: Float, layer: Int) -> Float:
        """(P,) mm from each point (P, 2) to the nearest segment of its layer; inf where the layer is empty."""
        nearest = self.nearest(points, layer)
        result = np.full(len(points), np.inf)
        known = nearest >= 0
        segment = nearest[known]
        result[known] = distance_to_segments(points[known], self._begin[segment], self._end[segment])
        return result

    def within(self, points: Float, layer: Int, reach: float) -> tuple[Int, Int, Float]:
        """Find the segments of their `layer` (P,) within reach of points (P, 2), unordered.

        Returns:
            (X,) the point, (X,) the segment, and (X,) mm between them, at most `reach`.
        """
        none = np.zeros(0, np.int64)
        if self._tree is None or not len(points):
            return none, none, np.zeros(0)
        cell = self._cell(layer)
        point, segment = self._tree.meeting(points + cell - reach, points + cell + reach)
        apart = distance_to_segments(points[point], self._begin[segment], self._end[segment])
        near = apart <= reach
        return point[near], segment[near], apart[near]

    def crossed(self, begin: Float, end: Float, layer: Int) -> tuple[Int, Int, Float]:
        """Where straight ways from `begin` to `end` (P, 2) cross segments of their `layer` (P,), in no order.

        A segment belongs to one of its ends only, so a way through a corner crosses exactly one of the corner's.

        Returns:
            (X,) the way, (X,) the segment that it crosses, and (X,) how far along the way, 0 to 1.
        """
        none = np.zeros(0, np.int64)
        if self._tree is None or not len(begin):
            return none, none, np.zeros(0)
        cell = self._cell(layer)
        way, segment = self._tree.meeting(begin + cell, end + cell)
        found = []
        for some in np.array_split(np.arange(len(way)), len(way) // _PAIRS_AT_ONCE + 1):
            one, other = way[some], segment[some]
            share = crossing_shares(
                begin.take(one, axis=0),
                end.take(one, axis=0),
                self._begin.take(other, axis=0),
                self._end.take(other, axis=0),
            )
            cross = ~np.isnan(share)
            found.append((one[cross], other[cross], share[cross]))
        ways, segments, shares = zip(*found, strict=True)
        return np.concatenate(ways), np.concatenate(segments), np.concatenate(shares)

    def crossings(self, begin: Float, end: Float, layer: Int) -> Int:
        """(P,) how often straight ways from `begin` to `end` (P, 2) cross segments of their `layer` (P,)."""
        return np.bincount(self.crossed(begin, end, layer)[0], minlength=len(begin)).astype(np.int64)

    def _cell(self, layer: Int) -> Float:
        """(P, 2) how far the cell of each layer is moved."""
        side = int(np.ceil(np.sqrt(self._n_layers)))
        return np.column_stack(np.divmod(layer, side)) * self._pitch


class OutlineIndex(SegmentIndex):
    """The outlines of all layers: segment i begins at point i of the areas, and ends at the point that follows it."""

    def __init__(self, areas: Areas, low: Float, high: Float) -> None:
        """Take clean areas, and the corners (2,) of the box, mm, in which all points to ask for will lie."""
        ends = areas.xy, areas.xy[areas.following]
        super().__init__(ends, areas.point_layer, areas.n_layers, (low, high))

    def inside(self, points: Float, layer: Int) -> Bool:
        """(P,) whether each point (P, 2) is in the area of its layer: a ray to the right leaves it an odd time."""
        if self._tree is None or not len(points):
            return np.zeros(len(points), np.bool_)
        far = np.column_stack([np.full(len(points), self._right), points[:, 1]])
        cell = self._cell(layer)
        point, segment = self._tree.meeting(points + cell, far + cell)
        (x, y), (ax, ay), (bx, by) = points[point].T, self._begin[segment].T, self._end[segment].T
        # Each end belongs to the part of the segment above it, so that a ray through a corner counts once.
        rising, falling = (ay <= y) & (by > y), (ay > y) & (by <= y)
        left = (bx - ax) * (y - ay) - (by - ay) * (x - ax)
        crossed = (rising & (left > 0)) | (falling & (left < 0))
        return np.asarray(np.bincount(point[crossed], minlength=len(points)) % 2 == 1)


def distance_to_segments(points: Float, begin: Float, end: Float) -> Float:
    """(P,) mm from each point (P, 2) to the segment from `begin` to `end` (P, 2) that goes with it."""
    way, gap = end - begin, points - begin
    # Seen from the begin: near a short segment far from the origin the place itself would lose digits.
    return np.asarray(np.hypot(*(gap - nearest_share(gap, way)[:, None] * way).T))
