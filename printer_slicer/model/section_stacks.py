"""Combine the sections of several objects."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from printer_slicer.geometry import Areas, union
from printer_slicer.model.layers import LayerPlan, Sections

__all__ = ["fill_layers", "stack_sections"]


def stack_sections(sections: Sequence[Sections]) -> Sections:
    """Combine the sections of all objects on the union of their layers."""
    if len(sections) == 1:
        return sections[0]
    plan = LayerPlan.union([one.plan for one in sections])
    gaps = sorted((gap for one in sections for gap in one.gaps), key=lambda gap: -gap.width)
    turned = [
        one.inverted.on_layers(plan.find_tops(one.plan.top), plan.n_layers)
        for one in sections
        if one.inverted
    ]
    solid = sections[0].solid_at(plan)
    for one in sections[1:]:
        solid = union(solid, one.solid_at(plan))
    return Sections(
        plan,
        solid,
        sum(one.open_edges for one in sections),
        tuple(gaps),
        Areas.merged(turned) if turned else None,
    )


def fill_layers(sections: Sequence[Sections]) -> Sections:
    """Combine the sections of all objects so that each layer has what is solid between its top and the one below.

    In contrast to `stack_sections`, layers do not overlap, and a thick layer of one object appears in all layers that
    another object has at its height.
    """
    plan = LayerPlan.union([one.plan for one in sections])
    if all(one.plan.n_layers == plan.n_layers for one in sections):
        return stack_sections(sections)
    solid = Areas.empty(plan.n_layers)
    for one in sections:
        layer = one.plan.find_tops(plan.top)
        within = np.flatnonzero(layer < one.plan.n_layers)
        solid = union(solid, one.solid.copy_layers(layer[within]).on_layers(within, plan.n_layers))
    return Sections(LayerPlan.from_tops(plan.top), solid)
