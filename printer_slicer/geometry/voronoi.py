"""The medial axis of areas: the part of the Voronoi diagram of their outlines that lies inside.

The diagram comes from Boost.Polygon through pyvoronoi, on whole numbers of the grid that areas are rounded to, so no
point of an outline moves. All layers go into one diagram, each in a cell of its own on a square lattice; what the
outlines of two layers have between them lies outside of both and is left out.
"""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import chain
from operator import attrgetter

import numpy as np

from printer_slicer.geometry.areas import Areas, Bool, Float, Int, consecutive, frozen_array
from printer_slicer.geometry.polygons import STEPS_PER_MM

__all__ = ["MedialAxis", "medial_axis"]

_STEP = 0.2  # radians between neighbouring points around a corner: chords within 0.5 % of the radius
_WIDEST = 2.0e9  # steps of the grid that Boost's 32 bits hold
_APART = 1.5  # mm around each layer of a diagram, with room for what rounding moves it by
_CHORD = 0.005  # mm between a parabola and its pieces
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
    """

    xy: Float
    radius: Float
    layer: Int
    start: Int
    foot: Float
    following: Int
    source: Int
    corner: Bool

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
        ):
            object.__setattr__(self, name, frozen_array(getattr(self, name), dtype, shape))

    @property
    def end(self) -> Int:
        """(H,) point at which each half-piece ends."""
        return np.asarray(self.start.reshape(-1, 2)[:, ::-1].ravel())


def medial_axis(areas: Areas, reach: float, sides: Bool | None = None) -> MedialAxis:
    """The medial axis where the areas are at most twice `reach` wide, and a little beyond.

    Args:
        areas: clean areas.
        reach: mm; pieces that are farther from the outline at both ends are left out.
        sides: (N,) which sides of the outlines, named by the points at which they begin, take part; all if not given.
            Where a side that does not is nearest, the axis is not that of the areas.
    """
    parts = [_axis(some, reach) for some in _batches(areas, sides)]
    if not parts:
        none = np.zeros(0, np.int64)
        return MedialAxis(
            np.zeros((0, 2)), np.zeros(0), none, none, np.zeros((0, 2, 2)), none, none, np.zeros(0, np.bool_)
        )
    n_points = np.cumsum([0, *(len(part.xy) for part in parts)])
    n_halves = np.cumsum([0, *(len(part.start) for part in parts)])
    return MedialAxis(
        np.concatenate([part.xy for part in parts]),
        np.concatenate([part.radius for part in parts]),
        np.concatenate([part.layer for part in parts]),
        np.concatenate([part.start + n for part, n in zip(parts, n_points, strict=False)]),
        np.concatenate([part.foot for part in parts]),
        np.concatenate(
            [np.where(p.following < 0, -1, p.following + n) for p, n in zip(parts, n_halves, strict=False)]
        ),
        np.concatenate([part.source for part in parts]),
        np.concatenate([part.corner for part in parts]),
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Sides:
    """Sides of the outlines, one after each of the points (S,).

    Attributes:
        points: (S, 4, 2) mm: the point before, where the side begins, where it ends, the point after.
        index: (S, 2) of the points of the areas at which it begins and ends.
        layer: (S,).
        moved: (S, 2) whole mm to the place of the layer in the diagram.
    """

    points: Float
    index: Int
    layer: Int
    moved: Float


def _batches(areas: Areas, sides: Bool | None) -> Iterator[_Sides]:
    """The sides of as many layers at a time as fit on the lattice."""
    if not areas.n_rings or (sides is not None and not sides.any()):
        return
    layer = np.repeat(areas.ring_layer, np.diff(areas.ring_start))
    after = areas.following
    before = np.zeros_like(after)
    before[after] = np.arange(len(after))
    index = np.stack([before, np.arange(len(after)), after, after[after]], axis=1)
    if sides is not None:
        layer, index = layer[sides], index[sides]
    used, starts, rank = np.unique(layer, return_index=True, return_inverse=True)
    ends = areas.xy[index[:, 1:3]]
    low = np.minimum.reduceat(ends.min(axis=1), starts)
    high = np.maximum.reduceat(ends.max(axis=1), starts)
    pitch = 2 * float(np.ceil((high - low).max() / 2 + _APART))  # even, so that half of it is whole
    across = max(int(2 * _WIDEST / STEPS_PER_MM / pitch), 1)
    for first in range(0, len(used), across * across):
        side = int(np.ceil(np.sqrt(min(across * across, len(used) - first))))
        cell = np.column_stack(np.divmod(np.arange(len(used)) - first, side)) - (side - 1) / 2
        moved = np.rint(cell * pitch) - np.rint((low + high) / 2)
        here = (rank >= first) & (rank < first + across * across)
        yield _Sides(areas.xy[index[here]], index[here, 1:3], layer[here], moved[rank[here]])


@contextmanager
def _no_collection() -> Iterator[None]:
    """No search for garbage meanwhile: hundreds of thousands of new objects would set it off again and again."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


def _diagram(sides: _Sides) -> tuple[Float, Int, Int]:
    """Boost's vertices (n, 2) mm, edges (m, 5) and cells (k, 2)."""
    import pyvoronoi  # noqa: PLC0415 - only for parts with narrow places

    ends = sides.points[:, 1:3] + sides.moved[:, None]
    builder = pyvoronoi.Pyvoronoi(1)
    with _no_collection():
        for side in np.rint(ends * STEPS_PER_MM).astype(np.int64).tolist():
            builder.AddSegment(side)
        builder.Construct()
        edges = _columns(builder.GetEdges(), "start", "end", "cell", "twin", "is_primary")
        cells = _columns(builder.GetCells(), "site", "source_category")
        vertices = [(vertex.X, vertex.Y) for vertex in builder.GetVertices()]
    return np.array(vertices, np.float64).reshape(-1, 2) / STEPS_PER_MM, edges, cells


def _columns(objects: list[object], *names: str) -> Int:
    """(n, k) attributes of the library's objects."""
    flat = chain.from_iterable(map(attrgetter(*names), objects))
    return np.fromiter(flat, np.int64, len(objects) * len(names)).reshape(-1, len(names))


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
            self.vertex[items],
            self.ends[items],
            self.corner[items],
            self.points[items],
            self.source[items],
            self.layer[items],
        )

    def feet(self, xy: Float, which: Int) -> Float:
        """(n, 2) the places of the own side or corner nearest to points (n, 2), for the halves with these numbers."""
        a, b = self.points[which, 1], self.points[which, 2]
        along = b - a
        length = (along**2).sum(axis=1)
        place = ((xy - a) * along).sum(axis=1) / np.where(length > 0, length, 1.0)
        return np.asarray(a + np.clip(place, 0, 1)[:, None] * along)


def _axis(sides: _Sides, reach: float) -> MedialAxis:
    """The medial axis of one batch."""
    vertices, edges, cells = _diagram(sides)
    cell, twin, primary = edges[:, 2], edges[:, 3], edges[:, 4] == 1
    chosen = np.flatnonzero(primary & (edges[:, :2] >= 0).all(axis=1))
    site, category = cells[cell[chosen]].T  # 1: where a side begins, 2: where it ends, 3 and 4: the side
    points = sides.points[site].copy()
    ends = category == 2
    points[ends, :2] = points[ends, 1:3]
    points[ends, 2] = points[ends, 1]
    points[category == 1, 2:] = points[category == 1, 1:3]
    halves = _Halves(
        edges[chosen, :2],
        vertices[edges[chosen, :2]] - sides.moved[site][:, None],
        category <= 2,
        points,
        sides.index[site, ends.astype(np.int64)],
        sides.layer[site],
    )
    number = np.full(len(edges), -1)
    number[chosen] = np.arange(len(chosen))
    kept = _within(halves, number[twin[chosen]])
    n = np.arange(len(chosen))
    near = [np.hypot(*(halves.ends[:, k] - halves.feet(halves.ends[:, k], n)).T) <= reach for k in (0, 1)]
    kept &= near[0] | near[1]
    kept &= kept[number[twin[chosen]]]
    first = chosen[kept & (chosen < twin[chosen])]
    pairs = np.stack([first, twin[first]], axis=1).ravel()
    return _pieces(halves.take(number[pairs]), _following(edges, pairs))


def _within(halves: _Halves, twin: Int) -> Bool:
    """(h,) whether edges lie inside the areas: to the left of the own side, or of a side of the corner."""
    middle = halves.ends.mean(axis=1)
    before, begin, end, after = np.moveaxis(halves.points, 1, 0)
    left = _cross(end - begin, middle - begin) > 0
    around = (_cross(begin - before, middle - before) > 0) | (_cross(after - begin, middle - begin) > 0)
    inward = _cross(begin - before, after - begin) < 0
    inside = np.where(halves.corner, around & inward, left)
    # Where one of both cells is that of a side, it knows for certain.
    both = np.where(halves.corner == halves.corner[twin], inside & inside[twin], inside[twin])
    return np.where(halves.corner, both, inside)


def _cross(a: Float, b: Float) -> Float:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def _following(edges: Int, pairs: Int) -> Int:
    """(h,) for the chosen edges the chosen one that goes on with the outline on the left; -1 where none is.

    Within a cell the edge that begins where this one ends goes on. Edges between a side and its own end are crossed:
    beyond them lies the cell of that end, and the way goes on there.
    """
    begin, end, cell, twin, primary = edges.T
    n_vertices = int(edges[:, :2].max(initial=0)) + 2
    key = cell * n_vertices + begin
    order = np.argsort(key)
    key = key[order]
    number = np.full(len(edges), -1)
    number[pairs] = np.arange(len(pairs))
    result = np.full(len(pairs), -1)
    left, here = np.arange(len(pairs)), pairs
    while len(left):
        wanted = cell[here] * n_vertices + end[here]
        place = np.minimum(np.searchsorted(key, wanted), len(key) - 1)
        there = order[place]
        known = (key[place] == wanted) & (end[here] >= 0)
        through = known & (primary[there] == 0)
        result[left] = np.where(known & ~through, number[there], -1)
        left, here = left[through], twin[there[through]]
    return result


def _pieces(halves: _Halves, following: Int) -> MedialAxis:
    """Edges divided where they bend, or where beads beside them do that go around a corner."""
    used, number = np.unique(halves.vertex, return_inverse=True)
    number = number.reshape(-1, 2)
    xy, layer = np.zeros((len(used), 2)), np.zeros(len(used), np.int64)
    xy[number], layer[number] = halves.ends, halves.layer[:, None]
    count, inner = _divided(halves)
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
    after = _onward(following, count)
    owner = np.stack([2 * edge, 2 * edge + 1], axis=1).ravel()
    all_xy = np.concatenate([xy, inner])
    of_new = 2 * np.repeat(np.arange(len(count)), count - 1)
    start = ends.ravel()
    foot = np.stack(
        [halves.feet(all_xy[start], owner), halves.feet(all_xy[ends[:, ::-1].ravel()], owner)], axis=1
    )
    radius = np.zeros(len(all_xy))
    radius[start] = np.hypot(*(all_xy[start] - foot[:, 0]).T)
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
    )


def _onward(following: Int, count: Int) -> Int:
    """What follows each half-piece, for edges of `count` pieces: the next of the edge, or the first of another."""
    first = np.cumsum(count) - count
    edge, piece = np.repeat(np.arange(len(count)), count), np.arange(int(count.sum()))
    entry = np.stack([2 * first, 2 * (first + count) - 1], axis=1).ravel()
    onward = np.where(following < 0, -1, entry[following])
    up = np.where(piece == (first + count - 1)[edge], onward[2 * edge], 2 * piece + 2)
    down = np.where(piece == first[edge], onward[2 * edge + 1], 2 * piece - 1)
    return np.stack([up, down], axis=1).ravel()


def _divided(halves: _Halves) -> tuple[Int, Float]:
    """(h / 2,) pieces that each edge is divided into, and the (n, 2) points between them.

    Between a corner and a side the edge is a parabola, between two corners it is straight, but the way around either
    corner is not: seen from the corner, points are at most `_STEP` apart.
    """
    up, down = halves.corner[::2], halves.corner[1::2]
    two = up & down
    focus = np.where(up[:, None], halves.points[::2, 1], halves.points[1::2, 1])
    other = np.where(up[:, None], halves.points[1::2, 1], halves.points[::2, 1])
    end_of_other = np.where(up[:, None], halves.points[1::2, 2], halves.points[::2, 2])
    along = end_of_other - other
    across = np.where(two[:, None], focus - other, np.stack([-along[:, 1], along[:, 0]], axis=1))
    across /= np.maximum(np.hypot(*across.T), 1e-12)[:, None]
    gap = _dot(focus - other, across)[:, None]
    across *= np.sign(gap)
    gap = np.abs(gap[:, 0]) / np.where(two, 2, 1)
    tangent = np.stack([across[:, 1], -across[:, 0]], axis=1)
    u = _dot(halves.ends[::2] - focus[:, None], tangent[:, None])
    curved = (up | down) & (gap > 1e-5)
    gap = np.where(curved, gap, 1.0)
    half = np.where(two, 1.0, 2.0)[:, None]
    angle = half * np.arctan(u / gap[:, None])
    steep = 2 * np.sqrt(8 * _CHORD / gap) * np.cos(np.abs(angle).max(axis=1) / 2) ** 2
    widest = np.where(two, _STEP, np.minimum(_STEP, steep))
    wanted = np.ceil(np.abs(angle[:, 1] - angle[:, 0]) / widest - 1e-9)
    count = np.where(curved, np.clip(wanted, 1, _MOST), 1).astype(np.int64)
    edge, step = np.repeat(np.arange(len(count)), count - 1), 1 + consecutive(np.zeros_like(count), count - 1)
    turn = angle[edge, 0] + (angle[edge, 1] - angle[edge, 0]) * step / count[edge]
    place = gap[edge] * np.tan(turn / half[edge, 0])
    back = np.where(two[edge], gap[edge], gap[edge] - (place**2 + gap[edge] ** 2) / (2 * gap[edge]))
    return count, focus[edge] + place[:, None] * tangent[edge] - back[:, None] * across[edge]


def _dot(a: Float, b: Float) -> Float:
    return np.asarray((a * b).sum(axis=-1))
