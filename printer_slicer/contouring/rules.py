"""The rule of contouring that a profile asks for."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from printer_slicer.arrays import Float
from printer_slicer.contouring.z_profiles import Z_TOLERANCE
from printer_slicer.model import ContourRule, LayerPlan, ObjectStack
from printer_slicer.profile import Profile
from printer_slicer.surface import layer_bounds, read_surface
from printer_slicer.values import replace

__all__ = ["add_contour_rule", "find_tops_to_level", "level_layers", "make_contour_rule"]

_ROUNDING: Final = 1e-7  # mm
_HALF: Final = 0.5  # of a step of the z axis, to which z is rounded


def make_contour_rule(profile: Profile) -> ContourRule | None:
    """Return where extrusions follow shallow upper surfaces; None if they do not.

    They do not if the sections are larger or smaller than the part on purpose (`quality.containment`).
    """
    quality = profile.quality
    if not quality.z_contouring or quality.containment != "mid":
        return None
    return ContourRule(
        quality.contour_min_height,
        profile.extrusion_width,
        float(np.tan(np.deg2rad(quality.contour_max_slope_deg))),
        Z_TOLERANCE + _HALF * profile.printer.z_step,
        profile.printer.nozzle_flat,
    )


def add_contour_rule(plan: LayerPlan, profile: Profile) -> LayerPlan:
    """Return a plan that was made without the rule of a profile, with this rule."""
    return replace(plan, contour_rule=make_contour_rule(profile)) if plan.containment == "mid" else plan


def find_tops_to_level(stack: ObjectStack, tolerance: Float) -> list[float]:
    """Return the tops, mm, of the layers of a stack whose printed extrusions do not keep the tolerance (L,), mm.

    With level tops, they do.
    """
    plan = stack.plan
    if stack.contours is None or plan.contour_rule is None:
        return []
    beyond = stack.contours.deviation > tolerance + _ROUNDING
    if not beyond.any():
        return []
    level = layer_bounds(read_surface(stack.mesh), replace(plan, contour_rule=None))
    return [float(top) for top in plan.top[beyond & (level <= tolerance + _ROUNDING)]]


def level_layers(plan: LayerPlan, tops: Sequence[float]) -> LayerPlan:
    """Return a plan in which the layers with these tops, mm, are not contoured, nor those that were not before."""
    rule = plan.contour_rule
    if rule is None:
        return plan
    return replace(plan, contour_rule=replace(rule, level_tops=(*rule.level_tops, *tops)))
