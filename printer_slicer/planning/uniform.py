"""Uniform layers.

Guarantee: the layers cover the part, and the last one ends within a z step of its top. Cost: none.
"""

from __future__ import annotations

import numpy as np

from printer_slicer.model import LayerPlan, Mesh
from printer_slicer.planning.z_steps import ZSteps, fill_with_layers
from printer_slicer.profile import Profile

__all__ = ["plan_uniform"]


def plan_uniform(mesh: Mesh, profile: Profile) -> LayerPlan:
    """Plan layers of `quality.layer_height` above a first layer of `quality.first_layer_height`.

    The last layer has the height that is left.

    Args:
        mesh: the part, standing on z = 0.
        profile: the settings named above, and the printer's limits.

    Raises:
        PlanError: the part is thinner than the thinnest layer.
    """
    steps = ZSteps(mesh, profile)
    first, rest = steps.split_first_layer()
    layers = fill_with_layers(rest, steps.to_steps(profile.quality.layer_height), steps.lowest, steps.highest)
    return steps.make_plan(np.concatenate([[first] if first else [], layers]).astype(np.int64), "uniform")
