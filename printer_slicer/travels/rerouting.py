"""Reroute travels around the outlines that they cross, where the detour is worth it."""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Float, Int
from printer_slicer.geometry.segment_index import OutlineIndex
from printer_slicer.model import Areas
from printer_slicer.profile import Profile
from printer_slicer.travels.detour_limit import detour_limits
from printer_slicer.travels.graphs import RouteQueries
from printer_slicer.travels.inset_regions import (
    SIMPLER,
    InsetRegions,
    build_inset_regions,
    build_outside_field,
    is_within,
)
from printer_slicer.travels.routes import Routes, build_routes, drop_repeated_points, move_corners_from_walls
from printer_slicer.travels.routing import find_routes
from printer_slicer.travels.routing_field import SHARPEST, RoutingField
from printer_slicer.values import Struct, replace

__all__ = ["measure_detour_reach", "reroute"]

_CLEARANCE = (
    0.55  # extrusion widths from route to outline, so that routes do not touch the external perimeter
)
_CLOSE = 0.25  # clearance if the normal one leaves no route; passes even walls of one narrow extrusion
_ROOM = 0.45  # extra clearance in extrusion widths, where there is room
_GRAZING = 3.0  # mm by which a route may be longer to keep its clearance from outlines
_TOLL = 3.0  # mm by which a route with a retraction may be longer to cross one outline less


def measure_detour_reach(profile: Profile) -> float:
    """Return how far routes around corners may lead beyond the convex hull of the part, mm."""
    if not profile.quality.avoid_crossing:
        return 0.0
    return (_CLEARANCE * (1 / SHARPEST + SIMPLER) + _ROOM) * profile.extrusion_width


def reroute(
    routes: Routes, crossings: Int, solid: Areas, outlines: OutlineIndex, profile: Profile
) -> tuple[Routes, Int]:
    """Lead routes around outlines that they cross or come too close to, unless that makes them too long.

    Args:
        routes: straight routes.
        crossings: (W,) number of outlines that each crosses.
        solid: the sections.
        outlines: outlines of the sections.
        profile: sets the limits for detours.

    Returns:
        All routes, and the number of outlines (W,) that they cross now.
    """
    width, length = profile.extrusion_width, routes.length()
    box = routes.xy.min(axis=0), routes.xy.max(axis=0)
    regions = build_inset_regions(solid, box, _CLEARANCE * width)
    blocked = np.flatnonzero((crossings > 0) | (routes.count_crossings(regions.field.outlines) > 0))
    some, straight = routes.take(blocked), length[blocked]
    limit = detour_limits(straight, profile)
    limit = np.where(crossings[blocked] > 0, limit, np.minimum(limit, straight + _GRAZING))
    low, high = np.array(profile.printer.corners)
    bed = np.array([np.minimum(low, box[0]), np.maximum(high, box[1])])
    improver = _RouteImprover(outlines, _ROOM * width, bed, routes, crossings)
    region, other = _find_routes_inside(improver, regions, blocked, limit)
    # Where the regions are too narrow for this clearance, try a smaller one.
    left = np.flatnonzero(improver.crossings[blocked] > 0)
    if len(left):
        close = build_inset_regions(solid, box, _CLOSE * width)
        region[left], other[left] = _find_routes_inside(improver, close, blocked[left], limit[left])
    fewest = (region >= 0).astype(np.float64) + (other >= 0)
    spare = improver.crossings[blocked] - fewest
    many = np.flatnonzero(spare > 0)
    if len(many):
        queries = RouteQueries(*some.ends, some.layer, some.layer, straight + _TOLL * spare, _TOLL * fewest)
        field = build_outside_field(solid, outlines, (box, bed), _CLEARANCE * width, _TOLL)
        improver.improve(blocked[many], queries.take(many), field)
    return improver.routes, improver.crossings


def _find_routes_inside(
    improver: _RouteImprover, regions: InsetRegions, indices: Int, limit: Float
) -> tuple[Int, Int]:
    """Reroute `indices` (n,) through inset regions where this makes a route no longer than its `limit` (n,) mm.

    Returns:
        The regions (n,) in which they start and end; -1 for none.
    """
    some = improver.routes.take(indices)
    (begin, region), (end, other) = (regions.locate(ends, some.layer) for ends in some.ends)
    inside = np.flatnonzero((region == other) & (region >= 0))
    queries = RouteQueries(begin, end, some.layer, region, limit, np.zeros(len(indices)))
    improver.improve(indices[inside], queries.take(inside), regions.field)
    return region, other


class _RouteImprover(Struct, eq=False):
    """Routes that are replaced when better ones are found.

    Attributes:
        outlines: outlines of the sections.
        extra_clearance: mm, distance added at corners.
        bed: (2, 2) lowest and highest x and y of the bed, and of the ends of routes if these lie beyond it, mm.
        routes: (W,) all routes.
        crossings: (W,) number of outlines that each crosses.
    """

    outlines: OutlineIndex
    extra_clearance: float
    bed: Float
    routes: Routes
    crossings: Int

    def improve(self, which: Int, queries: RouteQueries, field: RoutingField) -> None:
        """Replace the routes `which` (n,) where better ones are found."""
        ends = self.routes.take(which).ends
        leads = np.hypot(*(queries.begin - ends[0]).T) + np.hypot(*(queries.end - ends[1]).T)
        queries = replace(queries, limit=queries.limit - leads)
        found = find_routes(queries, field)
        kept = np.flatnonzero(found.is_found)
        which, queries, found, leads = which[kept], queries.take(kept), found.take(kept), leads[kept]
        tight, own = build_routes(self.routes.take(which), (queries.begin, queries.end), found, field.corners)
        # Routes in inset regions cross nothing.
        least = (
            tight.count_crossings(self.outlines)
            if np.isfinite(field.toll)
            else np.zeros(len(which), np.int64)
        )
        place, away = (column[found.corners] for column in (field.corners.place, field.corners.away))
        farther = np.clip(place + self.extra_clearance * away, *self.bed)
        step = np.where(is_within(place, self.bed)[:, None], farther - place, 0.0)
        better, hits = move_corners_from_walls(
            tight, own, step, (least, queries.limit + leads), self.outlines
        )
        before = self.crossings[which]
        # A route without crossings was searched because it comes too near to an outline, unless only its ends do.
        use = np.flatnonzero((hits < before) | (hits == 0) & (before == 0) & (found.count > 0))
        self.crossings = self.crossings.copy()
        self.crossings[which[use]] = hits[use]
        self.routes = self.routes.replace_routes(which[use], drop_repeated_points(better.take(use)))
