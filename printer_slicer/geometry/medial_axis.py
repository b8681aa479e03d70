"""Medial axis of areas: the part of the Voronoi diagram of their outlines inside the areas.

Each connected area has its own diagram.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, compact_ids, consecutive, distinct, frozen_array
from printer_slicer.geometry.areas import Areas
from printer_slicer.geometry.connected_areas import split_connected
from printer_slicer.geometry.polygons import STEPS_PER_MM
from printer_slicer.geometry.self_intersections import find_layers_with_self_intersections
from printer_slicer.geometry.vectors import cross, dot, nearest_on_segments, norm
from printer_slicer.geometry.voronoi_diagram import Diagram, compute_diagrams
from printer_slicer.kernel import load_kernel
from printer_slicer.values import Struct, force_setattr

__all__ = ["CHORD", "MedialAxis", "follow_parts", "medial_axis"]

CHORD: Final = 0.005  # mm, deviation of the straight pieces from a parabola
_STEP = 0.2  # radians between neighbouring points around a corner: chords within 0.5 % of the radius
_TIP = 1e-6  # mm; a radius below this is the tip of a corner
_MAX_PIECES = 64  # of one edge


class MedialAxis(Struct, frozen=True, eq=False):
    """Medial axis: points equally far from two positions on the outline, joined by straight pieces.

    Piece `e` consists of two half-pieces, `2e` and `2e + 1`, in opposite directions. Each belongs to the side or corner
    of the outline on its left.

    Attributes:
        xy: (V, 2) mm.
        radius: (V,) mm, distance to the outline: half the width of the area there.
        layer: (V,) layer of each point.
        start: (H,) point at which each half-piece starts; it ends where its twin `h ^ 1` starts.
        foot: (H, 2, 2) mm, the nearest points on its side or corner, for both ends.
        following: (H,) the next half-piece with the outline on the left; -1 beyond reach.
        source: (H,) index of the point of the areas that is its corner, or at which its side starts.
        corner: (H,) whether it belongs to a corner.
        left_out: layers without an axis, because their sides intersect other than at their ends.
    """

    xy: Float
    radius: Float
    layer: Int
    start: Int
    foot: Float
    following: Int
    source: Int
    corner: Bool
    left_out: Int

    def __post_init__(self) -> None:
        n, h = len(self.xy), len(self.start)
        for name, dtype, shape in (
            ("xy", np.float64, (n, 2)),
            ("radius", np.float64, (n,)),
            ("layer", np.int64, (n,)),
            ("start", np.int64, (h,)),
            ("foot", np.float64, (h, 2, 2)),
            ("following", np.int64, (h,)),
            ("source", np.int64, (h,)),
            ("corner", np.bool_, (h,)),
            ("left_out", np.int64, (-1,)),
        ):
            force_setattr(self, name, frozen_array(getattr(self, name), dtype, shape))

    @property
    def end(self) -> Int:
        """Index (H,) of the point at which each half-piece ends."""
        return np.asarray(self.start.reshape(-1, 2)[:, ::-1].ravel())


def medial_axis(areas: Areas, reach: float, sides: Bool | None = None, *, chord: float = CHORD) -> MedialAxis:
    """Compute the medial axis where the areas are at most twice `reach` wide, and slightly beyond.

    Args:
        areas: clean areas.
        reach: mm; pieces that are farther from the outline at both ends are left out.
        sides: (N,) mask of the sides of the outlines to use, indexed by their start points; all if not given.
            Where an unused side would be the nearest one, the result is not the axis of the areas.
        chord: mm, deviation from a parabola; the angle between points around corners scales with it.
    """
    selected = _select_sides(areas, sides)
    steps = np.rint(selected.points[:, 1:3] * STEPS_PER_MM).astype(np.int64)
    entangled = np.isin(selected.piece, find_layers_with_self_intersections(steps, selected.piece))
    left_out = distinct(selected.layer[entangled])
    if len(left_out):  # they have no diagram
        selected = selected.take(np.flatnonzero(~np.isin(selected.layer, left_out)))
    if not len(selected.layer):
        none, nowhere = np.zeros(0, np.int64), np.zeros((0, 2))
        feet_of_none = np.zeros((0, 2, 2))
        return MedialAxis(
            nowhere, np.zeros(0), none, none, feet_of_none, none, none, np.zeros(0, np.bool_), left_out
        )
    return _compute_axis(selected, reach, left_out, chord)


class _Sides(Struct, frozen=True, eq=False):
    """Sides of the outlines.

    Attributes:
        points: (S, 4, 2) mm: the previous point, start and end of the side, the next point.
        index: (S, 2) indices of the points of the areas at which each side starts and ends.
        layer: (S,) ascending.
        piece: (S,) connected area of each side, ascending.
    """

    points: Float
    index: Int
    layer: Int
    piece: Int

    def take(self, items: Int) -> _Sides:
        """Return the sides with the given indices."""
        return _Sides(
            self.points.take(items, axis=0),
            self.index.take(items, axis=0),
            self.layer[items],
            self.piece[items],
        )


def _select_sides(areas: Areas, sides: Bool | None) -> _Sides:
    """Select the sides of outlines from which the medial axis is computed."""
    after = areas.following
    index = np.stack([areas.previous, np.arange(len(after)), after, after[after]], axis=1)
    piece = split_connected(areas).of_ring[areas.point_ring]
    # For a point inside an area the nearest outline is always its own, so each area gets a separate diagram.
    taken = piece >= 0 if sides is None else sides & (piece >= 0)
    order = np.argsort(piece, kind="stable")
    order = order[taken[order]]
    layer, index, piece = areas.point_layer[order], index[order], piece[order]
    return _Sides(areas.xy.take(index.ravel(), axis=0).reshape(-1, 4, 2), index[:, 1:3], layer, piece)


class _DiagramEdges(Struct, frozen=True, eq=False):
    """Edges of the diagram, each followed by its twin, before they are split into pieces.

    Attributes:
        vertex: (h, 2) start and end vertex of each edge.
        ends: (h, 2, 2) mm, positions of these vertices.
        corner: (h,) whether the cell belongs to a corner.
        points: (h, 4, 2) mm of the cell's side or corner: before, begin, end, after; equal begin and end for a corner.
        source: (h,) index of the point at `begin`.
        layer: (h,) layer of each edge.
    """

    vertex: Int
    ends: Float
    corner: Bool
    points: Float
    source: Int
    layer: Int

    def take(self, items: Int) -> _DiagramEdges:
        """Return the edges with the given indices."""
        return _DiagramEdges(
            self.vertex.take(items, axis=0),
            self.ends.take(items, axis=0),
            self.corner.take(items),
            self.points.take(items, axis=0),
            self.source.take(items),
            self.layer.take(items),
        )

    def nearest_points(self, xy: Float, which: Int) -> Float:
        """Return for k points (n, k, 2) each the nearest positions on the side or corner of the edges `which` (n,)."""
        begin, end = (self.points[:, i].take(which, axis=0)[:, None] for i in (1, 2))
        return nearest_on_segments(xy, begin, end)[0]


def follow_parts(following: Int, count: Int) -> Int:
    """Return the successors (2 P,) of directed parts: the next part, or the first part of the next piece.

    Args:
        following: (2 E,) successor of each directed piece, or -1.
        count: (E,) number of parts of each piece, P in total.
    """
    first, owner = np.cumsum(count) - count, np.repeat(np.arange(len(count)), count)
    last = (first + count - 1)[owner]
    entry = np.stack([2 * first, 2 * (first + count) - 1], axis=1).ravel()
    onward = np.where(following < 0, -1, entry[following])
    part = np.arange(len(owner))
    up = np.where(part == last, onward[2 * owner], 2 * part + 2)
    down = np.where(part == first[owner], onward[2 * owner + 1], 2 * part - 1)
    return np.stack([up, down], axis=1).ravel()


def _compute_axis(sides: _Sides, reach: float, left_out: Int, chord: float) -> MedialAxis:
    """Compute the medial axis from sides on the remaining layers."""
    diagram = compute_diagrams(sides.points[:, 1:3], sides.piece)
    places, edge = _clip_infinite_edges(diagram, sides.points, 2 * reach)
    chosen = np.flatnonzero(diagram.primary & (edge >= 0).all(axis=1))
    kernel = load_kernel()
    if kernel:
        cell, ends = diagram.cell[chosen], places.take(edge.take(chosen, axis=0).ravel(), axis=0)
        cells = np.stack([diagram.side[cell], diagram.place[cell]], axis=1)
        chosen = chosen[
            np.frombuffer(kernel.inner_edges(sides.points.data, cells.data, ends.data, reach), np.bool_)
        ]
        edges = _gather_edges(sides, diagram, (places, edge), chosen)
    else:
        edges = _gather_edges(sides, diagram, (places, edge), chosen)
        kept = np.flatnonzero(_is_inner(edges, reach))
        edges, chosen = edges.take(kept), chosen[kept]
    return _split_edges(edges, _find_next_edges(diagram, chosen), left_out, chord)


def _gather_edges(sides: _Sides, diagram: Diagram, ends: tuple[Float, Int], chosen: Int) -> _DiagramEdges:
    """Gather the chosen edges (h,); `ends` holds the vertices (V, 2), mm, and those of each edge (E, 2)."""
    cell, vertex = diagram.cell[chosen], ends[1].take(chosen, axis=0)
    site, place = diagram.side[cell], diagram.place[cell]
    points = sides.points.take(site, axis=0)
    at_end = place == 2
    points[at_end, :2] = points[at_end, 1:3]
    points[at_end, 2] = points[at_end, 1]
    points[place == 1, 2:] = points[place == 1, 1:3]
    return _DiagramEdges(
        vertex,
        ends[0].take(vertex.ravel(), axis=0).reshape(-1, 2, 2),
        place <= 2,
        points,
        sides.index[site, at_end.astype(np.int64)],
        sides.layer[site],
    )


def _is_inner(edges: _DiagramEdges, reach: float) -> Bool:
    """Return a mask (h,) of edges inside the areas that are within reach of the outline at one end at least."""
    twin = np.arange(len(edges.corner)) ^ 1  # both edges of a pair are primary, or neither is
    begin, end = edges.points[:, 1], edges.points[:, 2]
    near = [
        norm(place - nearest_on_segments(place, begin, end)[0]) <= reach
        for place in np.moveaxis(edges.ends, 1, 0)
    ]
    kept = _is_inside(edges, twin) & (near[0] | near[1])
    return np.asarray(kept & kept[twin])


def _clip_infinite_edges(diagram: Diagram, points: Float, length: float) -> tuple[Float, Int]:
    """Clip infinite edges `length` mm from their start; return vertices (V, 2) and the vertex at both ends (E, 2).

    Infinite edges lie between two corners, where the sides beyond are not used.
    """
    edge = np.stack([diagram.start, diagram.end], axis=1)
    if not np.isfinite(length):  # all sides are used, so infinite edges lie outside
        return diagram.vertex, edge
    away = np.flatnonzero(diagram.primary & (diagram.start >= 0) & (diagram.end < 0))
    away = away[(diagram.place[diagram.cell[np.stack([away, away ^ 1])]] <= 2).all(axis=0)]
    cell = diagram.cell[np.stack([away, away ^ 1])]
    left, right = points[diagram.side[cell], diagram.place[cell]]  # 1: where a side begins, 2: where it ends
    across = left - right
    direction = np.column_stack([across[:, 1], -across[:, 0]])
    direction *= (length / np.maximum(norm(direction), 1e-12))[:, None]
    edge[away, 1] = edge[away ^ 1, 0] = len(diagram.vertex) + np.arange(len(away))
    return np.concatenate([diagram.vertex, diagram.vertex[diagram.start[away]] + direction]), edge


def _is_inside(edges: _DiagramEdges, twin: Int) -> Bool:
    """Return a mask (h,) of edges inside the areas, to the left of the side or corner to which they belong."""
    middle = (edges.ends[:, 0] + edges.ends[:, 1]) / 2
    before, begin, end, after = np.moveaxis(edges.points, 1, 0)
    left = cross(end - begin, middle - begin) > 0
    around = (cross(begin - before, middle - before) > 0) | (cross(after - begin, middle - begin) > 0)
    inward = cross(begin - before, after - begin) < 0
    inside = np.where(edges.corner, around & inward, left)
    # If one of the two cells belongs to a side, that side decides.
    both = np.where(edges.corner == edges.corner[twin], inside & inside[twin], inside[twin])
    return np.where(edges.corner, both, inside)


def _find_next_edges(diagram: Diagram, chosen: Int) -> Int:
    """Return for each chosen edge (h,) the next chosen edge with the outline on the left, or -1.

    Edges between a side and its own end are crossed: the axis continues in the cell of that end.
    """
    number = np.full(len(diagram.start), -1)
    number[chosen] = np.arange(len(chosen))
    result = np.full(len(chosen), -1)
    left, here = np.arange(len(chosen)), chosen
    while len(left):
        there = diagram.after[here]
        known = diagram.end[here] >= 0
        through = known & ~diagram.primary[there]
        result[left] = np.where(known & ~through, number[there], -1)
        left, here = left[through], there[through] ^ 1
    return result


def _split_edges(edges: _DiagramEdges, following: Int, left_out: Int, chord: float) -> MedialAxis:
    """Split edges into straight pieces where the edges, or extrusions along them, are curved."""
    used, number = compact_ids(edges.vertex, int(edges.vertex.max(initial=-1)) + 1)
    xy, layer = np.zeros((len(used), 2)), np.zeros(len(used), np.int64)
    xy[number], layer[number] = edges.ends, edges.layer[:, None]
    count, inner = _find_split_points(edges, chord)
    edge, step = np.repeat(np.arange(len(count)), count), consecutive(np.zeros_like(count), count)
    new = len(used) + np.cumsum(count - 1) - (count - 1)
    is_first, is_last = step == 0, step == count[edge] - 1
    ends = np.stack(
        [
            np.where(is_first, number[2 * edge, 0], new[edge] + step - 1),
            np.where(is_last, number[2 * edge, 1], new[edge] + step),
        ],
        axis=1,
    )
    after = follow_parts(following, count)
    owner = np.stack([2 * edge, 2 * edge + 1], axis=1).ravel()
    all_xy = np.concatenate([xy, inner])
    of_new = 2 * np.repeat(np.arange(len(count)), count - 1)
    start = ends.ravel()
    places = all_xy.take(np.stack([start, ends[:, ::-1].ravel()], axis=1).ravel(), axis=0).reshape(-1, 2, 2)
    foot = edges.nearest_points(places, owner)
    radius = np.zeros(len(all_xy))
    radius[start] = norm(places[:, 0] - foot[:, 0])
    # At the tip of a corner the axis turns back, even if other outlines touch there.
    onto_tip = np.flatnonzero(radius[ends[:, ::-1].ravel()] < _TIP)
    after[onto_tip] = onto_tip ^ 1
    return MedialAxis(
        all_xy,
        radius,
        np.concatenate([layer, edges.layer[of_new]]),
        start,
        foot,
        after,
        edges.source[owner],
        edges.corner[owner],
        left_out,
    )


def _find_split_points(edges: _DiagramEdges, chord: float) -> tuple[Int, Float]:
    """Return the number of pieces (h / 2,) of each edge, and the points (n, 2) between the pieces.

    Between a corner and a side the edge is a parabola. Between two corners it is straight, but an extrusion beside it
    curves around the corner. Seen from the corner, points are at most `_STEP` apart if `chord` is `CHORD`.
    """
    most = _STEP * np.sqrt(chord / CHORD)
    up, down = edges.corner[::2], edges.corner[1::2]
    two = up & down
    focus = np.where(up[:, None], edges.points[::2, 1], edges.points[1::2, 1])
    other = np.where(up[:, None], edges.points[1::2, 1], edges.points[::2, 1])
    end_of_other = np.where(up[:, None], edges.points[1::2, 2], edges.points[::2, 2])
    along = end_of_other - other
    across = np.where(two[:, None], focus - other, np.stack([-along[:, 1], along[:, 0]], axis=1))
    across /= np.maximum(norm(across), 1e-12)[:, None]
    gap = dot(focus - other, across)[:, None]
    across *= np.sign(gap)
    gap = np.abs(gap[:, 0]) / np.where(two, 2, 1)
    tangent = np.stack([across[:, 1], -across[:, 0]], axis=1)
    u = dot(edges.ends[::2] - focus[:, None], tangent[:, None])
    curved = (up | down) & (gap > 1e-5)
    gap = np.where(curved, gap, 1.0)
    half = np.where(two, 1.0, 2.0)[:, None]
    angle = half * np.arctan(u / gap[:, None])
    steep = 2 * np.sqrt(8 * chord / gap) * np.cos(np.maximum(*np.abs(angle).T) / 2) ** 2
    widest = np.where(two, most, np.minimum(most, steep))
    wanted = np.ceil(np.abs(angle[:, 1] - angle[:, 0]) / widest - 1e-9)
    count = np.where(curved, np.clip(wanted, 1, _MAX_PIECES), 1).astype(np.int64)
    edge, step = np.repeat(np.arange(len(count)), count - 1), 1 + consecutive(np.zeros_like(count), count - 1)
    turn = angle[edge, 0] + (angle[edge, 1] - angle[edge, 0]) * step / count[edge]
    place = gap[edge] * np.tan(turn / half[edge, 0])
    back = np.where(two[edge], gap[edge], gap[edge] - (place**2 + gap[edge] ** 2) / (2 * gap[edge]))
    return count, (
        focus.take(edge, axis=0)
        + place[:, None] * tangent.take(edge, axis=0)
        - back[:, None] * across.take(edge, axis=0)
    )
