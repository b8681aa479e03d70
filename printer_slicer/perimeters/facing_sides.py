"""Find narrow places: pairs of sides and corners of an outline that face each other within a distance.

The medial axis is narrowest at a waist, where an inward corner faces a side or another inward corner, or between two
nearly parallel sides. So only such pairs are searched. Whether something lies between them is not tested: if so, one
of them faces that.
"""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Bool, Float, Int
from printer_slicer.geometry import Areas
from printer_slicer.geometry.boxes import Boxes
from printer_slicer.geometry.vectors import cross, dot, nearest_on_segments, norm
from printer_slicer.kernel import load_kernel
from printer_slicer.values import Struct

__all__ = ["find_facing_sides"]

_SMALL_TURN = 1e-4  # radians; smaller turns count as straight
_SLACK = 1e-6  # mm
# The side of an equilateral triangle is 1.73 times the diameter of its inscribed circle.
_SMALL_RING_RATIO = 1.8


def find_facing_sides(areas: Areas, distance: Float, max_angle: float) -> Boxes:
    """Return boxes around the parts of outlines where sides or corners face each other.

    Args:
        areas: clean areas.
        distance: (L,) mm, largest distance between facing sides or corners.
        max_angle: radians, largest angle between facing sides.
    """
    sides, kernel = _OutlineSides.of(areas), load_kernel()
    boxes = Boxes.of_sides(areas)
    low, high, layer = boxes.low, boxes.high, boxes.layer
    if kernel is None:
        box_low, box_high = _find_facing_parts(sides, boxes, max_angle, distance[layer])
    else:
        numbers = [sides.begin, sides.end, sides.normal, sides.normal_before]
        numbers.append(np.column_stack([layer, distance[layer], sides.inward]))
        found = kernel.facing_boxes(np.concatenate(numbers, axis=1).data, float(np.cos(max_angle)))
        box_low, box_high = np.hsplit(np.frombuffer(found).reshape(-1, 4).copy(), 2)
    small = _mark_small_rings(areas, distance)
    box_low[small], box_high[small] = np.minimum(box_low, low)[small], np.maximum(box_high, high)[small]
    chosen = np.flatnonzero(box_low[:, 0] < np.inf)
    return _merge_boxes(
        Boxes(box_low[chosen], box_high[chosen], layer[chosen]), float(distance.max(initial=0.0))
    )


def _find_facing_parts(
    sides: _OutlineSides, boxes: Boxes, max_angle: float, reach: Float
) -> tuple[Float, Float]:
    """Return the box around the part of each side that faces another side within `reach` (S,) mm.

    Returns:
        The lowest and highest corner of each box (S, 2); these are infinite for sides without such a part.
    """
    low, high = boxes.low, boxes.high
    a, b = boxes.expand(reach / 2).find_neighbours()
    found = sides.is_facing(a, b, max_angle, reach[a])
    a, b = a[found], b[found]
    far = reach[a, None]
    between_low = np.maximum(low[a], low[b] - far), np.maximum(low[b], low[a] - far)
    between_high = np.minimum(high[a], high[b] + far), np.minimum(high[b], high[a] + far)
    box_low, box_high = np.full_like(low, np.inf), np.full_like(low, -np.inf)
    for side, some_low, some_high in zip((a, b), between_low, between_high, strict=True):
        np.minimum.at(box_low, side, some_low)
        np.maximum.at(box_high, side, some_high)
    return box_low, box_high


def _merge_boxes(boxes: Boxes, size: float) -> Boxes:
    """Merge consecutive boxes whose corners lie in the same cells of `size` mm."""
    if not len(boxes.layer):
        return boxes
    cell = np.column_stack([boxes.layer, np.floor(boxes.low / size), np.floor(boxes.high / size)])
    first = np.flatnonzero(np.append(True, (np.diff(cell, axis=0) != 0).any(axis=1)))
    low, high = np.minimum.reduceat(boxes.low, first), np.maximum.reduceat(boxes.high, first)
    return Boxes(low, high, boxes.layer[first])


def _mark_small_rings(areas: Areas, distance: Float) -> Bool:
    """Return which sides (S,) belong to outer rings hardly longer than the distance.

    The sides of such a ring need not face each other.
    """
    if not areas.n_rings:
        return np.zeros(0, np.bool_)
    starts, size = areas.ring_start[:-1], np.diff(areas.ring_start)
    extent = np.maximum.reduceat(areas.xy, starts) - np.minimum.reduceat(areas.xy, starts)
    small = (extent.max(axis=1) < _SMALL_RING_RATIO * distance[areas.ring_layer]) & (areas.ring_area() > 0)
    return np.repeat(small, size)


class _OutlineSides(Struct, frozen=True, eq=False):
    """Sides of outlines, and the corners at their beginnings.

    Attributes:
        begin: (S, 2) mm.
        end: (S, 2) mm.
        normal: (S, 2) unit normal, into the area.
        normal_before: (S, 2) normal of the previous side.
        inward: (S,) whether the corner at the beginning points into the area.
    """

    begin: Float
    end: Float
    normal: Float
    normal_before: Float
    inward: Bool

    @classmethod
    def of(cls, areas: Areas) -> _OutlineSides:
        """Return the sides of areas, in the order of their first points."""
        begin, end = areas.xy, areas.xy.take(areas.following, axis=0)
        way = end - begin
        way = way / np.maximum(norm(way), 1e-12)[:, None]
        normal = np.column_stack([-way[:, 1], way[:, 0]])
        before = areas.previous
        turn = cross(way.take(before, axis=0), way)
        return cls(begin, end, normal, normal.take(before, axis=0), turn < -_SMALL_TURN)

    def is_facing(self, a: Int, b: Int, max_angle: float, reach: Float) -> Bool:
        """Return whether sides, or the corners at their beginnings, face each other within `reach` (n,) mm."""
        found = self.is_parallel(a, b, np.cos(max_angle), reach)
        found |= self.corner_faces_side(a, b, reach) | self.corner_faces_side(b, a, reach)
        return found | self.corners_face(a, b, reach)

    def is_parallel(self, a: Int, b: Int, cosine: float, reach: Float) -> Bool:
        """Test whether two sides (n,) face each other and are nearly parallel."""
        opposite = np.flatnonzero(_row_products(self.normal, a, self.normal, b) <= -cosine)
        result = np.zeros(len(a), np.bool_)
        a, b, reach = a[opposite], b[opposite], reach[opposite]
        near = np.zeros(len(a), np.bool_)
        for one, other in ((a, b), (b, a)):
            for point in (self.begin[one], self.end[one]):
                foot, _ = nearest_on_segments(point, self.begin[other], self.end[other])
                near |= (norm(point - foot) <= reach) & (
                    dot(point - self.begin[other], self.normal[other]) > -_SLACK
                )
        result[opposite] = near
        return result

    def corner_faces_side(self, a: Int, b: Int, reach: Float) -> Bool:
        """Test whether the corner at the beginning of `a` (n,) faces the side `b` at a right angle."""
        result = np.zeros(len(a), np.bool_)
        some = np.flatnonzero(self.inward[a])
        a, b, reach = a[some], b[some], reach[some]
        height = _row_products(self.begin, a, self.normal, b) - _row_products(self.begin, b, self.normal, b)
        within = np.flatnonzero((height > _SLACK) & (height <= reach))
        some, a, b, height = some[within], a[within], b[within], height[within]
        foot = self.begin[a] - height[:, None] * self.normal[b]
        along = self.end[b] - self.begin[b]
        place = dot(foot - self.begin[b], along)
        square = (place > -_SLACK) & (place < dot(along, along) + _SLACK)
        result[some] = square & self._contains_direction(a, -self.normal[b])
        return result

    def corners_face(self, a: Int, b: Int, reach: Float) -> Bool:
        """Test whether the corners at the beginnings of `a` and `b` (n,) face each other."""
        result = np.zeros(len(a), np.bool_)
        some = np.flatnonzero(self.inward[a] & self.inward[b])
        way = self.begin[b[some]] - self.begin[a[some]]
        near = np.flatnonzero(dot(way, way) <= reach[some] ** 2)
        some, way = some[near], way[near]
        result[some] = self._contains_direction(a[some], way) & self._contains_direction(b[some], -way)
        return result

    def _contains_direction(self, corner: Int, direction: Float) -> Bool:
        """Test whether directions (n,) lie between the normals of the two sides of a corner."""
        first, second = self.normal_before[corner], self.normal[corner]
        size = np.maximum(norm(direction), 1e-12) * 1e-3
        between = (cross(first, direction) <= size) & (cross(second, direction) >= -size)
        return np.asarray(between & (dot(first + second, direction) > 0))


def _row_products(one: Float, a: Int, other: Float, b: Int) -> Float:
    """Return the scalar products (n,) of rows `a` of one array with rows `b` of another one."""
    (x, y), (u, v) = one.T, other.T
    return np.asarray(x.take(a) * u.take(b) + y.take(a) * v.take(b))
