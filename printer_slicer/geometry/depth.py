"""Depth of points inside the areas of their layers, near the outlines."""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, consecutive, distinct
from printer_slicer.geometry.areas import Areas
from printer_slicer.geometry.facet_topology import expand_counts
from printer_slicer.geometry.vectors import cross, dot, nearest_share

__all__ = ["depths", "mark_near_outlines"]

_AT_ONCE = 1 << 16  # points per batch, so that the comparisons stay in the processor's cache
_Edges = tuple[Float, Float, Int]
_CELL = 2.0  # cell size in reaches: few edges per cell, and few cells per edge
_TABLE, _ROW = 1 << 20, 521  # slots of the cell table, a power of two; and slots from row to row
# If two edges meet in the nearest point, prefer the one that the point sees less from its end: it decides the side.
_SIDEWAYS = 1e-9


def depths(areas: Areas, points: Float, layer: Int, reach: float) -> Float:
    """Return the depth (P,) of points inside the areas of their layer, mm; negative outside.

    A grid of cells finds the nearby outlines, so the cost grows with points plus outlines, not with their product.

    Args:
        areas: clean areas.
        points: (P, 2) mm.
        layer: (P,) layer of each point.
        reach: mm; points farther than this from all outlines of their layer get nan.
    """
    result = np.full(len(points), np.nan)
    for at in range(0, len(points), _AT_ONCE):
        some = slice(at, at + _AT_ONCE)
        _fill_depths(result[some], areas, points[some], layer[some], reach)
    return result


def _fill_depths(result: Float, areas: Areas, points: Float, layer: Int, reach: float) -> None:
    """Write the depths of a batch of points into `result` (P,)."""
    areas = areas.of_layers(layer)
    if not areas.n_rings:
        return
    begin, end, of_layer = _select_edges_near_points(
        _split_edges(areas, _CELL * reach), points, layer, _CELL * reach
    )
    if not len(begin):
        return
    owner, edge = _find_nearby_pairs(points, layer, (begin, end, of_layer), reach)
    if not len(owner):
        return
    # Column by column: fetching pairs of numbers is much slower than fetching single ones.
    along = (end - begin).take(edge, axis=0)
    gap = points.take(owner, axis=0) - begin.take(edge, axis=0)
    rest = gap - nearest_share(gap, along)[:, None] * along
    away, side = dot(rest, rest), cross(along, gap)
    rank = away - _SIDEWAYS * side**2 / dot(along, along)
    first = np.flatnonzero(np.diff(owner, prepend=-1))
    nearest = np.flatnonzero(
        rank == np.repeat(np.minimum.reduceat(rank, first), np.diff(first, append=len(rank)))
    )
    near = nearest[away[nearest] <= reach**2]
    result[owner[near]] = np.sqrt(away[near]) * np.where(side[near] >= 0, 1.0, -1.0)


def mark_near_outlines(areas: Areas, points: Float, layer: Int, reach: float) -> Bool:
    """Return a mask (P,): true for all points within `reach` of an outline of their layer, and for a few more."""
    parts = [np.zeros(0, np.bool_)]
    for at in range(0, len(points), _AT_ONCE):
        some = slice(at, at + _AT_ONCE)
        parts.append(_mark_batch_near_outlines(areas, points[some], layer[some], reach))
    return np.concatenate(parts)


def _mark_batch_near_outlines(areas: Areas, points: Float, layer: Int, reach: float) -> Bool:
    """Return the mask (P,) of `mark_near_outlines` for one batch of points."""
    areas = areas.of_layers(layer)
    if not areas.n_rings:
        return np.zeros(len(points), np.bool_)
    _, key, own = _find_cells(points, layer, _split_edges(areas, _CELL * reach), reach)
    key = distinct(key)
    return np.asarray(key.take(np.minimum(np.searchsorted(key, own), len(key) - 1)) == own)


def _split_edges(areas: Areas, longest: float) -> _Edges:
    """Split the edges into pieces of at most `longest` mm; return both ends (E, 2) and the layer (E,)."""
    along = areas.xy.take(areas.following, axis=0) - areas.xy
    count = np.maximum(np.ceil(np.hypot(*along.T) / longest), 1).astype(np.int64)
    owner, step = expand_counts(count)
    piece = along.take(owner, axis=0) / count.take(owner)[:, None]
    begin = areas.xy.take(owner, axis=0) + piece * step[:, None]
    layer = areas.point_layer.take(owner)
    long = np.flatnonzero((piece[:, 0] != 0) | (piece[:, 1] != 0))
    return begin.take(long, axis=0), (begin + piece).take(long, axis=0), layer.take(long)


def _select_edges_near_points(edges: _Edges, points: Float, layer: Int, size: float) -> _Edges:
    """Keep the edges that may lie within half of `size` of a point; most outlines have no point near them.

    An edge is at most `size` long, so its middle lies in the cell of such a point or in a neighbouring one. Several
    cells share a slot of the table, so some edges are kept without need.
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


def _find_cells(points: Float, layer: Int, edges: _Edges, reach: float) -> tuple[Int, Int, Int]:
    """Return pairs of an edge (n,) and a cell (n,) within reach of it, and the cell (P,) of each point."""
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


def _find_nearby_pairs(points: Float, layer: Int, edges: _Edges, reach: float) -> tuple[Int, Int]:
    """Return all pairs of a point and an edge that may be within reach of each other, by ascending point."""
    edge, key, own = _find_cells(points, layer, edges, reach)
    order = np.argsort(key, kind="stable")
    key, edge = key.take(order), edge.take(order)
    # Consecutive points lie along lines, so they mostly share a cell.
    new = np.flatnonzero(np.diff(own, prepend=own[0] - 1))
    again, sought = np.diff(new, append=len(own)), own.take(new)
    first = np.searchsorted(key, sought)
    count = np.repeat(np.searchsorted(key, sought, side="right") - first, again)
    owner = np.repeat(np.arange(len(points)), count)
    return owner, edge.take(consecutive(np.repeat(first, again), count))
