"""How deep points lie inside the areas of their layers, near the outlines."""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, consecutive, distinct
from printer_slicer.geometry.areas import Areas
from printer_slicer.geometry.facet_topology import spread
from printer_slicer.geometry.vectors import cross, dot, nearest_share

__all__ = ["depths", "near_outlines"]

_AT_ONCE = 1 << 16  # points: what is compared stays near the processor's caches
_Edges = tuple[Float, Float, Int]
_CELL = 2.0  # reaches: large enough that few outlines lie in many cells, small enough that few lie in one
_TABLE, _ROW = 1 << 20, 521  # places of cells, a power of two; and how far a row is from the next
_SIDEWAYS = (
    1e-9  # of two edges that meet in the nearest point, the one that is seen less from its end tells the side
)


def depths(areas: Areas, points: Float, layer: Int, reach: float) -> Float:
    """(P,) how far inside the areas of its layer each point lies, mm; negative outside.

    Outlines are looked up in a lattice of cells, so the cost grows with points and outlines, not with their product.

    Args:
        areas: clean areas.
        points: (P, 2) mm.
        layer: (P,) of each point.
        reach: mm; points farther from all outlines of their layer get nan.
    """
    result = np.full(len(points), np.nan)
    for at in range(0, len(points), _AT_ONCE):
        some = slice(at, at + _AT_ONCE)
        _note_depths(result[some], areas, points[some], layer[some], reach)
    return result


def _note_depths(result: Float, areas: Areas, points: Float, layer: Int, reach: float) -> None:
    """Depths of some of the points, filled into `result` (P,)."""
    areas = areas.of_layers(layer)
    if not areas.n_rings:
        return
    begin, end, of_layer = _asked_for(_short_edges(areas, _CELL * reach), points, layer, _CELL * reach)
    if not len(begin):
        return
    owner, edge = _pairs(points, layer, (begin, end, of_layer), reach)
    if not len(owner):
        return
    # Column by column: pairs of numbers are fetched much more slowly than single ones.
    way = (end - begin).take(edge, axis=0)
    gap = points.take(owner, axis=0) - begin.take(edge, axis=0)
    rest = gap - nearest_share(gap, way)[:, None] * way
    away, side = dot(rest, rest), cross(way, gap)
    rank = away - _SIDEWAYS * side**2 / dot(way, way)
    first = np.flatnonzero(np.diff(owner, prepend=-1))
    nearest = np.flatnonzero(
        rank == np.repeat(np.minimum.reduceat(rank, first), np.diff(first, append=len(rank)))
    )
    near = nearest[away[nearest] <= reach**2]
    result[owner[near]] = np.sqrt(away[near]) * np.where(side[near] >= 0, 1.0, -1.0)


def near_outlines(areas: Areas, points: Float, layer: Int, reach: float) -> Bool:
    """(P,) whether points (P, 2) lie in cells beside outlines of their layer; others are not within `reach` of any."""
    parts = [np.zeros(0, np.bool_)]
    for at in range(0, len(points), _AT_ONCE):
        some = slice(at, at + _AT_ONCE)
        parts.append(_beside(areas, points[some], layer[some], reach))
    return np.concatenate(parts)


def _beside(areas: Areas, points: Float, layer: Int, reach: float) -> Bool:
    """The same for some of the points."""
    areas = areas.of_layers(layer)
    if not areas.n_rings:
        return np.zeros(len(points), np.bool_)
    _, key, own = _cells(points, layer, _short_edges(areas, _CELL * reach), reach)
    key = distinct(key)
    return np.asarray(key.take(np.minimum(np.searchsorted(key, own), len(key) - 1)) == own)


def _short_edges(areas: Areas, longest: float) -> _Edges:
    """Both ends (E, 2) and the layer (E,) of the edges, cut into pieces that are not longer."""
    along = areas.xy.take(areas.following, axis=0) - areas.xy
    count = np.maximum(np.ceil(np.hypot(*along.T) / longest), 1).astype(np.int64)
    owner, step = spread(count)
    piece = along.take(owner, axis=0) / count.take(owner)[:, None]
    begin = areas.xy.take(owner, axis=0) + piece * step[:, None]
    layer = areas.point_layer.take(owner)
    long = np.flatnonzero((piece[:, 0] != 0) | (piece[:, 1] != 0))
    return begin.take(long, axis=0), (begin + piece).take(long, axis=0), layer.take(long)


def _asked_for(edges: _Edges, points: Float, layer: Int, size: float) -> _Edges:
    """The edges that may lie within half of `size` of a point: most outlines have none beside them.

    An edge is no longer than `size`, so its middle lies in the cell of such a point or in one beside it. Cells share
    the places of a table, so that some edges are kept for nothing.
    """
    begin, end, of_layer = edges
    cell = np.floor(points / size).astype(np.int64)
    key = (layer * _ROW + cell[:, 0]) * _ROW + cell[:, 1]
    key = key.compress(np.diff(key, prepend=key[0] - 1) != 0)
    asked = np.zeros(_TABLE, np.bool_)
    for x in (-_ROW, 0, _ROW):
        for y in (-1, 0, 1):
            asked[(key + (x + y)) & (_TABLE - 1)] = True
    cell = np.floor((begin + end) / (2 * size)).astype(np.int64)
    key = (of_layer * _ROW + cell[:, 0]) * _ROW + cell[:, 1]
    some = np.flatnonzero(asked.take(key & (_TABLE - 1)))
    return begin.take(some, axis=0), end.take(some, axis=0), of_layer.take(some)


def _cells(points: Float, layer: Int, edges: _Edges, reach: float) -> tuple[Int, Int, Int]:
    """Edges (n,) with the cell (n,) of everything within reach of them, and the cell of each point (P,)."""
    begin, end, of_layer = edges
    size = _CELL * reach
    low = np.floor((np.minimum(begin, end) - reach) / size).astype(np.int64)
    high = np.floor((np.maximum(begin, end) + reach) / size).astype(np.int64)
    cell = np.floor(points / size).astype(np.int64)
    origin = np.minimum(low.min(axis=0), cell.min(axis=0))
    wide = np.maximum(high.max(axis=0), cell.max(axis=0)) - origin + 1
    columns = high[:, 0] - low[:, 0] + 1
    edge, x = np.repeat(np.arange(len(begin)), columns), consecutive(low[:, 0], columns)
    rows = (high[:, 1] - low[:, 1] + 1).take(edge)
    x, y = np.repeat(x, rows), consecutive(low[:, 1].take(edge), rows)
    edge = np.repeat(edge, rows)
    key = (of_layer.take(edge) * wide[0] + x - origin[0]) * wide[1] + y - origin[1]
    return edge, key, (layer * wide[0] + cell[:, 0] - origin[0]) * wide[1] + cell[:, 1] - origin[1]


def _pairs(points: Float, layer: Int, edges: _Edges, reach: float) -> tuple[Int, Int]:
    """Point and edge of all pairs that may be within reach of each other, by ascending point."""
    edge, key, own = _cells(points, layer, edges, reach)
    order = np.argsort(key, kind="stable")
    key, edge = key.take(order), edge.take(order)
    # Points come along lines: neighbours mostly share their cell.
    new = np.flatnonzero(np.diff(own, prepend=own[0] - 1))
    again, sought = np.diff(new, append=len(own)), own.take(new)
    first = np.searchsorted(key, sought)
    count = np.repeat(np.searchsorted(key, sought, side="right") - first, again)
    owner = np.repeat(np.arange(len(points)), count)
    return owner, edge.take(consecutive(np.repeat(first, again), count))
