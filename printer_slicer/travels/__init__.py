"""Toolpaths -> Travels: how the nozzle gets from path to path, and where the filament is pulled back for it."""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Bool, Int
from printer_slicer.geometry.facet_topology import spread
from printer_slicer.geometry.segment_index import OutlineIndex
from printer_slicer.model import Sections, Toolpaths, Travels, leaves
from printer_slicer.profile import Profile
from printer_slicer.travels.rerouting import reroute
from printer_slicer.travels.routes import Routes, straight
from printer_slicer.travels.top_surface import crosses_top_infill

__all__ = ["travel"]


def travel(paths: Toolpaths, sections: Sections, profile: Profile) -> Travels:
    """Plan the travels between paths in printing order.

    Ways whose ends lie in one piece of the part go around its holes and corners, if they are not much longer than
    straight ones; others cross as few outlines as they can at little cost. The filament is pulled back where a way
    leaves the part, and where one longer than `printer.retract_before_travel` passes over top skin that is printed
    already; what oozes anywhere else inside is not seen.
    """
    begin, end = leaves(paths)
    if paths.n_paths < 2:
        return Travels.straight(np.zeros(paths.n_paths, np.bool_), np.zeros(paths.n_paths, np.int64))
    every = np.concatenate([begin, end])
    outlines = OutlineIndex(sections.solid, every.min(axis=0), every.max(axis=0))
    ways = straight(begin[1:], end[1:], paths.layer[1:])
    crossings = ways.crossings(outlines)
    if profile.quality.avoid_crossing:
        ways, crossings = reroute(ways, crossings, sections.solid, outlines, profile)
    retract = _retracted(paths, ways, crossings, profile)
    route, place = spread(ways.count)
    between = (place > 0) & (place < ways.count[route] - 1)
    return Travels(
        ways.xy[between],
        np.append([0, 0], np.cumsum(ways.count - 2)),
        np.append(False, retract),
        np.append(0, crossings),
    )


def _retracted(paths: Toolpaths, ways: Routes, crossings: Int, profile: Profile) -> Bool:
    """(W,) on which ways the filament is pulled back."""
    printer, length = profile.printer, ways.length()
    long = length > printer.retract_before_travel
    result = crossings > 0
    if printer.retract_inside:
        result |= long & (length > printer.retract_inside)
    some = np.flatnonzero(long & ~result)
    result[some] = crosses_top_infill(paths, ways.take(some), some + 1)
    return result & (printer.retract_length > 0)
