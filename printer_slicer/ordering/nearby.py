"""Loops that may begin anywhere begin where the nozzle is."""

from __future__ import annotations

import numpy as np

from printer_slicer.model import Role, Toolpaths
from printer_slicer.ordering.loops import Loops, begun_at
from printer_slicer.profile import Profile

__all__ = ["begun_nearby"]


def begun_nearby(paths: Toolpaths, profile: Profile) -> Toolpaths:
    """Paths in printing order; with seams wherever it is nearest, loops of perimeters begin at their nearest point.

    Loops that go around everything, and inner ones that belong to no outer one, begin anywhere in any case.
    """
    perimeter = (paths.role == Role.INNER_PERIMETER) | (paths.role == Role.OUTER_PERIMETER)
    free = paths.closed & ((profile.quality.seam == "nearest") | ~perimeter)
    loops = Loops.of(paths, np.flatnonzero(free))
    if not loops.n_loops:
        return paths
    begin, end = paths.xy[paths.start[:-1]], paths.xy[paths.start[1:] - 1]
    after = np.where(paths.closed[:, None], begin, end)
    along = np.zeros(loops.n_loops)
    for index, path in enumerate(loops.path.tolist()):
        first, last = loops.start[index], loops.start[index + 1]
        gap = loops.xy[first:last] - (after[path - 1] if path else 0.0)
        point = first + int((gap * gap).sum(axis=1).argmin())
        along[index], after[path] = loops.reach[point], loops.xy[point]
    return begun_at(paths, loops, along)
