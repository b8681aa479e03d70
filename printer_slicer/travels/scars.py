"""Ways over top skin: what oozes there, or drags, is seen."""

from __future__ import annotations

import numpy as np

from printer_slicer.geometry.nearest import Segments
from printer_slicer.model import Bool, Int, Role, Toolpaths
from printer_slicer.travels.routes import Routes

__all__ = ["over_top_skin"]


def over_top_skin(paths: Toolpaths, ways: Routes, leads_to: Int) -> Bool:
    """(W,) whether ways cross lines of top skin that are printed before, unless they are to be ironed yet.

    Args:
        paths: in printing order.
        ways: (W,) routes between them.
        leads_to: (W,) the path that each leads to.
    """
    result = np.zeros(len(leads_to), np.bool_)
    lines, owner = _lines_shown(paths, ways.layer)
    route, point = ways.legs
    shows = np.zeros(paths.plan.n_layers, np.bool_)
    shows[paths.layer[owner]] = True
    some = np.flatnonzero(shows[ways.layer[route]])
    route, point = route[some], point[some]
    leg, line, _ = lines.crossed(ways.xy[point], ways.xy[point + 1], ways.layer[route])
    way, over = route[leg], owner[line]
    ironed_yet = (paths.role[leads_to[way]] == Role.IRONING) & (paths.role[over] == Role.TOP_SKIN)
    result[way[(over < leads_to[way]) & ~ironed_yet]] = True
    return result


def _lines_shown(paths: Toolpaths, layers: Int) -> tuple[Segments, Int]:
    """The lines of top skin and ironing on `layers` (n,), and (S,) the path that each belongs to."""
    used = np.zeros(paths.plan.n_layers, np.bool_)
    used[layers] = True
    shown = (paths.role == Role.TOP_SKIN) | (paths.role == Role.IRONING)
    chosen = np.flatnonzero(shown & used[paths.layer])
    lines = paths.take(chosen)
    begin, end = lines.ends_of_beads
    owner = np.repeat(chosen, lines.beads_of_each)
    ends = lines.xy[begin], lines.xy[end]
    box = paths.xy.min(axis=0), paths.xy.max(axis=0)
    return Segments(ends, paths.layer[owner], paths.plan.n_layers, box), owner
