"""Find travels that cross top solid infill, where oozing would be visible."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from printer_slicer.arrays import Bool, Float, Int
from printer_slicer.geometry.facet_topology import spread
from printer_slicer.geometry.segment_index import SegmentIndex
from printer_slicer.model import Toolpaths
from printer_slicer.roles import Role, roles_with
from printer_slicer.travels.routes import Routes

__all__ = ["crosses_top_infill"]

_STEP = 0.5  # of the extrusion width: sampling distance along travels
_OWN = 1.0  # of that width: so near to its ends a travel may lie on the lines that it joins


@dataclass(frozen=True, slots=True, eq=False)
class _Shown:
    """The lines of top skin and ironing.

    Attributes:
        lines: their centre lines.
        owner: (S,) the path that each belongs to.
        width: (S,) mm of each.
    """

    lines: SegmentIndex
    owner: Int
    width: Float


def crosses_top_infill(paths: Toolpaths, ways: Routes, leads_to: Int) -> Bool:
    """(W,) whether travels cross printed top skin that will not be ironed later.

    Args:
        paths: in printing order.
        ways: (W,) routes between them.
        leads_to: (W,) the path that each leads to.
    """
    result = np.zeros(len(leads_to), np.bool_)
    shown = _shown(paths, ways.layer)
    if not len(shown.owner):
        return result
    route, point = ways.legs
    shows = np.zeros(paths.plan.n_layers, np.bool_)
    shows[paths.layer[shown.owner]] = True
    some = np.flatnonzero(shows[ways.layer[route]])
    route, point = route[some], point[some]
    leg, line, _ = shown.lines.crossed(ways.xy[point], ways.xy[point + 1], ways.layer[route])
    result |= _scarred(paths, leads_to, route[leg], shown.owner[line])
    # Travels along a line do not cross it, but lie on it.
    left = np.flatnonzero(shows[ways.layer] & ~result)
    way, line = _on(shown, ways.take(left))
    return result | _scarred(paths, leads_to, left[way], shown.owner[line])


def _scarred(paths: Toolpaths, leads_to: Int, way: Int, over: Int) -> Bool:
    """(W,) the travels that pass over a finished path, from pairs `way`, `over` (X,)."""
    result = np.zeros(len(leads_to), np.bool_)
    ironed_yet = (paths.role[leads_to[way]] == Role.IRONING) & (paths.role[over] == Role.TOP_SOLID_INFILL)
    result[way[(over < leads_to[way]) & ~ironed_yet]] = True
    return result


def _on(shown: _Shown, ways: Routes) -> tuple[Int, Int]:
    """Find the travels that lie on a line between their ends: (X,) travel and (X,) line."""
    widest, narrowest = float(shown.width.max()), float(shown.width.min())
    way, xy, left = _sampled(ways, _STEP * narrowest)
    inner = left > _OWN * widest
    way, xy = way[inner], xy[inner]
    point, line, apart = shown.lines.within(xy, ways.layer[way], widest / 2)
    on = apart < shown.width[line] / 2
    return way[point[on]], line[on]


def _sampled(ways: Routes, step: float) -> tuple[Int, Float, Float]:
    """Sample travels every `step` mm: (P,) travel, (P, 2) position, (P,) mm to the nearer end."""
    route, point = ways.legs
    begin, along = ways.xy[point], ways.xy[point + 1] - ways.xy[point]
    length = np.hypot(*along.T)
    leg, place = spread(np.ceil(length / step).astype(np.int64))
    share = (place + 0.5) / np.ceil(length / step)[leg]
    before = np.append(0.0, np.cumsum(length))
    first = np.searchsorted(route, np.arange(len(ways.count)))
    gone = (before[:-1] - before[first[route]])[leg] + share * length[leg]
    way = route[leg]
    return way, begin[leg] + share[:, None] * along[leg], np.minimum(gone, ways.length()[way] - gone)


def _shown(paths: Toolpaths, layers: Int) -> _Shown:
    """Return the lines of top skin and ironing on `layers` (n,)."""
    used = np.zeros(paths.plan.n_layers, np.bool_)
    used[layers] = True
    seen = roles_with(is_top=True)[paths.role]
    chosen = np.flatnonzero(seen & used[paths.layer])
    lines = paths.take(chosen)
    begin, end = lines.ends_of_beads
    owner = np.repeat(chosen, lines.beads_of_each)
    box = paths.xy.min(axis=0), paths.xy.max(axis=0)
    segments = SegmentIndex((lines.xy[begin], lines.xy[end]), paths.layer[owner], paths.plan.n_layers, box)
    return _Shown(segments, owner, (lines.width[begin] + lines.width[end]) / 2)
