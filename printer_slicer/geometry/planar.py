"""Alternative geometry engine: shapely, in floating point. It also simplifies rings if there is no kernel.

A layer is one shapely geometry: one or more polygons, possibly empty. Layers are stored in lists and processed as
arrays in single calls.
"""

# mypy: allow-untyped-calls

from __future__ import annotations

from typing import Any, Final

import numpy as np
import shapely
from numpy.typing import NDArray

from printer_slicer.arrays import Bool, Float, Int
from printer_slicer.geometry.areas import Areas
from printer_slicer.geometry.collinear_points import remove_collinear
from printer_slicer.geometry.polygons import (
    CLEARANCE,
    MITER_LIMIT,
    ROUND_TOLERANCE,
    STEPS_PER_MM,
    Join,
    OpenLines,
    Operation,
    gather_lines,
)
from printer_slicer.geometry.spikes import remove_spikes
from printer_slicer.geometry.vectors import cross, dot

__all__ = [
    "SegmentTree",
    "combine",
    "concatenate",
    "load",
    "load_any",
    "offset",
    "offset_open",
    "outlines_within",
    "simplify_rings",
    "store",
    "stroke",
    "take",
]

Shapes = NDArray[np.object_]

OPERATIONS: Final = {
    "union": shapely.union,
    "difference": shapely.difference,
    "intersection": shapely.intersection,
}


def load(areas: Areas) -> list[Any]:
    """Convert the areas to one geometry per layer; clean rings may touch, so `load_any` loads them."""
    return load_any(areas)


def load_any(areas: Areas) -> list[Any]:
    """Return one geometry per layer that covers everything with a positive winding number.

    The rings are cut where they meet. Of the faces between the cuts, those with a positive winding number are kept.
    """
    lines = _group_by_layer(_to_linear_rings(areas), areas.ring_layer, areas.n_layers)
    cut = shapely.union_all(lines[:, None], axis=1, grid_size=1 / STEPS_PER_MM)
    faces, face_layer = shapely.get_parts(shapely.polygonize(cut[:, None], axis=1), return_index=True)
    keep = (
        _find_winding_numbers(areas, shapely.get_coordinates(shapely.point_on_surface(faces)), face_layer) > 0
    )
    return list(
        shapely.union_all(_group_by_layer(faces[keep], face_layer[keep], areas.n_layers)[:, None], axis=1)
    )


def store(layers: list[Any]) -> Areas:
    """Convert all layers to one stack on the grid: outer rings counter-clockwise, holes clockwise."""
    polygons, layer = shapely.get_parts(_to_shape_array(layers), return_index=True)
    solid = shapely.get_type_id(polygons) == shapely.GeometryType.POLYGON
    rings, polygon = shapely.get_rings(shapely.orient_polygons(polygons[solid]), return_index=True)
    areas = _build_areas(rings, layer[solid][polygon], len(layers))
    grid = np.rint(areas.xy * STEPS_PER_MM) / STEPS_PER_MM
    return remove_spikes(remove_collinear(Areas(grid, areas.ring_start, areas.ring_layer, areas.n_layers)))


def take(layers: list[Any], indices: Int) -> list[Any]:
    """Return the layers with these indices (n,), in this order."""
    return [layers[index] for index in indices.tolist()]


def concatenate(layers: list[Any], others: list[Any]) -> list[Any]:
    """Return the layers followed by the others."""
    return layers + others


def combine(operation: Operation, a: list[Any], b: list[Any]) -> list[Any]:
    """Return the union, difference or intersection of two lists of layers, entry by entry."""
    return list(_select_polygons(OPERATIONS[operation](_to_shape_array(a), _to_shape_array(b))))


def outlines_within(outlines: Areas, layers: list[Any]) -> OpenLines:
    """Return the parts of the rings of `outlines` that lie within the areas of their layer."""
    rings = _to_linear_rings(outlines)
    first, last = np.searchsorted(
        outlines.ring_layer, [np.arange(len(layers)), np.arange(1, len(layers) + 1)]
    )
    result = []
    for k, area in enumerate(layers):
        parts = shapely.get_parts(shapely.intersection(rings[first[k] : last[k]], area))
        lines = shapely.get_parts(shapely.line_merge(shapely.multilinestrings(_select_lines(parts))))
        result.append(
            [np.rint(shapely.get_coordinates(line) * STEPS_PER_MM) / STEPS_PER_MM for line in lines]
        )
    return gather_lines(result)


def _select_lines(shapes: Shapes) -> Shapes:
    """Return only the lines, without the points at which shapes touched."""
    return shapes[np.isin(shapely.get_type_id(shapes), (1, 2))]


def offset(layers: list[Any], distance: Float, join: Join, limit: float = MITER_LIMIT) -> list[Any]:
    """Move the outlines of each layer outward by its distance, mm."""
    shapes = _to_shape_array(layers)
    if join == "round":
        return list(shapely.buffer(shapes, distance, quad_segs=_count_quarter_steps(distance)))
    result = _buffer_mitered(shapes, distance, limit)
    kites, sharp = _make_corner_kites(store(layers), distance, limit)
    # GEOS cuts off sharp corners at the limit. On layers with such corners, cut off all corners at the distance,
    # then add the points of the other corners again.
    square = _buffer_mitered(shapes[sharp], distance[sharp], 1.0)
    grown = shapely.union(square, kites[sharp], grid_size=1 / STEPS_PER_MM)
    shrunk = shapely.difference(square, kites[sharp], grid_size=1 / STEPS_PER_MM)
    result[sharp] = np.where(distance[sharp] > 0, grown, shrunk)
    return list(result)


def stroke(xy: Float, start: Int, layer: Int, radius: Float, n_layers: int) -> list[Any]:
    """Return for each layer the area within a radius of its open polylines."""
    index = np.repeat(np.arange(len(layer)), np.diff(start))
    lines = np.asarray(shapely.linestrings(xy, indices=index), dtype=np.object_)
    order = np.lexsort((radius, layer))
    new = np.diff(layer[order], prepend=-1).astype(np.bool_) | (np.diff(radius[order], prepend=-1.0) != 0)
    pen, first = np.cumsum(new) - 1, order[new]
    drawn = shapely.buffer(
        _group_by_layer(lines[order], pen, len(first)), radius[first], quad_segs=_count_quarter_steps(radius)
    )
    return list(shapely.union_all(_group_by_layer(drawn, layer[first], n_layers)[:, None], axis=1))


def offset_open(layers: list[Any], distance: Float, limit: float) -> list[Any]:
    """Remove everything narrower than twice the distance, mm, from each layer."""
    grown = offset(offset(layers, -distance, "miter"), distance + CLEARANCE, "miter", limit)
    return combine("intersection", layers, grown)


def _buffer_mitered(shapes: Shapes, distance: Float, limit: float) -> Shapes:
    # GEOS divides by zero for the intersection of parallel sides and handles it; numpy would warn.
    with np.errstate(invalid="ignore", divide="ignore"):
        buffered: Shapes = shapely.buffer(shapes, distance, join_style="mitre", mitre_limit=limit)
    return buffered


def simplify_rings(areas: Areas, tolerance: float) -> Areas:
    """Simplify rings, each of which begins at a corner, see `engine.simplify`; some may collapse."""
    rings = shapely.simplify(_to_linear_rings(areas), tolerance, preserve_topology=False)
    return _build_areas(rings, areas.ring_layer, areas.n_layers)


def _to_shape_array(layers: list[Any]) -> Shapes:
    shapes: Shapes = np.full(len(layers), None, dtype=np.object_)
    shapes[:] = layers
    return shapes


def _to_linear_rings(areas: Areas) -> Shapes:
    index = areas.point_ring
    return np.asarray(shapely.linearrings(areas.xy, indices=index), dtype=np.object_)


def _group_by_layer(shapes: Shapes, layer: Int, n_layers: int) -> Shapes:
    """Return one collection of shapes per layer (n_layers,); `layer` gives the layer of each shape, ascending."""
    groups: Shapes = np.full(n_layers, shapely.from_wkt("GEOMETRYCOLLECTION EMPTY"), dtype=np.object_)
    if len(shapes):
        shapely.geometrycollections(shapes, indices=layer, out=groups)
    return groups


def _select_polygons(shapes: Shapes) -> Shapes:
    """Remove the lines and points in which areas touched."""
    kind = shapely.get_type_id(shapes)
    mixed = (kind != shapely.GeometryType.POLYGON) & (kind != shapely.GeometryType.MULTIPOLYGON)
    parts, index = shapely.get_parts(shapes[mixed], return_index=True)
    solid = shapely.get_type_id(parts) == shapely.GeometryType.POLYGON
    shapes[mixed] = shapely.union_all(
        _group_by_layer(parts[solid], index[solid], int(mixed.sum()))[:, None], axis=1
    )
    return shapes


def _build_areas(rings: Shapes, layer: Int, n_layers: int) -> Areas:
    """Build a stack from closed shapely rings, one per entry of `layer`; some may have fewer than three points."""
    xy, index = shapely.get_coordinates(rings, return_index=True)
    closing = np.append(index[1:] != index[:-1], True)[: len(index)]
    sizes = np.bincount(index[~closing], minlength=len(rings))
    return Areas(xy[~closing], np.append(0, np.cumsum(sizes)), layer, n_layers)


def _find_winding_numbers(areas: Areas, points: Float, point_layer: Int) -> Int:
    """Return for each point the winding number (P,) of the rings of its layer."""
    winding = np.zeros(len(points), dtype=np.int64)
    ends = areas.xy[areas.following]
    bounds = areas.ring_start[areas.layer_start]
    first, last = np.searchsorted(point_layer, [np.arange(areas.n_layers), np.arange(1, areas.n_layers + 1)])
    for k in np.unique(point_layer).tolist():
        here = slice(bounds[k], bounds[k + 1])
        winding[first[k] : last[k]] = _count_windings(areas.xy[here], ends[here], points[first[k] : last[k]])
    return winding


def _count_windings(starts: Float, ends: Float, points: Float) -> Int:
    """Return for each point the winding number (P,) of the edges.

    It is the number of edges that cross the ray to the right upward, minus those that cross it downward.

    Source: Hormann & Agathos, The point in polygon problem for arbitrary polygons, 2001.
    """
    x, y = points[:, :1], points[:, 1:]
    (ax, ay), (bx, by) = starts.T, ends.T
    above_a, above_b = ay > y, by > y
    left = (bx - ax) * (y - ay) - (by - ay) * (x - ax) > 0
    upward, downward = ~above_a & above_b & left, above_a & ~above_b & ~left
    return np.asarray(upward.sum(axis=1) - downward.sum(axis=1), dtype=np.int64)


def _count_quarter_steps(distance: Float) -> int:
    """Return the number of chords per quarter circle that keeps the largest circle within the tolerance."""
    radius = float(np.abs(distance).max(initial=0.0))
    if radius <= ROUND_TOLERANCE:
        return 2
    return max(2, int(np.ceil(np.pi / 4 / np.arccos(1 - ROUND_TOLERANCE / radius))))


def _make_corner_kites(areas: Areas, distance: Float, limit: float) -> tuple[Shapes, Bool]:
    """Return the kite-shaped areas that mitered joins add at corners within the limit.

    Growing opens a gap at convex corners, shrinking at concave ones.

    Returns:
        One collection of kites per layer, empty on layers without sharp corners, and a mask (n_layers,) of the layers
        with corners beyond the limit.
    """
    layer = areas.point_layer
    along = areas.xy[areas.following] - areas.xy
    along /= np.hypot(*along.T)[:, None]
    outward = np.stack([along[:, 1], -along[:, 0]], axis=1)
    before, after = outward[areas.previous], outward
    turn, cosine = cross(before, after), dot(before, after)
    gap = turn * distance[layer] > 0
    # The point is 1 / cos(turn / 2) distances away.
    within = limit**2 * (1 + cosine) >= 2
    sharp = np.bincount(layer[gap & ~within], minlength=areas.n_layers) > 0
    chosen = gap & within & sharp[layer]
    corner, by, before, after = areas.xy[chosen], distance[layer[chosen], None], before[chosen], after[chosen]
    point = corner + by * (before + after) / (1 + cosine[chosen, None])
    kites = shapely.polygons(np.stack([corner, corner + by * before, point, corner + by * after], axis=1))
    return shapely.union_all(_group_by_layer(kites, layer[chosen], areas.n_layers)[:, None], axis=1), sharp


class SegmentTree:
    """Search tree for segments in the plane."""

    def __init__(self, ends: Float) -> None:
        """Build the tree from the ends (S, 2, 2) of at least one segment."""
        self._tree = shapely.STRtree(shapely.linestrings(ends))

    def nearest(self, points: Float) -> Int:
        """Return the segment (P,) nearest to each point (P, 2); if several are equally near, any of these."""
        found = self._tree.query_nearest(shapely.points(points), all_matches=False)
        return np.asarray(found[1], dtype=np.int64)

    def first_nearest(self, points: Float) -> Int:
        """Return the segment (P,) nearest to each point (P, 2), the first of several."""
        point, segment = self._tree.query_nearest(shapely.points(points))
        first = np.full(len(points), np.iinfo(np.int64).max)
        np.minimum.at(first, point, segment)
        return first

    def query_boxes(self, low: Float, high: Float) -> tuple[Int, Int]:
        """Return index pairs (box, segment) where the bounding box of a segment touches a box `low`-`high` (B, 2)."""
        diagonals = shapely.linestrings(np.stack([low, high], axis=1))
        box, segment = np.asarray(self._tree.query(diagonals), dtype=np.int64)
        return box, segment
