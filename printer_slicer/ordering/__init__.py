"""Order paths for printing: sequence, direction and start points of loops (Toolpaths -> Toolpaths).

Skirt, brim, raft loops and supports come first, then island by island. Within an island, each external perimeter is
printed together with its inner perimeters, before or after the infill. Bridges come before extrusions that rest on
them, top solid infill last. Paths without a fixed order are sorted for short travels.
"""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Bool, Int, consecutive
from printer_slicer.geometry import find_enclosing_rings
from printer_slicer.model import Areas, Sections, Toolpaths
from printer_slicer.ordering.line_splitting import split_lines
from printer_slicer.ordering.loop_starts import start_near_nozzle, start_near_seams
from printer_slicer.ordering.loops import close_loops
from printer_slicer.ordering.route import route_units
from printer_slicer.ordering.scarf import add_scarfs
from printer_slicer.ordering.seams import place_seams
from printer_slicer.ordering.spiral import apply_spiral_settings, make_spiral, select_spiral_paths
from printer_slicer.ordering.units import Units, find_inner_loops, group_units
from printer_slicer.ordering.walls import cluster_walls
from printer_slicer.profile import Profile

__all__ = ["apply_spiral_settings", "order"]


def order(
    paths: Toolpaths, sections: Sections, profile: Profile, is_contoured: Bool | None = None
) -> Toolpaths:
    """Return the paths in printing order; open paths may be reversed, and loops start at their seam.

    Args:
        paths: all paths.
        sections: the islands of the layers.
        profile: order and seams.
        is_contoured: (M,) mask of the paths that will follow the surface. Their walls are printed from the outside in,
            which is from low to high, before infill, and without scarf seams. Default: none.

    Raises:
        PartError: spiral mode is on, and a layer does not have exactly one outline.
    """
    if paths.n_paths == 0:
        return paths
    if profile.quality.spiral:
        paths = select_spiral_paths(paths, profile)
    # Each step replaces `paths`, so that the memory of the paths before it is released.
    if is_contoured is None:
        is_contoured = np.zeros(paths.n_paths, np.bool_)
    paths = close_loops(paths)
    paths = place_seams(paths, profile)
    island = _find_islands(paths, sections.solid)
    paths = start_near_seams(paths, island, profile)
    paths, clusters = cluster_walls(paths, find_inner_loops(paths), profile, is_contoured)
    units = group_units(paths, island, clusters, profile, is_contoured)
    paths, former = _apply_order(paths, units, *route_units(units))
    paths = start_near_nozzle(paths, profile)
    if profile.quality.spiral:
        return make_spiral(paths, profile)
    flat_loops = ~is_contoured[former][paths.closed]
    paths = split_lines(paths)
    return add_scarfs(paths, profile, np.flatnonzero(paths.closed)[flat_loops])


def _find_islands(paths: Toolpaths, solid: Areas) -> Int:
    """Return the island (M,) of each path: an outer ring of its layer; paths outside all rings share one number."""
    island = np.zeros(paths.n_paths, np.int64)
    outlines = solid.select(solid.ring_area() > 0)
    many = np.flatnonzero(np.diff(outlines.layer_start) > 1)
    member = np.isin(paths.layer, many)
    if member.any():
        found = find_enclosing_rings(outlines, paths.xy[paths.start[:-1]][member], paths.layer[member])
        island[member] = np.where(found < 0, outlines.n_rings, found)
    return island


def _apply_order(paths: Toolpaths, units: Units, sequence: Int, is_reversed: Bool) -> tuple[Toolpaths, Int]:
    """Return the paths of the units in the order `sequence` (U,), and their former indices.

    Paths of units `is_reversed` (U,) run backward.
    """
    size = np.diff(units.start)[sequence]
    around = np.repeat(is_reversed, size)
    step = consecutive(np.zeros_like(size), size)
    within = np.where(around, np.repeat(size, size) - 1 - step, step)
    path = units.path[np.repeat(units.start[sequence], size) + within]
    return paths.arrange(path, around), path
