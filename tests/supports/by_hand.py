"""Overhangs and layers of supports as simple as they can be, for tests of what is built on them."""

from __future__ import annotations

from functools import cache

import numpy as np

from printer_slicer.geometry import difference, intersection, offset, offset_open, split_connected, union
from printer_slicer.model import Areas, LayerPlan, Mesh, Overhangs, Sections, SupportPlan
from printer_slicer.slicing import cut
from tests.parts import layers

__all__ = ["overhangs_of", "prepared", "support_plan"]

_STEEPEST = 40.0  # degrees


def overhangs_of(sections: Sections) -> Overhangs:
    """All strips of slopes flatter than 40 degrees, and pieces that lie over nothing at all."""
    plan, solid = sections.plan, sections.solid
    step = np.diff(plan.cut, prepend=0.0) / np.tan(np.radians(_STEEPEST))
    below = solid.shift_layers(1)
    steep = offset_open(difference(solid, offset(below, step + 0.001)), 0.01)
    strips = intersection(difference(solid, below), offset(steep, step)).of_layers(
        np.arange(1, plan.n_layers)
    )
    pieces = split_connected(solid)
    carried = intersection(pieces.areas, pieces.select_nearby_rings(below)).area()
    islands = pieces.on_layers(plan.n_layers, np.flatnonzero((carried < 1e-3) & (pieces.layer > 0)))
    area = union(strips, islands)
    none = Areas.empty(plan.n_layers)
    return Overhangs(
        plan, area, np.zeros(area.n_rings, np.int64), islands, none, area.area() > 0.2 * area.area().sum()
    )


def support_plan(overhangs: Overhangs, gap: float = 0.2) -> SupportPlan:
    """Support layers as high as those of the part, up to the highest contact."""
    plan = overhangs.plan
    hanging = np.flatnonzero(overhangs.area.used)
    below = np.searchsorted(plan.top, plan.bottom[hanging] - gap + 1e-6) - 1
    carrier, distance = np.full(plan.n_layers, -1), np.full(plan.n_layers, np.nan)
    carrier[hanging] = below
    found = hanging[below >= 0]
    distance[found] = plan.bottom[found] - plan.top[carrier[found]]
    return SupportPlan(LayerPlan.from_tops(plan.top[: carrier.max(initial=-1) + 1]), carrier, distance)


@cache
def prepared(mesh: Mesh, height: float = 0.2) -> tuple[Overhangs, SupportPlan, Sections]:
    """What the stages of supports take, of a part in layers of equal height."""
    sections = cut(mesh, layers(round(float(mesh.bounds[1][2]) / height), height), 0.0125)
    overhangs = overhangs_of(sections)
    return overhangs, support_plan(overhangs), sections
