"""Layer planners (Mesh -> LayerPlan), one module each, and the table of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final

from printer_slicer.lazy_names import LazyTable
from printer_slicer.model import LayerPlan, Mesh
from printer_slicer.profile import Profile

__all__ = ["PLANNERS", "Planner", "plan_layers"]

Planner = Callable[[Mesh, Profile], LayerPlan]
PLANNERS: Final[Mapping[str, Planner]] = LazyTable(
    __name__,
    {name: f"{name}.plan_{name}" for name in ("uniform", "area", "cusp", "stepwise", "genetic", "optimal")},
)


def plan_layers(mesh: Mesh, profile: Profile) -> LayerPlan:
    """Plan layers with the planner that the profile selects.

    Args:
        mesh: the part, standing on z = 0.
        profile: `quality.planner` selects the planner and its settings.

    Raises:
        PlanError: the part is thinner than the thinnest layer.
    """
    return PLANNERS[str(profile.quality.planner.__struct_config__.tag)](mesh, profile)
