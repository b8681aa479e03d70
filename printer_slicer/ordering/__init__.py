"""Toolpaths -> Toolpaths: what is printed when, from which end, and where loops begin.

Skirt, brim and the loops of a raft first; then island by island. Within an island an outer perimeter and the inner ones
behind it follow each other, before infill or after it; bridges come before what leans on them, top skins last. What may
be printed in any order is printed in the one with the shortest ways.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from printer_slicer.arrays import Bool, Int, consecutive
from printer_slicer.geometry import rings_around
from printer_slicer.model import Areas, Sections, Toolpaths
from printer_slicer.ordering.breaking import broken
from printer_slicer.ordering.loops import closed_up
from printer_slicer.ordering.nearby import begun_nearby, begun_toward_seams
from printer_slicer.ordering.route import routed
from printer_slicer.ordering.scarf import scarfed
from printer_slicer.ordering.seams import with_seams
from printer_slicer.ordering.spiral import for_spiral, spiralled, turns_of_spiral
from printer_slicer.ordering.units import Units, inner_loops, units_of
from printer_slicer.ordering.walls import clustered
from printer_slicer.profile import Profile

__all__ = ["for_spiral", "order"]


def order(paths: Toolpaths, sections: Sections, profile: Profile) -> Toolpaths:
    """The same paths in printing order; open ones may be turned around, loops begin at their seam.

    Raises:
        PartError: a spiral is asked for, and a layer does not have one outline.
    """
    if paths.n_paths == 0:
        return paths
    if profile.quality.spiral:
        return spiralled(_ordered(turns_of_spiral(paths, profile), sections, profile), profile)
    return scarfed(broken(_ordered(paths, sections, profile)), profile)


def _ordered(paths: Toolpaths, sections: Sections, profile: Profile) -> Toolpaths:
    paths = with_seams(closed_up(paths), profile)
    island = _islands(paths, sections.solid)
    paths, clusters = clustered(begun_toward_seams(paths, island, profile), inner_loops(paths), profile)
    units = units_of(paths, island, clusters, profile)
    ordered = _printed(paths, units, *routed(units))
    return begun_nearby(ordered, profile)


def _islands(paths: Toolpaths, solid: Areas) -> Int:
    """(M,) for each path the outer ring of its layer that it lies in; paths outside all of them share one island."""
    island = np.zeros(paths.n_paths, np.int64)
    outlines = solid.select(solid.ring_area() > 0)
    many = np.flatnonzero(np.diff(outlines.layer_start) > 1)
    member = np.isin(paths.layer, many)
    if member.any():
        found = rings_around(outlines, paths.xy[paths.start[:-1]][member], paths.layer[member])
        island[member] = np.where(found < 0, outlines.n_rings, found)
    return island


def _printed(paths: Toolpaths, units: Units, taken: Int, turned: Bool) -> Toolpaths:
    """The paths of units `taken` (U,), those that are `turned` (U,) from their end to their beginning."""
    size = np.diff(units.start)[taken]
    around = np.repeat(turned, size)
    step = consecutive(np.zeros_like(size), size)
    within = np.where(around, np.repeat(size, size) - 1 - step, step)
    path = units.path[np.repeat(units.start[taken], size) + within]
    n_points = np.diff(paths.start)[path]
    owner, at = np.repeat(np.arange(len(path)), n_points), consecutive(np.zeros_like(n_points), n_points)
    back = around[owner]
    first = paths.start[path][owner]
    point = first + np.where(back, n_points[owner] - 1 - at, at)
    some = paths.of_points(point, np.append(0, np.cumsum(n_points)), path)
    # What holds from a point to the next holds from the next to it in a path that is turned around.
    return replace(some, carried=paths.carried.take(np.where(back, np.maximum(point - 1, first), point)))
