"""Move the start of loops without a fixed seam close to the previous position of the nozzle."""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Int
from printer_slicer.model import Toolpaths
from printer_slicer.ordering.loops import Loops, start_loops_at
from printer_slicer.ordering.seams import find_external_loops
from printer_slicer.profile import Profile
from printer_slicer.roles import is_perimeter

__all__ = ["start_near_nozzle", "start_near_seams"]


def start_near_seams(paths: Toolpaths, island: Int, profile: Profile) -> Toolpaths:
    """Start free loops at their point nearest to the seam of the longest external loop of their island."""
    outer = find_external_loops(paths)
    loops = Loops.of(paths, _find_free_loops(paths, profile))
    if not len(outer) or not loops.n_loops:
        return paths
    n_islands = int(island.max()) + 1
    key = paths.layer[outer] * n_islands + island[outer]
    order = np.lexsort((-paths.length()[outer], key))
    outer, key = outer[order], key[order]
    wanted = loops.layer * n_islands + island[loops.path]
    found = np.minimum(np.searchsorted(key, wanted), len(key) - 1)
    some = np.flatnonzero(key[found] == wanted)
    along = np.zeros(loops.n_loops)
    along[some] = loops.nearest_vertices(some, paths.xy[paths.start[outer[found[some]]]])
    return start_loops_at(paths, loops, along)


def start_near_nozzle(paths: Toolpaths, profile: Profile) -> Toolpaths:
    """Start free loops at their point nearest to the end of the previous path; paths must be in printing order."""
    loops = Loops.of(paths, _find_free_loops(paths, profile))
    if not loops.n_loops:
        return paths
    start, end = paths.xy[paths.start[:-1]], paths.xy[paths.start[1:] - 1]
    after = np.where(paths.closed[:, None], start, end)
    along = np.zeros(loops.n_loops)
    for index, path in enumerate(loops.path.tolist()):
        first, last = loops.start[index], loops.start[index + 1]
        gap = loops.xy[first:last] - (after[path - 1] if path else 0.0)
        point = first + int((gap * gap).sum(axis=1).argmin())
        along[index], after[path] = loops.reach[point], loops.xy[point]
    return start_loops_at(paths, loops, along)


def _find_free_loops(paths: Toolpaths, profile: Profile) -> Int:
    """Return the loops that may start anywhere: loops other than perimeters, or all loops with `seam = nearest`."""
    return np.flatnonzero(paths.closed & ((profile.quality.seam == "nearest") | ~is_perimeter(paths.role)))
