"""Toolpaths -> Travels: moves of the nozzle between paths, and the retractions for them."""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Bool, Int
from printer_slicer.geometry.facet_topology import expand_counts
from printer_slicer.geometry.segment_index import OutlineIndex
from printer_slicer.model import Sections, Toolpaths, Travels, find_travel_ends
from printer_slicer.profile import Profile
from printer_slicer.roles import roles_with
from printer_slicer.travels.rerouting import measure_detour_reach, reroute
from printer_slicer.travels.routes import Routes, straight_routes
from printer_slicer.travels.top_surface import crosses_top_infill

__all__ = ["measure_detour_reach", "travel"]

_ROWS_OF_SUPPORT = 2.0  # row spacings; shorter travels stay within a support


def travel(paths: Toolpaths, sections: Sections, profile: Profile) -> Travels:
    """Plan the travels between paths in printing order.

    A travel within one piece of the part goes around its holes and corners, if the detour is not much longer than the
    straight line. Other travels cross as few outlines as possible with short detours. The filament is retracted if a
    travel leaves the part, or if it is longer than `printer.retract_before_travel` and passes over printed top solid
    infill. Oozing elsewhere inside the part is not visible. Travels may cross supports; long ones to or from supports
    have a retraction.
    """
    begin, end = find_travel_ends(paths)
    if paths.n_paths < 2:
        return Travels.straight(np.zeros(paths.n_paths, np.bool_), np.zeros(paths.n_paths, np.int64))
    every = np.concatenate([begin, end])
    outlines = OutlineIndex(sections.solid, every.min(axis=0), every.max(axis=0))
    routes = straight_routes(begin[1:], end[1:], paths.layer[1:])
    crossings = routes.count_crossings(outlines)
    if profile.quality.avoid_crossing:
        routes, crossings = reroute(routes, crossings, sections.solid, outlines, profile)
    retract = _needs_retraction(paths, routes, crossings, profile)
    route, place = expand_counts(routes.count)
    between = (place > 0) & (place < routes.count[route] - 1)
    return Travels(
        routes.xy[between],
        np.append([0, 0], np.cumsum(routes.count - 2)),
        np.append(False, retract),
        np.append(0, crossings),
    )


def _needs_retraction(paths: Toolpaths, routes: Routes, crossings: Int, profile: Profile) -> Bool:
    """Return a mask (W,) of travels with a retraction."""
    printer, length = profile.printer, routes.length()
    long = length > printer.retract_before_travel
    result = crossings > 0
    if printer.retract_inside:
        result |= long & (length > printer.retract_inside)
    some = np.flatnonzero(long & ~result)
    result[some] = crosses_top_infill(paths, routes.take(some), some + 1)
    # Between lines of a support no thread matters, but between supports it would.
    carries = roles_with(is_support=True)[paths.role]
    if carries.any():
        within = max(printer.retract_before_travel, _ROWS_OF_SUPPORT * profile.quality.support_spacing)
        result |= (carries[1:] | carries[:-1]) & (length > within)
    return result & (printer.retract_length > 0)
