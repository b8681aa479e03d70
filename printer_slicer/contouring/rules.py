"""The rule of contouring that a profile asks for."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from printer_slicer.arrays import Float
from printer_slicer.contouring.z_profiles import Z_TOLERANCE
from printer_slicer.model import ContourDeviations, ContourRule, LayerPlan, ObjectStack
from printer_slicer.profile import Profile, UniformPlanner
from printer_slicer.surface import layer_bounds, read_surface
from printer_slicer.values import replace

__all__ = ["add_contour_rule", "find_inexact_tops", "join_contours", "level_layers", "make_contour_rule"]

_ROUNDING: Final = 1e-7  # mm
_HALF: Final = 0.5  # of a step of the z axis, to which z is rounded


def make_contour_rule(profile: Profile) -> ContourRule | None:
    """Return where extrusions follow shallow upper surfaces; None if they do not.

    They do not if the sections are larger or smaller than the part on purpose (`quality.containment`), nor if the
    planner keeps a tolerance that is smaller than their deviation. Slopes are limited for the same reason.
    """
    quality = profile.quality
    if not quality.z_contouring or quality.containment != "mid":
        return None
    rule = ContourRule(
        quality.contour_min_height,
        profile.extrusion_width,
        float(np.tan(np.deg2rad(quality.contour_max_slope_deg))),
        Z_TOLERANCE + _HALF * profile.printer.z_step,
        profile.printer.nozzle_flat,
    )
    if isinstance(quality.planner, UniformPlanner):
        return rule
    own = (one.tolerance for one in profile.dials.ranges)
    return _limit_slopes(rule, min(quality.tolerance, *filter(None, own), np.inf))


def _limit_slopes(rule: ContourRule, tolerance: float) -> ContourRule | None:
    """Return a rule that only follows slopes where the deviation keeps a tolerance, mm; None if it follows none."""
    most = tolerance - rule.tolerance
    if most < rule.min_height / 2:
        return None
    sine = min(2 * most / rule.width, 1.0)
    return replace(rule, slope_limit=float(np.tan(np.arcsin(sine))))


def add_contour_rule(plan: LayerPlan, profile: Profile) -> LayerPlan:
    """Return a plan that was made without the rule of a profile, with this rule."""
    return replace(plan, contour_rule=make_contour_rule(profile)) if plan.containment == "mid" else plan


def find_inexact_tops(stack: ObjectStack, tolerance: Float) -> tuple[list[float], list[float]]:
    """Return the tops, mm, of the layers of a stack whose printed extrusions do not keep the tolerance (L,), mm.

    Those that keep it with level tops come first, and those that are too thick even then.
    """
    plan = stack.plan
    if stack.contours is None or plan.contour_rule is None:
        return [], []
    beyond = stack.contours.deviation > tolerance + _ROUNDING
    if not beyond.any():
        return [], []
    level = layer_bounds(read_surface(stack.mesh), replace(plan, contour_rule=None)) <= tolerance + _ROUNDING
    thick = beyond & ~level
    return plan.top[beyond & level].tolist(), plan.top[thick].tolist()


def join_contours(stack: ObjectStack, objects: Sequence[ObjectStack]) -> ObjectStack:
    """Return the stack of several objects with the contoured tops of all of them; a layer is level if one of them is.

    Args:
        stack: of the objects.
        objects: the stack of each object as it is printed.
    """
    rules = [one.plan.contour_rule for one in objects]
    tops = sorted({top for rule in rules if rule for top in rule.level_tops})
    contours = ContourDeviations.find_worst([one.contours for one in objects])
    return replace(stack, plan=level_layers(stack.plan, tops), contours=contours)


def level_layers(plan: LayerPlan, tops: Sequence[float]) -> LayerPlan:
    """Return a plan in which the layers with these tops, mm, are not contoured, nor those that were not before."""
    rule = plan.contour_rule
    if rule is None:
        return plan
    return replace(plan, contour_rule=replace(rule, level_tops=(*rule.level_tops, *tops)))
