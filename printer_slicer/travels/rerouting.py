"""Lead travels around the outlines that they cross, where the detour is worth it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from printer_slicer.arrays import Float, Int
from printer_slicer.geometry.segment_index import OutlineIndex
from printer_slicer.model import Areas
from printer_slicer.profile import Profile
from printer_slicer.travels.detour_limit import detour_limits
from printer_slicer.travels.graphs import RouteQueries
from printer_slicer.travels.inset_regions import InsetRegions, inset_regions, outside_field
from printer_slicer.travels.routes import Routes, build_routes, drop_repeated_points, ease_corners
from printer_slicer.travels.routing import find_routes
from printer_slicer.travels.routing_field import RoutingField

__all__ = ["reroute"]

_CLEARANCE = 0.55  # bead widths that ways keep from outlines: they do not lie on the outer bead
_CLOSE = 0.25  # the same where that leaves no way: even a wall of one narrow bead can be passed
_ROOM = 0.45  # bead widths more that they keep where there is room
_GRAZING = 3.0  # mm that a way may be longer not to come nearer to an outline
_TOLL = 3.0  # mm that a way with a retraction may be longer to cross one outline less


def reroute(
    ways: Routes, crossings: Int, solid: Areas, outlines: OutlineIndex, profile: Profile
) -> tuple[Routes, Int]:
    """The ways, led around outlines that they cross or come too near to where that does not make them too long.

    Args:
        ways: straight ones.
        crossings: (W,) how many outlines each crosses.
        solid: the sections.
        outlines: of the sections.
        profile: what is worth it.

    Returns:
        All ways, and (W,) how many outlines they cross now.
    """
    width, length = profile.extrusion_width, ways.length()
    box = ways.xy.min(axis=0), ways.xy.max(axis=0)
    rooms = inset_regions(solid, box, _CLEARANCE * width)
    poor = np.flatnonzero((crossings > 0) | (ways.crossings(rooms.ground.outlines) > 0))
    some, straight = ways.take(poor), length[poor]
    limit = detour_limits(straight, profile)
    limit = np.where(crossings[poor] > 0, limit, np.minimum(limit, straight + _GRAZING))
    improving = _Improving(outlines, _ROOM * width, ways, crossings)
    room, other = _inside(improving, rooms, poor, limit)
    # What is too narrow for that may have room enough to pass closer by.
    left = np.flatnonzero(improving.crossings[poor] > 0)
    if len(left):
        close = inset_regions(solid, box, _CLOSE * width)
        room[left], other[left] = _inside(improving, close, poor[left], limit[left])
    fewest = (room >= 0).astype(np.float64) + (other >= 0)
    spare = improving.crossings[poor] - fewest
    many = np.flatnonzero(spare > 0)
    if len(many):
        asked = RouteQueries(*some.ends, some.layer, some.layer, straight + _TOLL * spare, _TOLL * fewest)
        ground = outside_field(solid, outlines, box, _CLEARANCE * width, _TOLL)
        improving.seek(poor[many], asked.take(many), ground)
    return improving.ways, improving.crossings


def _inside(improving: _Improving, rooms: InsetRegions, which: Int, limit: Float) -> tuple[Int, Int]:
    """Lead ways `which` (n,) through rooms, no longer than `limit` (n,) mm; the rooms that they begin and end in."""
    some = improving.ways.take(which)
    (begin, room), (end, other) = (rooms.locate(ends, some.layer) for ends in some.ends)
    inside = np.flatnonzero((room == other) & (room >= 0))
    asked = RouteQueries(begin, end, some.layer, room, limit, np.zeros(len(which)))
    improving.seek(which[inside], asked.take(inside), rooms.ground)
    return room, other


@dataclass(slots=True, eq=False)
class _Improving:
    """Ways and how many `outlines` they cross, while better ones are found.

    Attributes:
        outlines: of the sections.
        room: mm that corners are passed farther away than necessary.
        ways: (W,) all of them.
        crossings: (W,)
    """

    outlines: OutlineIndex
    room: float
    ways: Routes
    crossings: Int

    def seek(self, which: Int, asked: RouteQueries, ground: RoutingField) -> None:
        """Replace those of the ways `which` (n,) for which better ones are found."""
        ends = self.ways.take(which).ends
        leads = np.hypot(*(asked.begin - ends[0]).T) + np.hypot(*(asked.end - ends[1]).T)
        asked = replace(asked, limit=asked.limit - leads)
        found = find_routes(asked, ground)
        there = np.flatnonzero(found.there)
        which, asked, found, leads = which[there], asked.take(there), found.take(there), leads[there]
        tight, own = build_routes(self.ways.take(which), (asked.begin, asked.end), found, ground.corners)
        # In rooms nothing is crossed.
        least = tight.crossings(self.outlines) if np.isfinite(ground.toll) else np.zeros(len(which), np.int64)
        step = self.room * ground.corners.away[found.corners]
        better, hits = ease_corners(tight, own, step, (least, asked.limit + leads), self.outlines)
        before = self.crossings[which]
        # What crosses nothing comes too near to an outline, unless only its ends do.
        use = np.flatnonzero((hits < before) | (hits == 0) & (before == 0) & (found.count > 0))
        self.crossings = self.crossings.copy()
        self.crossings[which[use]] = hits[use]
        self.ways = self.ways.replaced(which[use], drop_repeated_points(better.take(use)))
