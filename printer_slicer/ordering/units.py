"""Group paths into units that are printed without interruption: wall clusters, chains, and single paths."""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, distinct
from printer_slicer.model import Toolpaths
from printer_slicer.ordering.walls import WallClusters
from printer_slicer.profile import Profile
from printer_slicer.roles import ROLES, Phase, Role, roles_with
from printer_slicer.values import Struct

__all__ = ["Units", "find_inner_loops", "group_units"]

_HIGHER = 1e-3  # mm


class Units(Struct, frozen=True, eq=False):
    """Groups of paths that are printed without interruption (units), sorted by layer, island and step.

    Attributes:
        path: (M,) indices of all paths, unit by unit.
        start: (U + 1,) unit `i` has the paths `path[start[i]:start[i + 1]]`.
        layer: (U,) ascending.
        island: (U,) ascending within a layer; -1 for skirt, brim, raft loops and supports.
        step: (U,) ascending within an island.
        begin: (U, 2) start point, mm.
        end: (U, 2) end point, mm.
        free: (U,) which units may be reversed.
    """

    path: Int
    start: Int
    layer: Int
    island: Int
    step: Int
    begin: Float
    end: Float
    free: Bool

    @property
    def n_units(self) -> int:
        """Number of units."""
        return len(self.layer)


def find_inner_loops(paths: Toolpaths) -> Int:
    """Return the indices of the inner perimeters that are closed and one layer high."""
    return np.flatnonzero(paths.closed & (paths.role == Role.PERIMETER) & ~_is_combined(paths))


def group_units(
    paths: Toolpaths, island: Int, clusters: WallClusters, profile: Profile, is_contoured: Bool
) -> Units:
    """Group paths into units; `island` (M,) is the island of each path.

    In islands with a path of the mask `is_contoured` (M,), perimeters come before infill.
    """
    n = paths.n_paths
    around = roles_with(is_around=True)[paths.role] & (paths.closed | (paths.role != Role.RAFT))
    place = np.where(around, -1, island)
    steps = _assign_steps(paths, infill_first=profile.quality.infill_first)
    if profile.quality.infill_first and is_contoured.any():
        key = paths.layer * (int(island.max()) + 1) + island
        walls_first = np.isin(key, distinct(key[is_contoured]))
        steps[walls_first] = _assign_steps(paths, infill_first=False)[walls_first]
    step = np.where(around, np.arange(n), steps)
    # Supports are printed before the part, bases before interfaces, each in the order of short travels.
    carries = roles_with(is_support=True)[paths.role]
    step[carries] = n + (paths.role[carries] == Role.SUPPORT_INTERFACE)
    # Paths with the same number form a unit: their own number, or that of a cluster or a chain.
    number, turn = np.arange(n), np.arange(n)
    number[clusters.path], turn[clusters.path] = clusters.cluster, clusters.turn
    place[clusters.path], step[clusters.path] = place[clusters.cluster], step[clusters.cluster]
    sweep_areas = paths.chain_id >= 0
    number[sweep_areas] = n + paths.chain_id[sweep_areas]
    order = np.lexsort((turn, number, step, place, paths.layer))
    begins = np.diff(number[order], prepend=-1) != 0
    start = np.append(np.flatnonzero(begins), n)
    first, last = order[start[:-1]], order[start[1:] - 1]
    ends = np.where(paths.closed, paths.start[:-1], paths.start[1:] - 1)
    return Units(
        order,
        start,
        paths.layer[first],
        place[first],
        step[first],
        paths.xy[paths.start[:-1][first]],
        paths.xy[ends[last]],
        ~paths.closed[first] & ((np.diff(start) == 1) | sweep_areas[first]),
    )


def _assign_steps(paths: Toolpaths, *, infill_first: bool) -> Int:
    """Return the step of each path (M,), which gives the order within an island."""
    walls, fill = (3, 1) if infill_first else (0, 3)
    step = {
        Phase.BASE: 0,
        Phase.PERIMETERS: walls + 1,
        Phase.BRIDGES: fill + 1,
        Phase.INFILL: fill + 2,
        Phase.TOP: 7,
        Phase.IRONING: 8,
    }
    of = np.array([step[row.phase] for row in ROLES])[paths.role]
    # Combined perimeters fill the gap of several layers, so they come after the perimeters around it.
    of[_is_combined(paths)] = walls + 2
    # Open perimeters are printed like infill, after the loops.
    of[(paths.role == Role.PERIMETER) & ~paths.closed] = walls + 2 if infill_first else fill + 2
    return of


def _is_combined(paths: Toolpaths) -> Bool:
    """Return which paths (M,) are perimeters that combine several layers in one extrusion."""
    higher = paths.height > paths.plan.height[paths.layer] + _HIGHER
    return np.asarray(higher & (paths.role == Role.PERIMETER))
