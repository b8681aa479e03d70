"""Join the layers of supports with those of the part."""

from __future__ import annotations

import numpy as np

from printer_slicer.geometry import Areas, union
from printer_slicer.model import LayerPlan, Sections, Supports
from printer_slicer.values import replace

__all__ = ["add_support_areas", "add_support_layers", "make_obstacles"]


def add_support_layers(sections: Sections, supports: Supports | None) -> Sections:
    """Return the part on all layers that are printed: its own, and those of its supports.

    In a layer that only supports have, the part is as high as its layer below, so it has the section of that layer.
    """
    if supports is None or not supports.plan.layers.n_layers:
        return sections
    part = sections.plan
    plan = LayerPlan.union([part, supports.plan.layers])
    own = plan.find_tops(part.top)
    bottom = plan.bottom
    bottom[own] = part.bottom  # where both end, paths of the part are compared with its own layers
    plan = replace(plan, base=bottom, planner=part.planner, containment=part.containment)
    layer = np.searchsorted(own, np.arange(plan.n_layers), side="right") - 1
    areas = sections.solid.copy_layers(np.maximum(layer, 0)).of_layers(layer >= 0)
    inverted = None if sections.inverted is None else sections.inverted.on_layers(own, plan.n_layers)
    gaps = tuple(replace(gap, layer=int(own[gap.layer])) for gap in sections.gaps)
    return replace(sections, plan=plan, solid=areas, inverted=inverted, gaps=gaps)


def add_support_areas(printed: Sections, supports: Supports | None, lift: float) -> Sections:
    """Return sections with the areas of supports, which are raised by `lift` mm, for what surrounds both."""
    if supports is None or not supports.plan.layers.n_layers:
        return printed
    layer = printed.plan.find_tops(supports.plan.layers.top + lift)
    areas = supports.area.on_layers(layer, printed.plan.n_layers)
    first = np.arange(1)
    rest = np.arange(1, printed.plan.n_layers)
    on_bed = union(printed.solid.of_layers(first), areas.of_layers(first))
    others = printed.solid.of_layers(rest).merge(areas.of_layers(rest))
    return replace(printed, solid=Areas.merged([on_bed, others]))


def make_obstacles(supports: Supports) -> Sections:
    """Return supports as sections, so that other supports avoid them as they avoid the part."""
    return Sections(supports.plan.layers, supports.area)
