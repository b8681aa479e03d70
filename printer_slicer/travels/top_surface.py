"""Find travels that cross top solid infill, where oozing would be visible."""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, concatenate_pairs
from printer_slicer.geometry.facet_topology import expand_counts
from printer_slicer.geometry.ring_queries import crossing_shares
from printer_slicer.geometry.segment_index import SegmentIndex, distance_to_segments
from printer_slicer.model import Toolpaths
from printer_slicer.roles import Role, roles_with
from printer_slicer.travels.routes import Routes
from printer_slicer.values import Struct

__all__ = ["crosses_top_infill"]

_STEP = 0.5  # of the extrusion width: sampling distance along travels
_SAMPLES_AT_ONCE = 1 << 14  # so that memory does not grow with the length of the travels
_PIECE = 12.0  # extrusion widths: maximum length of pieces of lines; boxes of long slanted ones are too large
_MARGIN = 1e-6  # mm, larger than rounding errors of distances to pieces
_OWN = 1.0  # of the extrusion width: within this distance of its ends a travel may lie on the lines that it joins


class _VisibleLines(Struct, frozen=True, eq=False):
    """Extrusions of top solid infill and ironing.

    Attributes:
        begin, end: (S, 2) mm, ends of their centre lines.
        owner: (S,) path of each line.
        width: (S,) mm, width of each line.
        pieces: search index of short pieces of the lines.
        line: (T,) line of each piece.
    """

    begin: Float
    end: Float
    owner: Int
    width: Float
    pieces: SegmentIndex
    line: Int

    def find_crossings(self, begin: Float, end: Float, layer: Int) -> tuple[Int, Int]:
        """Return pairs of a leg from `begin` to `end` (P, 2) on its `layer` (P,) and a line that it crosses."""
        low, high, leg_of = _cut_into_pieces(begin, end, _PIECE * self.width.min())
        reach = np.copysign(_MARGIN, high - low)
        found = []
        for part, piece in self.pieces.find_touching(low - reach, high + reach, layer[leg_of]):
            leg, line = leg_of[part], self.line[piece]
            share = crossing_shares(begin[leg], end[leg], self.begin[line], self.end[line])
            found.append(_select_pairs(leg, line, ~np.isnan(share)))
        return concatenate_pairs(found)

    def find_around(self, points: Float, layer: Int) -> tuple[Int, Int]:
        """Return pairs of a point (P, 2) on its `layer` (P,) and a line that covers it."""
        reach = self.width.max() / 2 + _MARGIN
        found = []
        for point, piece in self.pieces.find_touching(points - reach, points + reach, layer):
            line = self.line[piece]
            apart = distance_to_segments(points[point], self.begin[line], self.end[line])
            found.append(_select_pairs(point, line, apart < self.width[line] / 2))
        return concatenate_pairs(found)


def crosses_top_infill(paths: Toolpaths, routes: Routes, leads_to: Int) -> Bool:
    """Return a mask (W,) of travels that cross top solid infill after it was printed, unless it is ironed later.

    Args:
        paths: paths in printing order.
        routes: (W,) routes of the travels between them.
        leads_to: (W,) the path after each travel.
    """
    result = np.zeros(len(leads_to), np.bool_)
    visible = _select_visible_lines(paths, routes.layer)
    if not len(visible.owner):
        return result
    route, point = routes.legs
    has_visible = np.zeros(paths.plan.n_layers, np.bool_)
    has_visible[paths.layer[visible.owner]] = True
    some = np.flatnonzero(has_visible[routes.layer[route]])
    route, point = route[some], point[some]
    leg, line = visible.find_crossings(routes.xy[point], routes.xy[point + 1], routes.layer[route])
    result |= _mark_travels_over_paths(paths, leads_to, route[leg], visible.owner[line])
    # A travel along a line does not cross it, but lies on it.
    left = np.flatnonzero(has_visible[routes.layer] & ~result)
    travel, line = _find_travels_on_lines(visible, routes.take(left))
    return result | _mark_travels_over_paths(paths, leads_to, left[travel], visible.owner[line])


def _mark_travels_over_paths(paths: Toolpaths, leads_to: Int, travel: Int, over: Int) -> Bool:
    """Return a mask (W,) of travels that pass over a finished path, given pairs of a travel and a path (X,)."""
    result = np.zeros(len(leads_to), np.bool_)
    ironed_yet = (paths.role[leads_to[travel]] == Role.IRONING) & (paths.role[over] == Role.TOP_SOLID_INFILL)
    result[travel[(over < leads_to[travel]) & ~ironed_yet]] = True
    return result


def _find_travels_on_lines(visible: _VisibleLines, routes: Routes) -> tuple[Int, Int]:
    """Find travels that run along a visible line; return pairs of a travel (X,) and a line (X,)."""
    widest, step = float(visible.width.max()), _STEP * float(visible.width.min())
    batch = (np.cumsum(routes.length() / step) // _SAMPLES_AT_ONCE).astype(np.int64)
    found = []
    for some in np.split(np.arange(len(batch)), np.flatnonzero(np.diff(batch)) + 1):
        travel, xy, left = _sample_travels(routes.take(some), step)
        inner = left > _OWN * widest
        travel, xy = some[travel[inner]], xy[inner]
        point, line = visible.find_around(xy, routes.layer[travel])
        found.append((travel[point], line))
    return concatenate_pairs(found)


def _sample_travels(routes: Routes, step: float) -> tuple[Int, Float, Float]:
    """Sample travels about every `step` mm; return travel (P,), position (P, 2), and mm to the nearer end (P,)."""
    route, point = routes.legs
    begin, along = routes.xy[point], routes.xy[point + 1] - routes.xy[point]
    length = np.hypot(*along.T)
    leg, place = expand_counts(np.ceil(length / step).astype(np.int64))
    share = (place + 0.5) / np.ceil(length / step)[leg]
    before = np.append(0.0, np.cumsum(length))
    first = np.searchsorted(route, np.arange(len(routes.count)))
    from_start = (before[:-1] - before[first[route]])[leg] + share * length[leg]
    travel = route[leg]
    return (
        travel,
        begin[leg] + share[:, None] * along[leg],
        np.minimum(from_start, routes.length()[travel] - from_start),
    )


def _select_visible_lines(paths: Toolpaths, layers: Int) -> _VisibleLines:
    """Return the extrusions of top solid infill and ironing on `layers` (n,)."""
    used = np.zeros(paths.plan.n_layers, np.bool_)
    used[layers] = True
    seen = roles_with(is_top=True)[paths.role]
    chosen = np.flatnonzero(seen & used[paths.layer])
    lines = paths.take(chosen)
    begin, end = lines.ends_of_beads
    owner = np.repeat(chosen, lines.beads_of_each)
    box = paths.xy.min(axis=0), paths.xy.max(axis=0)
    width = (lines.width[begin] + lines.width[end]) / 2
    ends = lines.xy[begin], lines.xy[end]
    length = _PIECE * float(width.min(initial=np.inf))
    first, last, line = _cut_into_pieces(*ends, length)
    layer = paths.layer[owner][line]
    # Sort the pieces by strips: consecutive ones share boxes of the search tree, so they should be near each other.
    order = np.lexsort((first[:, 0], np.floor(first[:, 1] / length), layer))
    pieces = SegmentIndex((first[order], last[order]), layer[order], paths.plan.n_layers, box)
    return _VisibleLines(*ends, owner, width, pieces, line[order])


def _cut_into_pieces(begin: Float, end: Float, length: float) -> tuple[Float, Float, Int]:
    """Cut lines (S, 2) into pieces of at most `length` mm; return their ends (T, 2) and the line of each (T,)."""
    way = end - begin
    count = np.maximum(np.ceil(np.hypot(*way.T) / length).astype(np.int64), 1)
    line, place = expand_counts(count)
    first, last = (begin[line] + way[line] * ((place + more) / count[line])[:, None] for more in (0, 1))
    return first, last, line


def _select_pairs(one: Int, other: Int, chosen: Bool) -> tuple[Int, Int]:
    """Return the chosen pairs."""
    return one[chosen], other[chosen]
