"""Layer planners (Mesh -> LayerPlan), one module each, and the table of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final

from printer_slicer.model import LayerPlan, Mesh
from printer_slicer.planning.area import plan_area
from printer_slicer.planning.cusp import plan_cusp
from printer_slicer.planning.genetic import plan_genetic
from printer_slicer.planning.optimal import plan_optimal
from printer_slicer.planning.stepwise import plan_stepwise
from printer_slicer.planning.uniform import plan_uniform
from printer_slicer.profile import Profile

__all__ = ["PLANNERS", "Planner", "plan_layers"]

Planner = Callable[[Mesh, Profile], LayerPlan]
PLANNERS: Final[Mapping[str, Planner]] = {
    "uniform": plan_uniform,
    "area": plan_area,
    "cusp": plan_cusp,
    "stepwise": plan_stepwise,
    "genetic": plan_genetic,
    "optimal": plan_optimal,
}


def plan_layers(mesh: Mesh, profile: Profile) -> LayerPlan:
    """Plan layers with the planner that the profile selects.

    Args:
        mesh: the part, standing on z = 0.
        profile: `quality.planner` selects the planner and its settings.

    Raises:
        PlanError: the part is thinner than the thinnest layer.
    """
    return PLANNERS[str(profile.quality.planner.__struct_config__.tag)](mesh, profile)
