"""The parts of polylines that lie within the areas of a whole stack, exact about what crosses what."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, consecutive, distinct, run_starts
from printer_slicer.geometry.areas import Areas
from printer_slicer.geometry.polygons import STEPS_PER_MM
from printer_slicer.geometry.polylines import Polylines
from printer_slicer.geometry.vectors import cross

__all__ = ["clip_lines", "clipped", "spans"]

_PAD = 1e-4  # mm; more than the rounding of places within a cell
_SMALLEST_CELL, _LARGEST_CELL = 0.2, 20.0  # mm
_SAME_PLACE = 0.5  # steps of the grid
_NOTHING = 2e-5  # mm; pieces shorter than the steps of the grid


def clip_lines(areas: Areas, lines: Polylines) -> Polylines:
    """Clip open lines to the areas; the parts are ordered by layer and line.

    Both are rounded to the grid of the areas, 0.01 µm, and then everything about which segment crosses which edge is
    decided in whole numbers, as if all lines were moved aside by less than any number: so no case is special, and each
    crossing either enters or leaves. Segments and edges that might cross are found by a common lattice of cells.

    Args:
        areas: clean areas.
        lines: open, nothing need be known about where they begin or end.

    Returns:
        The parts, with the edges of `areas` that they begin and end on; `clipped` tells which line each is a part of.

    Source of the rule for points on lines: Edelsbrunner & Mücke, Simulation of Simplicity, 1990.
    """
    return clipped(areas, lines)[0]


def clipped(areas: Areas, lines: Polylines) -> tuple[Polylines, Int]:
    """The parts as `clip_lines` gives them, and (P,) the line that each is a part of."""
    if not lines.n_lines or not areas.n_rings:
        nothing = np.zeros(0, np.int64)
        return lines.take(nothing), nothing
    return _assembled(lines, *_cuts(areas, lines))


def spans(areas: Areas, lines: Polylines) -> tuple[Int, Float, Float]:
    """The same parts by where they lie along their lines.

    Returns:
        (P,) the line of each part, ascending, and how far along it the part begins and ends, mm.
    """
    if not lines.n_lines or not areas.n_rings:
        return np.zeros(0, np.int64), np.zeros(0), np.zeros(0)
    begin, end = _cuts(areas, lines)
    reached = np.append(0.0, np.cumsum(np.hypot(*np.diff(lines.xy, axis=0).T)))
    first = reached[lines.start[begin.line]]
    low, high = (reached[cut.at] + np.hypot(*(cut.xy - lines.xy[cut.at]).T) - first for cut in (begin, end))
    kept = np.flatnonzero(high - low > _NOTHING)
    return begin.line[kept], low[kept], high[kept]


def _cuts(areas: Areas, lines: Polylines) -> tuple[_Cuts, _Cuts]:
    """Where the parts within the areas begin and end."""
    points, outline = (np.rint(xy * STEPS_PER_MM).astype(np.int64) for xy in (lines.xy, areas.xy))
    owner = np.repeat(np.arange(lines.n_lines), lines.size)
    segment = np.flatnonzero(np.append(np.diff(owner) == 0, False))
    segment = segment[(points[segment + 1] != points[segment]).any(axis=1)]
    of_segment, of_edge = _near(
        _Segments(points[segment], points[segment + 1], lines.layer[owner[segment]]),
        _Segments(outline, outline[areas.following], areas.point_layer),
    )
    at, edge, share, enters = _crossings(points, segment[of_segment], outline, areas.following, of_edge)
    return _begins_and_ends(areas, lines, owner, (at, edge, share, enters))


@dataclass(frozen=True, slots=True, eq=False)
class _Segments:
    """From `a` to `b`, (n, 2) steps of the grid, on a layer (n,)."""

    a: Int
    b: Int
    layer: Int


def _near(segments: _Segments, edges: _Segments) -> tuple[Int, Int]:
    """Pairs of a segment and an edge that meet a common cell of their layer; a pair may be found twice."""
    a, b, layer = segments.a, segments.b, segments.layer
    size = np.abs(b - a).max(axis=1)
    usual = float(size.mean()) / STEPS_PER_MM if len(a) else 1.0
    cell = min(max(3 * usual, _SMALLEST_CELL), _LARGEST_CELL) * STEPS_PER_MM
    other, other_row, other_column = _cells(edges.a, edges.b, cell)
    low_row, low_column = other_row.min() - 1, other_column.min() - 1
    n_rows, n_columns = other_row.max() - low_row + 2, other_column.max() - low_column + 2

    def keys(layer: Int, row: Int, column: Int) -> Int:
        """(n,) a number for each cell in which an edge may lie; -1 for all others."""
        key = (layer * n_rows + row - low_row) * n_columns + column - low_column
        within = (row >= low_row) & (row < low_row + n_rows)
        within &= (column >= low_column) & (column < low_column + n_columns)
        return np.asarray(np.where(within, key, -1))

    other_key = keys(edges.layer[other], other_row, other_column)
    # Most segments have no edge near: none in the nine cells around their begin, and they reach no farther.
    taken = distinct(other_key)
    taken = distinct((taken[:, None] + np.array([-1, 0, 1])).ravel())
    taken = distinct((taken[:, None] + np.array([-n_columns, 0, n_columns])).ravel())
    at = np.floor(a / cell).astype(np.int64)
    begin = keys(layer, at[:, 1], at[:, 0])
    found = taken[np.minimum(np.searchsorted(taken, begin), len(taken) - 1)] == begin
    near = np.flatnonzero(found | (size + 2 * _PAD * STEPS_PER_MM > cell))

    item, row, column = _cells(a[near], b[near], cell)
    item = near[item]
    key = keys(layer[item], row, column)
    order = np.argsort(other_key, kind="stable")
    sorted_key = other_key[order]
    first = np.searchsorted(sorted_key, key)
    count = np.searchsorted(sorted_key, key, side="right") - first
    return np.repeat(item, count), other[order[consecutive(first, count)]]


def _cells(a: Int, b: Int, cell: float) -> tuple[Int, Int, Int]:
    """Item, row and column of every cell that each segment (n, 2) to (n, 2) passes through."""
    pad = _PAD * STEPS_PER_MM
    (ax, ay), (bx, by) = a.T.astype(np.float64), b.T.astype(np.float64)
    low = np.floor((np.minimum(ay, by) - pad) / cell).astype(np.int64)
    count = np.floor((np.maximum(ay, by) + pad) / cell).astype(np.int64) - low + 1
    item, row = np.repeat(np.arange(len(a)), count), consecutive(low, count)
    x, y, run, rise = ax[item], ay[item], (bx - ax)[item], (by - ay)[item]
    slope = np.divide(1.0, rise, out=np.zeros_like(rise), where=rise != 0)
    lower = np.clip((row * cell - pad - y) * slope, 0, 1)
    upper = np.clip(((row + 1) * cell + pad - y) * slope, 0, 1)
    upper[rise == 0] = 1.0
    one, another = x + lower * run, x + upper * run
    left = np.floor((np.minimum(one, another) - pad) / cell).astype(np.int64)
    wide = np.floor((np.maximum(one, another) + pad) / cell).astype(np.int64) - left + 1
    return np.repeat(item, wide), np.repeat(row, wide), consecutive(left, wide)


def _crossings(
    points: Int, segment: Int, outline: Int, following: Int, edge: Int
) -> tuple[Int, Int, Float, Bool]:
    """Of the pairs of segment and edge those that cross: both, how far along the segment, whether it enters.

    Sorted along the lines.
    """
    p, q, a, b = points[segment], points[segment + 1], outline[edge], outline[following[edge]]
    way, side = q - p, b - a
    beside_a, beside_b = cross(way, a - p), cross(way, b - p)
    before, after = cross(side, p - a), cross(side, q - a)
    aside_way, aside_side = _aside(way), _aside(side)
    left_a, left_b = (np.where(value == 0, ~aside_way, value > 0) for value in (beside_a, beside_b))
    left_p, left_q = (np.where(value == 0, aside_side, value > 0) for value in (before, after))
    crossing = np.flatnonzero((left_a != left_b) & (left_p != left_q))
    found, first = np.unique(segment[crossing] * len(outline) + edge[crossing], return_index=True)
    chosen = crossing[first]
    at, on = np.divmod(found, len(outline))
    share = np.clip(before[chosen] / (before[chosen] - after[chosen]).astype(np.float64), 0, 1)
    enters = left_q[chosen]  # solid lies to the left of every edge
    length = np.hypot(*way[chosen].T.astype(np.float64))
    order = np.lexsort((share, at))
    apart = np.diff(share[order] * length[order], prepend=-np.inf) > _SAME_PLACE
    place = np.cumsum(apart | run_starts(at[order]))
    order = order[_left_over(place, enters[order])]
    return at[order], on[order], share[order], enters[order]


def _left_over(place: Int, enters: Bool) -> Int:
    """The crossings (C,), sorted along the lines, without those that undo each other at one place (C,).

    Which of them comes first is rounding, and so would be whether the line was inside before.
    """
    if not len(place):
        return np.zeros(0, np.int64)
    first = np.flatnonzero(run_starts(place))
    entering = np.add.reduceat(enters, first, dtype=np.int64)
    leaving = np.diff(np.append(first, len(place))) - entering
    of = np.repeat(np.arange(len(first)), entering + leaving)
    ins = np.cumsum(enters, dtype=np.int64)
    outs = np.arange(1, len(place) + 1) - ins
    # The how many-th of its kind at its place.
    nth = np.where(enters, ins - (ins[first] - enters[first])[of], outs - (outs[first] - ~enters[first])[of])
    more = np.where(enters, (entering - leaving)[of], (leaving - entering)[of])
    return np.asarray(np.flatnonzero(nth <= more))


def _aside(way: Int) -> Bool:
    """(n,) whether a point moved by a little in x, and by much less in y, comes to lie to the left of the way."""
    return np.asarray(np.where(way[:, 1] == 0, way[:, 0] > 0, way[:, 1] < 0))


def _begins_and_ends(
    areas: Areas, lines: Polylines, owner: Int, crossings: tuple[Int, Int, Float, Bool]
) -> tuple[_Cuts, _Cuts]:
    """The lines cut at their crossings (point before, edge, share, enters), sorted along the lines."""
    at, edge, share, enters = crossings
    line = owner[at]
    depth, before = _depths(areas, lines, line, np.where(enters, 1, -1))
    begins, ends = enters & (depth == 1), ~enters & (depth == 0)
    inside_first = np.flatnonzero(before > 0)
    after = before.copy()
    after[line] = depth  # the last of each line stands
    inside_last = np.flatnonzero(after > 0)

    where = lines.xy[at] + share[:, None] * (lines.xy[np.minimum(at + 1, len(lines.xy) - 1)] - lines.xy[at])
    first, last = lines.start[:-1], lines.start[1:] - 1
    begin = _sorted(
        # A line that begins inside does so before it crosses anything.
        (inside_first, first[inside_first], lines.xy[first[inside_first]], None),
        (line[begins], at[begins], where[begins], edge[begins]),
    )
    end = _sorted(
        (line[ends], at[ends], where[ends], edge[ends]),
        # The last point is the end itself: only the points up to the one before it lie between.
        (inside_last, last[inside_last] - 1, lines.xy[last[inside_last]], None),
    )
    return begin, end


@dataclass(frozen=True, slots=True, eq=False)
class _Cuts:
    """Where pieces begin, or where they end: line, the point of the line before, place, edge."""

    line: Int
    at: Int
    xy: Float
    edge: Int


def _sorted(*parts: tuple[Int, Int, Float, Int | None]) -> _Cuts:
    """By line, and along it; in the order of the parts where they are on the same segment."""
    line, at = (np.concatenate([part[i] for part in parts]) for i in (0, 1))
    xy = np.concatenate([part[2] for part in parts])
    edge = np.concatenate([np.full(len(part[0]), -1) if part[3] is None else part[3] for part in parts])
    order = np.lexsort((at, line))
    return _Cuts(line[order], at[order], xy[order], edge[order])


def _assembled(lines: Polylines, begin: _Cuts, end: _Cuts) -> tuple[Polylines, Int]:
    """One line from each begin to the end of the same place in their order, and the line it is a part of."""
    inner = np.maximum(end.at - begin.at, 0)
    size = inner + 2
    xy = np.zeros((int(size.sum()), 2))
    start = np.cumsum(size) - size
    xy[start], xy[start + size - 1] = begin.xy, end.xy
    between = consecutive(start + 1, inner)
    xy[between] = lines.xy[consecutive(begin.at + 1, inner)]
    # A corner that lies on the outline is a crossing too, which is the one that stays.
    near = np.hypot(*np.diff(xy, axis=0).T) < _NOTHING
    keep = np.ones(len(xy), np.bool_)
    keep[between] = ~near[between - 1]
    before_end = (start + size - 2)[inner > 0]
    keep[before_end] &= ~near[before_end]
    owner = np.repeat(np.arange(len(size)), size)
    size = np.bincount(owner[keep], minlength=len(size))
    edges = np.stack([begin.edge, end.edge], axis=1)
    made = Polylines.of(xy[keep], size, lines.layer[begin.line], edges)
    kept = np.flatnonzero(made.length() > _NOTHING)
    return made.take(kept), begin.line[kept]


def _depths(areas: Areas, lines: Polylines, line: Int, change: Int) -> tuple[Int, Int]:
    """(C,) in how many areas a line lies after each of its crossings, and (M,) in how many each begins."""
    total = np.cumsum(change)
    first = np.flatnonzero(run_starts(line))
    counts = np.diff(np.append(first, len(line)))
    own = total - np.repeat(total[first] - change[first], counts) if len(line) else total
    before = np.zeros(lines.n_lines, np.int64)
    if len(line):
        before[line[first]] = np.maximum(-np.minimum.reduceat(own, first), 0)
    untouched = np.ones(lines.n_lines, np.bool_)
    untouched[line] = False
    before[untouched] = _begins_inside(areas, lines, np.flatnonzero(untouched))
    return own + before[line], before


def _begins_inside(areas: Areas, lines: Polylines, which: Int) -> Bool:
    """(n,) whether the first point of some of the lines lies in the areas."""
    point, layer = lines.xy[lines.start[which]], lines.layer[which]
    low, high = areas.boxes()
    inside = np.zeros(len(which), np.bool_)
    near = np.flatnonzero(((point >= low[layer]) & (point <= high[layer])).all(axis=1))
    if len(near):
        from printer_slicer.geometry.segment_index import OutlineIndex  # noqa: PLC0415 - only few lines need a search tree

        known = areas.of_layers(layer[near])
        outlines = OutlineIndex(known, point[near].min(axis=0), point[near].max(axis=0))
        inside[near] = outlines.inside(point[near], layer[near])
    return inside
