"""What only slicing shows: unsupported extrusion, and settings without effect, as facts and as warnings."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, Final

from printer_slicer.facts.overhangs import list_blocked_island_warnings, list_unused_volume_warnings
from printer_slicer.inspection.deposition.unsupported import UnsupportedExtrusion, describe_unsupported
from printer_slicer.model import LayerPlan, Mesh
from printer_slicer.profile import Profile
from printer_slicer.profile.object_profiles import list_height_overrides, list_support_styles
from printer_slicer.profile.planners import OptimalPlanner
from printer_slicer.stages import Stages

__all__ = [
    "choose_unsupported_remedy",
    "list_planning_warnings",
    "list_slicing_warnings",
    "list_unsupported_facts",
]

_SUPPORTING: Final = "print supports (support = auto)"
_COARSE_Z_STEP: Final = 0.02  # mm


def list_slicing_warnings(
    stages: Stages,
    profile: Profile,
    unsupported: Sequence[UnsupportedExtrusion],
    *,
    supporting: str = _SUPPORTING,
    acceptance: str = "",
) -> list[str]:
    """Return the warnings that only slicing shows.

    Args:
        stages: the sliced part.
        profile: the profile used for slicing.
        unsupported: unsupported extrusion of the program.
        supporting: how the user can print supports.
        acceptance: how the user can accept unsupported extrusion, if at all.
    """
    return [
        *_list_unsupported_warnings(unsupported, profile, supporting, acceptance),
        *list_blocked_island_warnings(stages),
        *list_unused_volume_warnings(stages, profile),
        *_list_unused_range_warnings(profile, stages.sections.plan),
        *_list_contouring_warnings(profile, stages.sections.plan),
        *list_planning_warnings(stages.part, profile),
    ]


def list_planning_warnings(part: Mesh, profile: Profile) -> list[str]:
    """Return the warnings about settings of the planner that have no effect on a part."""
    planner = profile.quality.planner
    if not isinstance(planner, OptimalPlanner) or planner.stacks != "features":
        return []
    from printer_slicer.feature_stacks import explain_unused_features  # noqa: PLC0415 - off by default

    problem = explain_unused_features(part)
    return [problem] if problem else []


def _list_unsupported_warnings(
    found: Sequence[UnsupportedExtrusion], profile: Profile, supporting: str, acceptance: str
) -> list[str]:
    """Return a warning if unsupported extrusion was found; otherwise an empty list."""
    if not found:
        return []
    accepted = f", or {acceptance}" if acceptance else ""
    return [f"{describe_unsupported(found)}; {choose_unsupported_remedy(profile, supporting)}{accepted}"]


def choose_unsupported_remedy(profile: Profile, supporting: str = _SUPPORTING) -> str:
    """Return what helps against unsupported extrusion; supports are named only if there are none."""
    return f"rotate the part, {supporting}" if list_support_styles(profile) == {"off"} else "rotate the part"


def list_unsupported_facts(found: Sequence[UnsupportedExtrusion]) -> list[dict[str, Any]]:
    """Return the facts about unsupported extrusion for JSON: one entry per height, lengths in mm."""
    return [
        {
            "code": "unsupported",
            "severity": "warning",
            "layer": one.layer,
            "z": round(one.z, 4),
            "x": round(one.x, 3),
            "y": round(one.y, 3),
            "length_mm": round(one.length, 3),
        }
        for one in found
    ]


def _list_unused_range_warnings(profile: Profile, plan: LayerPlan) -> Iterator[str]:
    """Yield a warning for each height range that lies above the part, because its settings have no effect."""
    top = float(plan.top[-1])
    for low, high, own in list_height_overrides(profile):
        if low >= top:
            names = ", ".join(own)
            yield f"the range from {low:g} to {high:g} mm ({names}) is above the part, which is {top:g} mm high"


def _list_contouring_warnings(profile: Profile, plan: LayerPlan) -> Iterator[str]:
    """Yield a warning if contoured tops cannot be as smooth as they should, or if there can be none."""
    if not profile.quality.z_contouring:
        return
    if plan.containment != "mid":
        yield f"z_contouring has no effect with containment = {plan.containment}: sections must not be lowered"
    elif profile.printer.z_step > _COARSE_Z_STEP:
        step = profile.printer.z_step
        yield (
            f"z_contouring: the Z axis moves in steps of {step:g} mm (printer.z_step), and contoured tops show them; "
            f"it is made for steps up to {_COARSE_Z_STEP:g} mm"
        )
