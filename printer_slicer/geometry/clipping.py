"""Clip polylines to the areas of a whole stack, with exact decisions on which segments cross which edges."""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, consecutive, distinct, run_starts
from printer_slicer.geometry.areas import Areas
from printer_slicer.geometry.polygons import STEPS_PER_MM
from printer_slicer.geometry.polylines import Polylines
from printer_slicer.geometry.vectors import cross
from printer_slicer.values import Struct

__all__ = ["clip_lines", "clip_to_spans", "clip_with_sources"]

_PAD = 1e-4  # mm; more than the rounding of positions within a cell
_SMALLEST_CELL, _LARGEST_CELL = 0.2, 20.0  # mm
_SAME_PLACE = 0.5  # grid steps
_SHORTEST = 2e-5  # mm; parts up to two grid steps are dropped


def clip_lines(areas: Areas, lines: Polylines) -> Polylines:
    """Clip open lines to the areas; the parts are ordered by layer and line.

    Lines and areas are rounded to the grid of 0.01 µm, and crossings are decided in integers, as if all lines were
    shifted by an infinitesimal amount. So there are no special cases, and each crossing either enters or leaves. A
    common grid of cells finds the segments and edges that may cross.

    Args:
        areas: clean areas.
        lines: open lines; their ends may lie anywhere.

    Returns:
        The parts, with the edges of `areas` on which they start and end. `clip_with_sources` also returns the source
        line of each.

    Source for points on lines: Edelsbrunner & Mücke, Simulation of Simplicity, 1990.
    """
    return clip_with_sources(areas, lines)[0]


def clip_with_sources(areas: Areas, lines: Polylines) -> tuple[Polylines, Int]:
    """Clip lines as `clip_lines` does, and also return the index (P,) of the source line of each part."""
    if not lines.n_lines or not areas.n_rings:
        nothing = np.zeros(0, np.int64)
        return lines.take(nothing), nothing
    return _build_parts(lines, *_find_cuts(areas, lines))


def clip_to_spans(areas: Areas, lines: Polylines) -> tuple[Int, Float, Float]:
    """Clip lines to the areas and return the parts as intervals along the lines.

    Returns:
        The line of each part (P,), ascending, and the positions (P,) along it where the part starts and ends, mm.
    """
    if not lines.n_lines or not areas.n_rings:
        return np.zeros(0, np.int64), np.zeros(0), np.zeros(0)
    begin, end = _find_cuts(areas, lines)
    reached = np.append(0.0, np.cumsum(np.hypot(*np.diff(lines.xy, axis=0).T)))
    first = reached[lines.start[begin.line]]
    low, high = (reached[cut.at] + np.hypot(*(cut.xy - lines.xy[cut.at]).T) - first for cut in (begin, end))
    kept = np.flatnonzero(high - low > _SHORTEST)
    return begin.line[kept], low[kept], high[kept]


def _find_cuts(areas: Areas, lines: Polylines) -> tuple[_Cuts, _Cuts]:
    """Find where the parts of lines within the areas start and end."""
    points, outline = (np.rint(xy * STEPS_PER_MM).astype(np.int64) for xy in (lines.xy, areas.xy))
    owner = np.repeat(np.arange(lines.n_lines), lines.size)
    segment = np.flatnonzero(np.append(np.diff(owner) == 0, False))
    segment = segment[(points[segment + 1] != points[segment]).any(axis=1)]
    of_segment, of_edge = _find_nearby_pairs(
        _Segments(points[segment], points[segment + 1], lines.layer[owner[segment]]),
        _Segments(outline, outline[areas.following], areas.point_layer),
    )
    at, edge, share, enters = _find_crossings(points, segment[of_segment], outline, areas.following, of_edge)
    return _find_starts_and_ends(areas, lines, owner, (at, edge, share, enters))


class _Segments(Struct, frozen=True, eq=False):
    """Segments from `a` to `b` (n, 2), in grid steps, on a layer (n,)."""

    a: Int
    b: Int
    layer: Int


def _find_nearby_pairs(segments: _Segments, edges: _Segments) -> tuple[Int, Int]:
    """Return pairs of a segment and an edge that share a cell of their layer; a pair may occur twice."""
    a, b, layer = segments.a, segments.b, segments.layer
    size = np.abs(b - a).max(axis=1)
    usual = float(size.mean()) / STEPS_PER_MM if len(a) else 1.0
    cell = min(max(3 * usual, _SMALLEST_CELL), _LARGEST_CELL) * STEPS_PER_MM
    other, other_row, other_column = _find_cells(edges.a, edges.b, cell)
    low_row, low_column = other_row.min() - 1, other_column.min() - 1
    n_rows, n_columns = other_row.max() - low_row + 2, other_column.max() - low_column + 2

    def number_cells(layer: Int, row: Int, column: Int) -> Int:
        """Return the number (n,) of each cell in which an edge may lie; -1 for cells without edges."""
        key = (layer * n_rows + row - low_row) * n_columns + column - low_column
        within = (row >= low_row) & (row < low_row + n_rows)
        within &= (column >= low_column) & (column < low_column + n_columns)
        return np.asarray(np.where(within, key, -1))

    other_key = number_cells(edges.layer[other], other_row, other_column)
    # Skip short segments with no edge in the nine cells around their start, which are most of them.
    occupied = distinct(other_key)
    occupied = distinct((occupied[:, None] + np.array([-1, 0, 1])).ravel())
    occupied = distinct((occupied[:, None] + np.array([-n_columns, 0, n_columns])).ravel())
    at = np.floor(a / cell).astype(np.int64)
    begin = number_cells(layer, at[:, 1], at[:, 0])
    found = occupied[np.minimum(np.searchsorted(occupied, begin), len(occupied) - 1)] == begin
    near = np.flatnonzero(found | (size + 2 * _PAD * STEPS_PER_MM > cell))

    item, row, column = _find_cells(a[near], b[near], cell)
    item = near[item]
    key = number_cells(layer[item], row, column)
    order = np.argsort(other_key, kind="stable")
    sorted_key = other_key[order]
    first = np.searchsorted(sorted_key, key)
    count = np.searchsorted(sorted_key, key, side="right") - first
    return np.repeat(item, count), other[order[consecutive(first, count)]]


def _find_cells(a: Int, b: Int, cell: float) -> tuple[Int, Int, Int]:
    """Return the segment, row and column of every cell that the segments from `a` to `b` (n, 2) pass through."""
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


def _find_crossings(
    points: Int, segment: Int, outline: Int, following: Int, edge: Int
) -> tuple[Int, Int, Float, Bool]:
    """Find the pairs of a segment and an edge that cross.

    Returns:
        The segment, the edge, the position along the segment from 0 to 1, and whether it enters the area, each (C,),
        sorted along the lines.
    """
    p, q, a, b = points[segment], points[segment + 1], outline[edge], outline[following[edge]]
    step, side = q - p, b - a
    beside_a, beside_b = cross(step, a - p), cross(step, b - p)
    before, after = cross(side, p - a), cross(side, q - a)
    aside_step, aside_side = _is_shifted_left(step), _is_shifted_left(side)
    left_a, left_b = (np.where(value == 0, ~aside_step, value > 0) for value in (beside_a, beside_b))
    left_p, left_q = (np.where(value == 0, aside_side, value > 0) for value in (before, after))
    crossing = np.flatnonzero((left_a != left_b) & (left_p != left_q))
    found, first = np.unique(segment[crossing] * len(outline) + edge[crossing], return_index=True)
    chosen = crossing[first]
    at, on = np.divmod(found, len(outline))
    share = np.clip(before[chosen] / (before[chosen] - after[chosen]).astype(np.float64), 0, 1)
    enters = left_q[chosen]  # solid lies to the left of every edge
    length = np.hypot(*step[chosen].T.astype(np.float64))
    order = np.lexsort((share, at))
    apart = np.diff(share[order] * length[order], prepend=-np.inf) > _SAME_PLACE
    place = np.cumsum(apart | run_starts(at[order]))
    order = order[_drop_cancelling_crossings(place, enters[order])]
    return at[order], on[order], share[order], enters[order]


def _drop_cancelling_crossings(place: Int, enters: Bool) -> Int:
    """Drop pairs of crossings at the same position that cancel each other.

    Rounding decides which of the two comes first, so they say nothing about whether the line was inside before.

    Args:
        place: (C,) number of the position of each crossing, sorted along the lines.
        enters: (C,) whether each crossing enters.

    Returns:
        Indices of the crossings that remain.
    """
    if not len(place):
        return np.zeros(0, np.int64)
    first = np.flatnonzero(run_starts(place))
    entering = np.add.reduceat(enters, first, dtype=np.int64)
    leaving = np.diff(np.append(first, len(place))) - entering
    of = np.repeat(np.arange(len(first)), entering + leaving)
    ins = np.cumsum(enters, dtype=np.int64)
    outs = np.arange(1, len(place) + 1) - ins
    # Rank of each crossing among those of its kind at its position.
    nth = np.where(enters, ins - (ins[first] - enters[first])[of], outs - (outs[first] - ~enters[first])[of])
    more = np.where(enters, (entering - leaving)[of], (leaving - entering)[of])
    return np.asarray(np.flatnonzero(nth <= more))


def _is_shifted_left(step: Int) -> Bool:
    """Return a mask (n,) of lines whose points would lie to the left of the unshifted line after a tiny shift in x.

    If the line is parallel to x, a far smaller shift in y decides.
    """
    return np.asarray(np.where(step[:, 1] == 0, step[:, 0] > 0, step[:, 1] < 0))


def _find_starts_and_ends(
    areas: Areas, lines: Polylines, owner: Int, crossings: tuple[Int, Int, Float, Bool]
) -> tuple[_Cuts, _Cuts]:
    """Find the start and end of each clipped part, given the crossings of lines and outlines."""
    at, edge, share, enters = crossings
    line = owner[at]
    depth, before = _count_depths(areas, lines, line, np.where(enters, 1, -1))
    begins, ends = enters & (depth == 1), ~enters & (depth == 0)
    inside_first = np.flatnonzero(before > 0)
    after = before.copy()
    after[line] = depth  # the last crossing of each line wins
    inside_last = np.flatnonzero(after > 0)

    where = lines.xy[at] + share[:, None] * (lines.xy[np.minimum(at + 1, len(lines.xy) - 1)] - lines.xy[at])
    first, last = lines.start[:-1], lines.start[1:] - 1
    begin = _sort_cuts(
        # The start of a line inside comes before its first crossing.
        (inside_first, first[inside_first], lines.xy[first[inside_first]], None),
        (line[begins], at[begins], where[begins], edge[begins]),
    )
    end = _sort_cuts(
        (line[ends], at[ends], where[ends], edge[ends]),
        # The last point is the end itself, so only the points before it lie in between.
        (inside_last, last[inside_last] - 1, lines.xy[last[inside_last]], None),
    )
    return begin, end


class _Cuts(Struct, frozen=True, eq=False):
    """Starts or ends of clipped parts.

    Attributes:
        line: (P,) line of each part.
        at: (P,) last point of the line before the cut.
        xy: (P, 2) mm, position of the cut.
        edge: (P,) edge of the areas at the cut; -1 at the end of a line.
    """

    line: Int
    at: Int
    xy: Float
    edge: Int


def _sort_cuts(*parts: tuple[Int, Int, Float, Int | None]) -> _Cuts:
    """Sort cuts by line and along it; on the same segment, keep the order of the arguments."""
    line, at = (np.concatenate([part[i] for part in parts]) for i in (0, 1))
    xy = np.concatenate([part[2] for part in parts])
    edge = np.concatenate([np.full(len(part[0]), -1) if part[3] is None else part[3] for part in parts])
    order = np.lexsort((at, line))
    return _Cuts(line[order], at[order], xy[order], edge[order])


def _build_parts(lines: Polylines, begin: _Cuts, end: _Cuts) -> tuple[Polylines, Int]:
    """Build one line from each start to the end with the same index; also return the source line of each."""
    inner = np.maximum(end.at - begin.at, 0)
    size = inner + 2
    xy = np.zeros((int(size.sum()), 2))
    start = np.cumsum(size) - size
    xy[start], xy[start + size - 1] = begin.xy, end.xy
    between = consecutive(start + 1, inner)
    xy[between] = lines.xy[consecutive(begin.at + 1, inner)]
    # A corner on the outline is also a crossing; keep only the crossing.
    near = np.hypot(*np.diff(xy, axis=0).T) < _SHORTEST
    keep = np.ones(len(xy), np.bool_)
    keep[between] = ~near[between - 1]
    before_end = (start + size - 2)[inner > 0]
    keep[before_end] &= ~near[before_end]
    owner = np.repeat(np.arange(len(size)), size)
    size = np.bincount(owner[keep], minlength=len(size))
    edges = np.stack([begin.edge, end.edge], axis=1)
    made = Polylines.of(xy[keep], size, lines.layer[begin.line], edges)
    kept = np.flatnonzero(made.length() > _SHORTEST)
    return made.take(kept), begin.line[kept]


def _count_depths(areas: Areas, lines: Polylines, line: Int, change: Int) -> tuple[Int, Int]:
    """Return the number of areas that contain the line after each crossing (C,), and at the start of each line (M,)."""
    total = np.cumsum(change)
    first = np.flatnonzero(run_starts(line))
    counts = np.diff(np.append(first, len(line)))
    own = total - np.repeat(total[first] - change[first], counts) if len(line) else total
    before = np.zeros(lines.n_lines, np.int64)
    if len(line):
        before[line[first]] = np.maximum(-np.minimum.reduceat(own, first), 0)
    untouched = np.ones(lines.n_lines, np.bool_)
    untouched[line] = False
    before[untouched] = _is_start_inside(areas, lines, np.flatnonzero(untouched))
    return own + before[line], before


def _is_start_inside(areas: Areas, lines: Polylines, which: Int) -> Bool:
    """Return a mask (n,) of the lines `which` whose first point lies in the areas."""
    point, layer = lines.xy[lines.start[which]], lines.layer[which]
    low, high = areas.boxes()
    inside = np.zeros(len(which), np.bool_)
    near = np.flatnonzero(((point >= low[layer]) & (point <= high[layer])).all(axis=1))
    if len(near):
        from printer_slicer.geometry.segment_index import OutlineIndex  # noqa: PLC0415 - only few lines need a search tree

        known = areas.of_layers(layer[near])
        outlines = OutlineIndex(known, point[near].min(axis=0), point[near].max(axis=0))
        inside[near] = outlines.is_inside(point[near], layer[near])
    return inside
