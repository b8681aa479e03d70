"""Where the nozzle goes while an object is printed, and the space that the finished object takes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from printer_slicer.arrays import Float, Int, distinct, frozen_array
from printer_slicer.geometry import Areas, convex_hull, normalize, simplify, union
from printer_slicer.model import Program, Sections, Supports
from printer_slicer.roles import Role
from printer_slicer.values import Struct, force_setattr

__all__ = ["ObjectExtent", "measure_extent"]

_LEVELS: Final = 24  # at most; between them, lower values are used
_TOLERANCE: Final = 0.01  # mm, of outlines
_ADHESION: Final = (Role.BRIM, Role.RAFT)


class ObjectExtent(Struct, frozen=True, eq=False):
    """An object that is printed as a whole, at several levels.

    Attributes:
        name: of the object, for messages.
        top: z of the highest extrusion, mm.
        nozzle_level: (N,) lowest z of the nozzle in each of N groups of moves, mm, ascending.
        nozzle: (N layers) convex hull of the nozzle positions of each group, mm.
        level: (K,) z, mm, ascending from 0.
        above: (K layers) everything that is printed above each level, seen from above, mm.
    """

    name: str
    top: float
    nozzle_level: Float
    nozzle: Areas
    level: Float
    above: Areas

    def __post_init__(self) -> None:
        for name, stack in (("nozzle_level", self.nozzle), ("level", self.above)):
            force_setattr(self, name, frozen_array(getattr(self, name), np.float64, (stack.n_layers,)))

    def find_levels(self, z: Float) -> Int:
        """Return the layer (n,) of `above` that has everything printed above the heights z (n,), mm."""
        return np.searchsorted(self.level, z + 1e-6, side="right") - 1


def measure_extent(
    name: str, program: Program, sections: Sections, supports: Supports | None = None
) -> ObjectExtent:
    """Measure an object from its moves, its sections and its supports.

    Args:
        name: of the object.
        program: its moves, with those of its supports, brim and raft.
        sections: of the object, without a raft.
        supports: of the object.
    """
    lift = float(program.plan.top[-1] - sections.plan.top[-1])
    stacks = [(sections.solid, sections.plan.top + lift)]
    if supports is not None:
        stacks.append((supports.area, supports.plan.layers.top + lift))
    stacks += _list_hulls_of_adhesion(program)
    top = float(program.xyz[program.role != Role.TRAVEL, 2].max(initial=0.0))
    level = _choose_levels(np.concatenate([tops for _, tops in stacks]), top)
    nozzle_level, nozzle = _find_nozzle_hulls(program)
    return ObjectExtent(name, top, nozzle_level, nozzle, level, _stack_areas_above(stacks, level))


def _list_hulls_of_adhesion(program: Program) -> list[tuple[Areas, Float]]:
    """Return the convex hull of brim and raft, and its top."""
    beside = np.isin(program.role, _ADHESION)
    if not beside.any():
        return []
    hull = convex_hull(program.xyz[beside, :2])
    return [(hull, np.array([program.xyz[beside, 2].max()]))] if hull.n_rings else []


def _choose_levels(tops: Float, top: float) -> Float:
    """Return levels from 0 to below the top of an object, mm."""
    wanted = np.linspace(0, top, _LEVELS, endpoint=False)
    below = distinct(np.append(0.0, np.round(tops, 6)))
    return distinct(below[np.searchsorted(below, wanted + 1e-9, side="right") - 1])


def _stack_areas_above(stacks: Sequence[tuple[Areas, Float]], level: Float) -> Areas:
    """Return for each level (K,) the union of all areas with a top above it; `stacks` has areas and their tops."""
    parts = []
    for areas, tops in stacks:
        slab = np.searchsorted(level, tops - 1e-6) - 1
        kept = areas.of_layers(slab >= 0)
        parts.append(simplify(normalize(kept.on_layers(np.maximum(slab, 0), len(level))), _TOLERANCE))
    of_slab = normalize(Areas.merged(parts))
    stack = [of_slab.copy_layers(np.array([len(level) - 1]))]
    for lower in range(len(level) - 2, -1, -1):
        stack.append(union(stack[-1], of_slab.copy_layers(np.array([lower]))))
    placed = [one.on_layers(np.array([at]), len(level)) for at, one in enumerate(reversed(stack))]
    return Areas.concatenate(placed, len(level))


def _find_nozzle_hulls(program: Program) -> tuple[Float, Areas]:
    """Return the lowest z of groups of moves, and the convex hull of the nozzle positions of each group."""
    start = np.concatenate([program.xyz[:1], program.xyz[:-1]])  # the first move comes from above all objects
    low = np.minimum(start[:, 2], program.xyz[:, 2])
    edges = distinct(np.round(np.quantile(low, np.linspace(0, 1, _LEVELS), method="lower"), 6))
    group = np.maximum(np.searchsorted(edges, low + 1e-6, side="right") - 1, 0)
    rings, levels = [], []
    for number in distinct(group).tolist():
        here = group == number
        xy = np.concatenate([start[here, :2], program.xyz[here, :2]])
        rings.append([_make_hull(xy)])
        levels.append(float(low[here].min()))
    return np.array(levels), Areas.from_rings(rings)


def _make_hull(xy: Float) -> Float:
    """Return the corners (n, 2) of the convex hull of points; a tiny square around points without area."""
    hull = convex_hull(xy)
    if hull.n_rings:
        return hull.ring(0)
    (left, front), (right, back) = xy.min(axis=0) - _TOLERANCE, xy.max(axis=0) + _TOLERANCE
    return np.array([[left, front], [right, front], [right, back], [left, back]])
