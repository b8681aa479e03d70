"""Regions for infill tests, with the same areas on every layer of an uneven plan, and measurements of paths."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely

from printer_slicer import bead
from printer_slicer.arrays import Float
from printer_slicer.model import Areas, LayerPlan, Mesh, Regions, Toolpaths
from printer_slicer.roles import Role
from printer_slicer.stages import Stages
from tests.parts import box, joined, shape

__all__ = [
    "SOLID_ROLES", "UNEVEN", "WIDTH", "lengths", "outside", "rectangle", "rows", "slots", "solid_only", "sparse_only",
    "sparse_stack", "volumes",
]  # fmt: skip

WIDTH = 0.45
UNEVEN = np.array([0.1, 0.42, 0.5, 0.82, 1.0, 1.32])
SOLID_ROLES = (Role.BRIDGE, Role.BOTTOM_SOLID_INFILL, Role.SOLID_INFILL, Role.TOP_SOLID_INFILL)


def rectangle(x: float, y: float, at: tuple[float, float] = (0.0, 0.0)) -> Float:
    return np.array([(0, 0), (x, 0), (x, y), (0, y)], dtype=np.float64) + np.array(at)


def sparse_stack(rings: Sequence[Sequence[Float]], tops: Float = UNEVEN) -> Regions:
    """The rings of every layer, all of them sparse."""
    plan = LayerPlan.from_tops(tops)
    none = Areas.empty(plan.n_layers)
    area = Areas.from_rings([list(one) for one in rings])
    return Regions(plan, none, none, none, none, area, np.zeros(0))


def sparse_only(rings: Sequence[Float], tops: Float = UNEVEN) -> Regions:
    """The same area on every layer, all of it sparse."""
    return sparse_stack([rings for _ in tops], tops)


def solid_only(rings: Sequence[Float], role: Role = Role.SOLID_INFILL, tops: Float = UNEVEN) -> Regions:
    sparse = sparse_only(rings, tops)
    areas = {one: sparse.internal_infill if one == role else Areas.empty(len(tops)) for one in SOLID_ROLES}
    return Regions(
        sparse.plan,
        areas[Role.BOTTOM_SOLID_INFILL],
        areas[Role.BRIDGE],
        areas[Role.TOP_SOLID_INFILL],
        areas[Role.SOLID_INFILL],
        Areas.empty(len(tops)),
        np.zeros(areas[Role.BRIDGE].n_rings),
    )


def _each(paths: Toolpaths) -> Float:
    """(M,) mm of each path."""
    long = []
    for i in range(paths.n_paths):
        xy = paths.path(i)
        xy = np.concatenate([xy, xy[:1]]) if paths.closed[i] else xy
        long.append(float(np.hypot(*np.diff(xy, axis=0).T).sum()))
    return np.array(long, dtype=np.float64)


def lengths(paths: Toolpaths) -> Float:
    """(L,) mm of path on each layer."""
    return np.bincount(paths.layer, _each(paths), minlength=paths.plan.n_layers).astype(np.float64)


def volumes(paths: Toolpaths) -> Float:
    """(L,) mm³ of the beads of each layer, as wide and high as they are."""
    owner = np.repeat(np.arange(paths.n_paths), np.diff(paths.start))
    long = np.hypot(*(paths.xy[paths.following] - paths.xy).T)
    wide = (paths.width + paths.width[paths.following]) / 2
    laid = long * bead.cross_section(wide, paths.height[owner])
    return np.bincount(paths.layer[owner], laid, paths.plan.n_layers).astype(np.float64)


def rows(paths: Toolpaths, layer: int, angle: float) -> Float:
    """Where the lines of a layer in this direction lie, across it."""
    across = np.array([-np.sin(angle), np.cos(angle)])
    along = np.array([np.cos(angle), np.sin(angle)])
    places = []
    for i in np.flatnonzero(paths.layer == layer):
        xy = paths.path(int(i))
        step = np.diff(xy, axis=0)
        straight = np.abs(step @ along) > 0.999999 * np.hypot(*step.T)
        places += (xy[:-1][straight] @ across).tolist()
    return np.unique(np.round(places, 4))


def slots(width: float, depth: float) -> Mesh:
    """A block of 30 x 20 with a slot open to one side."""
    left, right = box((14, 20, 2)), box((16 - width, 20, 2), (14 + width, 0, 0))
    return joined([left, right, box((width, 20 - depth, 2), (14, 0, 0))], "slot")


def outside(stages: Stages) -> float:
    """mm of infill outside the sections."""
    paths, length = stages.toolpaths, 0.0
    for layer in range(stages.sections.plan.n_layers):
        here = np.flatnonzero(
            (paths.layer == layer) & np.isin(paths.role, (*SOLID_ROLES, Role.INTERNAL_INFILL))
        )
        lines = [shapely.LineString(paths.path(int(i))) for i in here]
        section = shape(stages.sections.solid, layer)
        length += sum(float(shapely.length(shapely.difference(line, section))) for line in lines)
    return length
