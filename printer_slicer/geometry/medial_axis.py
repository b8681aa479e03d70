"""The medial axis of areas: the part of the Voronoi diagram of their outlines that lies inside.

Places where outlines of other layers, or the far side of an outline, are nearest are no part of it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, compact_ids, consecutive, distinct, frozen_array
from printer_slicer.geometry.areas import Areas
from printer_slicer.geometry.connected_areas import split_connected
from printer_slicer.geometry.polygons import STEPS_PER_MM
from printer_slicer.geometry.self_intersections import layers_with_self_intersections
from printer_slicer.geometry.vectors import cross, dot, feet, norm
from printer_slicer.geometry.voronoi_diagram import Diagram, diagram_of

__all__ = ["CHORD", "MedialAxis", "follow_parts", "medial_axis"]

CHORD: Final = 0.005  # mm between a parabola and its pieces
_STEP = 0.2  # radians between neighbouring points around a corner: chords within 0.5 % of the radius
_TIP = 1e-6  # mm of radius
_MOST = 64  # pieces of one edge


@dataclass(frozen=True, slots=True, eq=False)
class MedialAxis:
    """Points that are equally far from two places of the outline, joined by straight pieces.

    Piece `e` is two half-pieces, `2e` and `2e + 1`, that run in opposite directions. Each belongs to the side or corner
    of the outline on its left, so that the outline goes by the other way.

    Attributes:
        xy: (V, 2) mm.
        radius: (V,) mm to the outline: half of what the area is wide there.
        layer: (V,).
        start: (H,) point at which each half-piece begins; it ends where its twin `h ^ 1` begins.
        foot: (H, 2, 2) mm, the places of the own side or corner that are nearest to both ends.
        following: (H,) the half-piece that goes on with the outline on the left; -1 beyond reach.
        source: (H,) index of the point of the areas that is the own corner, or at which the own side begins.
        corner: (H,) whether it belongs to a corner.
        left_out: layers that have no axis, since sides meet there elsewhere than at their ends.
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
            object.__setattr__(self, name, frozen_array(getattr(self, name), dtype, shape))

    @property
    def end(self) -> Int:
        """(H,) point at which each half-piece ends."""
        return np.asarray(self.start.reshape(-1, 2)[:, ::-1].ravel())


def medial_axis(areas: Areas, reach: float, sides: Bool | None = None, *, chord: float = CHORD) -> MedialAxis:
    """The medial axis where the areas are at most twice `reach` wide, and a little beyond.

    Args:
        areas: clean areas.
        reach: mm; pieces that are farther from the outline at both ends are left out.
        sides: (N,) which sides of the outlines, named by the points at which they begin, take part; all if not given.
            Where a side that does not is nearest, the axis is not that of the areas.
        chord: mm between a parabola and its pieces; the angle between points around corners goes with it.
    """
    found = _sides(areas, sides)
    steps = np.rint(found.points[:, 1:3] * STEPS_PER_MM).astype(np.int64)
    entangled = np.isin(found.piece, layers_with_self_intersections(steps, found.piece))
    left_out = distinct(found.layer[entangled])
    if len(left_out):  # no diagram can be made of them
        found = found.take(np.flatnonzero(~np.isin(found.layer, left_out)))
    if not len(found.layer):
        none, nowhere = np.zeros(0, np.int64), np.zeros((0, 2))
        feet_of_none = np.zeros((0, 2, 2))
        return MedialAxis(
            nowhere, np.zeros(0), none, none, feet_of_none, none, none, np.zeros(0, np.bool_), left_out
        )
    return _axis(found, reach, left_out, chord)


@dataclass(frozen=True, slots=True, eq=False)
class _Sides:
    """Sides of the outlines, one after each of the points (S,).

    Attributes:
        points: (S, 4, 2) mm: the point before, where the side begins, where it ends, the point after.
        index: (S, 2) of the points of the areas at which it begins and ends.
        layer: (S,) ascending.
        piece: (S,) ascending, of the connected areas.
    """

    points: Float
    index: Int
    layer: Int
    piece: Int

    def take(self, items: Int) -> _Sides:
        """Some of them."""
        return _Sides(
            self.points.take(items, axis=0),
            self.index.take(items, axis=0),
            self.layer[items],
            self.piece[items],
        )


def _sides(areas: Areas, sides: Bool | None) -> _Sides:
    """Those that take part."""
    after = areas.following
    index = np.stack([areas.previous, np.arange(len(after)), after, after[after]], axis=1)
    piece = split_connected(areas).of_ring[areas.point_ring]
    # Nothing outside of an area is nearer to what lies within than its own outline: each has a diagram of its own.
    taken = piece >= 0 if sides is None else sides & (piece >= 0)
    order = np.argsort(piece, kind="stable")
    order = order[taken[order]]
    layer, index, piece = areas.point_layer[order], index[order], piece[order]
    return _Sides(areas.xy.take(index.ravel(), axis=0).reshape(-1, 4, 2), index[:, 1:3], layer, piece)


@dataclass(frozen=True, slots=True, eq=False)
class _Halves:
    """Edges of the diagram, each followed by its twin, before they are divided.

    Attributes:
        vertex: (h, 2) where each begins and ends.
        ends: (h, 2, 2) mm, the same places.
        corner: (h,) whether the cell belongs to a corner.
        points: (h, 4, 2) mm of the cell's side or corner: before, begin, end, after; for a corner begin is end.
        source: (h,) index of the point at `begin`.
        layer: (h,).
    """

    vertex: Int
    ends: Float
    corner: Bool
    points: Float
    source: Int
    layer: Int

    def take(self, items: Int) -> _Halves:
        """Some of them."""
        return _Halves(
            self.vertex.take(items, axis=0),
            self.ends.take(items, axis=0),
            self.corner.take(items),
            self.points.take(items, axis=0),
            self.source.take(items),
            self.layer.take(items),
        )

    def feet(self, xy: Float, which: Int) -> Float:
        """(n, 2) the places of the own side or corner nearest to points (n, 2), for the halves with these numbers."""
        points = self.points.take(which, axis=0)
        return feet(xy, points[:, 1], points[:, 2])[0]


def follow_parts(following: Int, count: Int) -> Int:
    """(2 P,) what follows each way along the parts of pieces: the next part, or the first of what follows the piece.

    Args:
        following: (2 E,) the way that follows each way along a piece; -1 where none does.
        count: (E,) parts that each piece is divided into, P in all.
    """
    first, owner = np.cumsum(count) - count, np.repeat(np.arange(len(count)), count)
    last = (first + count - 1)[owner]
    entry = np.stack([2 * first, 2 * (first + count) - 1], axis=1).ravel()
    onward = np.where(following < 0, -1, entry[following])
    part = np.arange(len(owner))
    up = np.where(part == last, onward[2 * owner], 2 * part + 2)
    down = np.where(part == first[owner], onward[2 * owner + 1], 2 * part - 1)
    return np.stack([up, down], axis=1).ravel()


def _axis(sides: _Sides, reach: float, left_out: Int, chord: float) -> MedialAxis:
    """The medial axis of sides, none of which are on the layers left out."""
    diagram = diagram_of(sides.points[:, 1:3], sides.piece)
    places, edge = _bounded(diagram, sides.points, 2 * reach)
    chosen = np.flatnonzero(diagram.primary & (edge >= 0).all(axis=1))
    cell = diagram.cell[chosen]
    site, place = diagram.side[cell], diagram.place[cell]
    points = sides.points.take(site, axis=0)
    ends = place == 2
    points[ends, :2] = points[ends, 1:3]
    points[ends, 2] = points[ends, 1]
    points[place == 1, 2:] = points[place == 1, 1:3]
    vertex = edge.take(chosen, axis=0)
    halves = _Halves(
        vertex,
        places.take(vertex.ravel(), axis=0).reshape(-1, 2, 2),
        place <= 2,
        points,
        sides.index[site, ends.astype(np.int64)],
        sides.layer[site],
    )
    twin = np.arange(len(chosen)) ^ 1  # both of a pair are primary, or neither
    kept = _within(halves, twin)
    begin, end = halves.points[:, 1], halves.points[:, 2]
    near = [norm(place - feet(place, begin, end)[0]) <= reach for place in np.moveaxis(halves.ends, 1, 0)]
    kept &= near[0] | near[1]
    kept &= kept[twin]
    halves = halves.take(np.flatnonzero(kept))
    return _pieces(halves, _following(diagram, chosen[kept]), left_out, chord)


def _bounded(diagram: Diagram, points: Float, length: float) -> tuple[Float, Int]:
    """Vertices (V, 2) and both ends (E, 2) of edges; those that run far away end `length` mm after their beginning.

    Only edges between two corners do. They are there where the sides beyond take no part.
    """
    edge = np.stack([diagram.start, diagram.end], axis=1)
    if not np.isfinite(length):  # all sides take part: what runs far away lies outside
        return diagram.vertex, edge
    away = np.flatnonzero(diagram.primary & (diagram.start >= 0) & (diagram.end < 0))
    away = away[(diagram.place[diagram.cell[np.stack([away, away ^ 1])]] <= 2).all(axis=0)]
    cell = diagram.cell[np.stack([away, away ^ 1])]
    left, right = points[diagram.side[cell], diagram.place[cell]]  # 1: where a side begins, 2: where it ends
    across = left - right
    way = np.column_stack([across[:, 1], -across[:, 0]])
    way *= (length / np.maximum(norm(way), 1e-12))[:, None]
    edge[away, 1] = edge[away ^ 1, 0] = len(diagram.vertex) + np.arange(len(away))
    return np.concatenate([diagram.vertex, diagram.vertex[diagram.start[away]] + way]), edge


def _within(halves: _Halves, twin: Int) -> Bool:
    """(h,) whether edges lie inside the areas: to the left of the own side, or of a side of the corner."""
    middle = (halves.ends[:, 0] + halves.ends[:, 1]) / 2
    before, begin, end, after = np.moveaxis(halves.points, 1, 0)
    left = cross(end - begin, middle - begin) > 0
    around = (cross(begin - before, middle - before) > 0) | (cross(after - begin, middle - begin) > 0)
    inward = cross(begin - before, after - begin) < 0
    inside = np.where(halves.corner, around & inward, left)
    # Where one of both cells is that of a side, it knows for certain.
    both = np.where(halves.corner == halves.corner[twin], inside & inside[twin], inside[twin])
    return np.where(halves.corner, both, inside)


def _following(diagram: Diagram, chosen: Int) -> Int:
    """(h,) for the chosen edges the chosen one that goes on with the outline on the left; -1 where none is.

    Edges between a side and its own end are crossed: beyond them lies the cell of that end, and the way goes on there.
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


def _pieces(halves: _Halves, following: Int, left_out: Int, chord: float) -> MedialAxis:
    """Edges divided where they bend, or where beads beside them do that go around a corner."""
    used, number = compact_ids(halves.vertex, int(halves.vertex.max(initial=-1)) + 1)
    xy, layer = np.zeros((len(used), 2)), np.zeros(len(used), np.int64)
    xy[number], layer[number] = halves.ends, halves.layer[:, None]
    count, inner = _divided(halves, chord)
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
    foot = np.stack(
        [
            halves.feet(all_xy.take(start, axis=0), owner),
            halves.feet(all_xy.take(ends[:, ::-1].ravel(), axis=0), owner),
        ],
        axis=1,
    )
    radius = np.zeros(len(all_xy))
    radius[start] = norm(all_xy.take(start, axis=0) - foot[:, 0])
    # At the tip of a corner the way turns back, whatever else touches the outline there.
    onto_tip = np.flatnonzero(radius[ends[:, ::-1].ravel()] < _TIP)
    after[onto_tip] = onto_tip ^ 1
    return MedialAxis(
        all_xy,
        radius,
        np.concatenate([layer, halves.layer[of_new]]),
        start,
        foot,
        after,
        halves.source[owner],
        halves.corner[owner],
        left_out,
    )


def _divided(halves: _Halves, chord: float) -> tuple[Int, Float]:
    """(h / 2,) pieces that each edge is divided into, and the (n, 2) points between them.

    Between a corner and a side the edge is a parabola, between two corners it is straight, but the way around either
    corner is not: seen from the corner, points are at most `_STEP` apart where `chord` is `CHORD`.
    """
    most = _STEP * np.sqrt(chord / CHORD)
    up, down = halves.corner[::2], halves.corner[1::2]
    two = up & down
    focus = np.where(up[:, None], halves.points[::2, 1], halves.points[1::2, 1])
    other = np.where(up[:, None], halves.points[1::2, 1], halves.points[::2, 1])
    end_of_other = np.where(up[:, None], halves.points[1::2, 2], halves.points[::2, 2])
    along = end_of_other - other
    across = np.where(two[:, None], focus - other, np.stack([-along[:, 1], along[:, 0]], axis=1))
    across /= np.maximum(norm(across), 1e-12)[:, None]
    gap = dot(focus - other, across)[:, None]
    across *= np.sign(gap)
    gap = np.abs(gap[:, 0]) / np.where(two, 2, 1)
    tangent = np.stack([across[:, 1], -across[:, 0]], axis=1)
    u = dot(halves.ends[::2] - focus[:, None], tangent[:, None])
    curved = (up | down) & (gap > 1e-5)
    gap = np.where(curved, gap, 1.0)
    half = np.where(two, 1.0, 2.0)[:, None]
    angle = half * np.arctan(u / gap[:, None])
    steep = 2 * np.sqrt(8 * chord / gap) * np.cos(np.maximum(*np.abs(angle).T) / 2) ** 2
    widest = np.where(two, most, np.minimum(most, steep))
    wanted = np.ceil(np.abs(angle[:, 1] - angle[:, 0]) / widest - 1e-9)
    count = np.where(curved, np.clip(wanted, 1, _MOST), 1).astype(np.int64)
    edge, step = np.repeat(np.arange(len(count)), count - 1), 1 + consecutive(np.zeros_like(count), count - 1)
    turn = angle[edge, 0] + (angle[edge, 1] - angle[edge, 0]) * step / count[edge]
    place = gap[edge] * np.tan(turn / half[edge, 0])
    back = np.where(two[edge], gap[edge], gap[edge] - (place**2 + gap[edge] ** 2) / (2 * gap[edge]))
    return count, (
        focus.take(edge, axis=0)
        + place[:, None] * tangent.take(edge, axis=0)
        - back[:, None] * across.take(edge, axis=0)
    )
