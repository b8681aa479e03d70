"""Trace the middle beads along the medial axis, where the number of beads across is odd."""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, distinct, polyline_lengths, run_starts
from printer_slicer.geometry.boxes import Boxes
from printer_slicer.geometry.connectivity import find_cycles
from printer_slicer.geometry.facet_topology import expand_counts
from printer_slicer.geometry.vectors import dot, norm
from printer_slicer.perimeters.beading import Beading
from printer_slicer.perimeters.graph import thin_and_thick_ends
from printer_slicer.perimeters.layout import BeadLayout
from printer_slicer.values import Struct, replace

__all__ = ["MiddleLines", "trace_middle_lines"]

_ROUNDING = 1e-6  # mm
_MIN_LENGTH = 0.4  # bead widths; shorter lines are not worth a start and a stop
_RING_CORNERS = 6  # corners of the ring that replaces a dot


class MiddleLines(Struct, frozen=True, eq=False):
    """Polylines with widths.

    Attributes:
        xy: (N, 2) mm.
        width: (N,) mm.
        size: (M,) number of points.
        layer: (M,).
        depth: (M,) number of loops around it.
        closed: (M,) whether it returns to its first point.
    """

    xy: Float
    width: Float
    size: Int
    layer: Int
    depth: Int
    closed: Bool

    @classmethod
    def empty(cls) -> MiddleLines:
        """Return no lines."""
        none = np.zeros(0, np.int64)
        return cls(np.zeros((0, 2)), np.zeros(0), none, none, none, np.zeros(0, np.bool_))

    def length(self) -> Float:
        """Return the length (M,) of each line, mm, without the closing side of closed lines."""
        return polyline_lengths(self.xy, np.append(0, np.cumsum(self.size)), closed=False)

    def take(self, is_selected: Bool) -> MiddleLines:
        """Return the lines for which `is_selected` is true."""
        points = np.repeat(is_selected, self.size)
        return MiddleLines(
            self.xy.compress(points, axis=0),
            self.width[points],
            self.size[is_selected],
            self.layer[is_selected],
            self.depth[is_selected],
            self.closed[is_selected],
        )

    def merge(self, other: MiddleLines) -> MiddleLines:
        """Return these lines followed by the other ones."""
        return MiddleLines(
            np.concatenate([self.xy, other.xy]),
            np.concatenate([self.width, other.width]),
            np.concatenate([self.size, other.size]),
            np.concatenate([self.layer, other.layer]),
            np.concatenate([self.depth, other.depth]),
            np.concatenate([self.closed, other.closed]),
        )


def trace_middle_lines(layout: BeadLayout, beading: Beading) -> MiddleLines:
    """Return polylines along all runs of pieces with a middle bead, and a small ring wherever only a dot fits."""
    lines, short = _trace_lines(layout, beading)
    dots = _replace_by_rings(short).merge(_make_dots(layout, beading))
    return lines.merge(dots.take(~_find_overlapping_dots(dots, lines)))


def _find_overlapping_dots(dots: MiddleLines, lines: MiddleLines) -> Bool:
    """Return which dots (m,) overlap a line or an earlier dot."""
    low, high = (
        side.reduceat(dots.xy, np.cumsum(dots.size) - dots.size, axis=0) for side in (np.minimum, np.maximum)
    )
    points = Boxes(lines.xy, lines.xy, np.repeat(lines.layer, lines.size))
    around = Boxes(low, high, dots.layer)
    result = around.touches_any(points)
    result[np.maximum(*around.find_neighbours())] = True
    return result


def _make_dots(layout: BeadLayout, beading: Beading) -> MiddleLines:
    """Return a small ring in each place that is about as long as wide and has space for one more bead.

    The ring is pi/4 widths long, so its volume is that of a disc of the bead's width.
    """
    count = layout.count
    port = distinct(layout.port[layout.used].ravel())
    port = port[
        (layout.point[port] == layout.leader[port])
        & (count[port] % 2 == 1)
        & (count[port] < beading.full_count)
    ]
    taken = np.zeros(len(layout.graph.xy), np.bool_)
    taken[layout.graph.ends[layout.middle]] = True
    port = port[~taken[layout.point[port]]]
    width, middle = layout.width[-1, port], layout.graph.xy[layout.point[port]]
    return _make_rings(
        middle, width, np.pi / 4 * width, layout.graph.layer[layout.point[port]], count[port] // 2
    )


def _make_rings(middle: Float, width: Float, length: Float, layer: Int, depth: Int) -> MiddleLines:
    """Make small rings (m,) of given length around points (m, 2)."""
    turn = np.arange(_RING_CORNERS) * (2 * np.pi / _RING_CORNERS)
    ring = np.column_stack([np.cos(turn), np.sin(turn)]) / (2 * np.sin(np.pi / _RING_CORNERS) * _RING_CORNERS)
    n = len(middle)
    return MiddleLines(
        (middle[:, None] + ring * length[:, None, None]).reshape(-1, 2),
        np.repeat(width, _RING_CORNERS),
        np.full(n, _RING_CORNERS),
        layer,
        depth,
        np.ones(n, np.bool_),
    )


def _trace_lines(layout: BeadLayout, beading: Beading) -> tuple[MiddleLines, MiddleLines]:
    """Return polylines along the runs of pieces with a middle bead: those long enough for a line, and those too short.

    Where three runs meet, the straightest two form one line; the others end at its side.
    """
    graph = layout.graph
    half = np.flatnonzero(np.repeat(layout.middle, 2))
    if not len(half):
        return MiddleLines.empty(), MiddleLines.empty()
    number = np.full(len(graph.start), -1)
    number[half] = np.arange(len(half))
    partner, met = _find_continuations(
        graph.start[half],
        graph.xy.take(graph.start[half ^ 1], axis=0) - graph.xy.take(graph.start[half], axis=0),
    )
    twin = number[half ^ 1]
    # A line turns back at its end, so there and back is one cycle.
    onward = np.where(partner[twin] >= 0, partner[twin], twin)
    lowest, place = find_cycles(onward)
    turn = np.bincount(lowest, minlength=len(half))
    begin = np.full(len(half), -1)
    starts = np.flatnonzero(partner < 0)
    begin[lowest[starts[::-1]]] = starts[::-1]  # the end with the lower number
    closed = begin < 0
    first = np.where(closed, np.arange(len(half)), begin)
    rank = (place - place[first[lowest]]) % turn[lowest]
    chosen = np.where(closed[lowest], half[lowest] % 2 == 0, 2 * rank < turn[lowest])
    order = np.flatnonzero(chosen)
    order = order[np.lexsort((rank[order], lowest[order]))]
    steps = _LineSteps(half[order], lowest[order], closed[lowest[order]], met[order], met[twin[order]])
    lines, tips = _build_polylines(layout, steps)
    short = lines.length() < _MIN_LENGTH * lines.width[np.cumsum(lines.size) - 1]
    needed = ((lines.depth == 0) | tips.all(axis=0)) & (beading.loops > 0)
    return _lengthen_tips(lines.take(~short), tips[:, ~short]), lines.take(short & needed)


def _replace_by_rings(lines: MiddleLines) -> MiddleLines:
    """Replace lines shorter than their width by rings, because such lines would lack the volume of their round ends."""
    first = np.cumsum(lines.size) - lines.size
    middle = np.add.reduceat(lines.xy, first, axis=0) / lines.size[:, None]
    width = lines.width[first]
    return _make_rings(middle, width, np.pi / 4 * width + lines.length(), lines.layer, lines.depth)


def _find_continuations(point: Int, way: Float) -> tuple[Int, Bool]:
    """Return for each half-piece (h,) its straightest continuation or -1, and whether it ends at a passing line."""
    order = np.argsort(point, kind="stable")
    point = point[order]
    starts = np.flatnonzero(run_starts(point))
    degree = np.diff(np.append(starts, len(point)))
    way = way.take(order, axis=0)
    way /= np.maximum(norm(way), 1e-12)[:, None]
    group, pair = expand_counts(degree * degree)
    a, b = starts[group] + pair // degree[group], starts[group] + pair % degree[group]
    group, a, b = group[a < b], a[a < b], b[a < b]
    straight = dot(way.take(a, axis=0), way.take(b, axis=0))
    best = np.full(len(starts), -1)
    ranked = np.argsort(-straight, kind="stable")
    best[group[ranked]] = ranked  # the straightest is written last
    best = best[best >= 0]
    result = np.full(len(point), -1)
    result[order[a[best]]], result[order[b[best]]] = order[b[best]], order[a[best]]
    met = np.zeros(len(point), np.bool_)
    met[order] = np.repeat(degree > 2, degree)
    return result, met & (result < 0)


class _LineSteps(Struct, frozen=True, eq=False):
    """Half-pieces (h,) in the order of the lines: the line of each, and whether that is closed and meets others."""

    half: Int
    line: Int
    closed: Bool
    met_before: Bool
    met_after: Bool


def _build_polylines(layout: BeadLayout, chosen: _LineSteps) -> tuple[MiddleLines, Bool]:
    """Build lines through ordered half-pieces; also return whether each begins and ends (2, M) at an end of the axis.

    Ends at the side of another line are cut back. Steps shorter than a rounding error become one point.
    """
    graph, half, line = layout.graph, chosen.half, chosen.line
    begins = np.flatnonzero(run_starts(line))
    size = np.diff(np.append(begins, len(line)))
    last = begins + size - 1
    port = np.take_along_axis(layout.port[half >> 1], (half & 1)[:, None], axis=1)[:, 0]
    far = np.take_along_axis(layout.port[half >> 1], 1 - (half & 1)[:, None], axis=1)[:, 0]
    # Every line has the begin of each of its pieces, and the end of the last one.
    slot = np.arange(len(half)) + np.repeat(np.arange(len(size)), size)
    n = len(half) + len(size)
    xy, width, end = np.zeros((n, 2)), np.zeros(n), last + np.arange(len(size)) + 1
    xy[slot], width[slot] = graph.xy.take(graph.start[half], axis=0), layout.width[-1, port]
    xy[end], width[end] = graph.xy[graph.start[half[last] ^ 1]], layout.width[-1, far[last]]
    depth = layout.count[port[begins]] // 2
    turned = _find_turning_points(layout)
    stops = turned[depth, graph.start[half[begins]]], turned[depth, graph.start[half[last] ^ 1]]
    trim = [
        np.where(chosen.met_before[begins] | stops[0], layout.width[-1, port[begins]] / 2, 0.0),
        np.where(chosen.met_after[last] | stops[1], layout.width[-1, far[last]] / 2, 0.0),
    ]
    xy, width = _trim_ends(xy, width, size + 1, trim[0], trim[1])
    owner = np.repeat(np.arange(len(size)), size + 1)
    new = run_starts(owner)
    step = np.abs(xy[1:] - xy[:-1])
    new[1:] |= (step[:, 0] > _ROUNDING) | (step[:, 1] > _ROUNDING)
    ring = chosen.closed[begins]
    new[end[ring]] = False
    lines = MiddleLines(
        xy[new],
        width[new],
        np.bincount(owner[new], minlength=len(size)),
        graph.layer[graph.start[half[begins]]],
        depth,
        ring,
    )
    return lines, _find_axis_ends(layout)[np.stack([graph.start[half[begins]], graph.start[half[last] ^ 1]])]


def _find_turning_points(layout: BeadLayout) -> Bool:
    """Return the points (loops + 1, N) of the graph at which loops of each level may turn around."""
    result = np.zeros((len(layout.active), len(layout.graph.xy)), np.bool_)
    for level, active in enumerate(layout.active):
        result[level, layout.graph.ends[active]] = True
    return result


def _find_axis_ends(layout: BeadLayout) -> Bool:
    """Return which points (N,) of the graph are ends of the axis; pieces into corners do not count."""
    graph, other = layout.graph, layout.point[layout.port] != layout.leader[layout.port]
    # Pieces whose beads follow a wider place: they rise from their thin end, or lead into a corner.
    led = layout.used & other.any(axis=1)
    ends = np.append(
        graph.ends[(layout.used | layout.wide) & ~led], thin_and_thick_ends(graph.ends[led], graph.radius)[0]
    )
    return np.asarray(np.bincount(ends.ravel(), minlength=len(layout.graph.xy)) == 1)


def _lengthen_tips(lines: MiddleLines, tips: Bool) -> MiddleLines:
    """Add the volume of half a disc to lines of two points or more where they begin or end at tips (2, M)."""
    last = np.cumsum(lines.size) - 1
    xy = lines.xy.copy()
    for end, inner in (((last - lines.size + 1)[tips[0]], 1), (last[tips[1]], -1)):
        way = lines.xy[end] - lines.xy[end + inner]
        way *= (np.pi / 8 * lines.width[end] / norm(way))[:, None]
        xy[end] += way
    return replace(lines, xy=xy)


def _trim_ends(xy: Float, width: Float, size: Int, before: Float, after: Float) -> tuple[Float, Float]:
    """Cut `before` and `after` (m,) mm off the two ends of polylines; the points cut off move to the new ends."""
    owner, step = expand_counts(size)
    length = norm(np.diff(xy, axis=0, prepend=xy[:1]))
    length[step == 0] = 0.0
    total = np.bincount(owner, length, len(size))
    # All lines follow each other on one axis, with gaps between them.
    place = np.cumsum(length) + owner
    start = np.cumsum(size) - size
    before = np.minimum(before, total)
    low, high = place[start] + before, place[start] + np.maximum(total - after, before)
    wanted = np.clip(place, low[owner], high[owner])
    return (
        np.column_stack([np.interp(wanted, place, column) for column in xy.T]),
        np.interp(wanted, place, width),
    )
