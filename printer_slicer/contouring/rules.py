"""The rule of contouring that a profile asks for."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from printer_slicer.arrays import Float
from printer_slicer.contouring.z_profiles import Z_TOLERANCE
from printer_slicer.model import ContourDeviations, ContourRule, LayerPlan, ObjectStack
from printer_slicer.model.layers import SAME_TOP
from printer_slicer.profile import Profile, UniformPlanner
from printer_slicer.surface import layer_bounds, read_surface
from printer_slicer.values import replace

__all__ = [
    "InexactLayers",
    "add_contour_rule",
    "find_inexact_layers",
    "join_contours",
    "level_layers",
    "make_contour_rule",
]

_ROUNDING: Final = 1e-7  # mm
_PLACE_SPACING: Final = 0.25  # mm; places that are closer together count once
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


class InexactLayers(NamedTuple):
    """Layers whose extrusions exceed the tolerance of a plan, by what has to change.

    Attributes:
        places: layers that keep it if they are level around some places: tops, x and y, mm.
        level: tops of the layers that keep it only if they are level everywhere, mm.
        thick: tops of the layers that are too thick even then, mm.
    """

    places: list[tuple[float, float, float]]
    level: list[float]
    thick: list[float]


def find_inexact_layers(stack: ObjectStack, tolerance: Float) -> InexactLayers:
    """Find the layers of a stack whose printed extrusions exceed the tolerance (L,), mm.

    A layer is made level around the places where it does not, and everywhere if that was not enough.
    """
    plan, rule, contours = stack.plan, stack.plan.contour_rule, stack.contours
    if contours is None or rule is None:
        return InexactLayers([], [], [])
    beyond = contours.deviation > tolerance + _ROUNDING
    if not beyond.any():
        return InexactLayers([], [], [])
    level = layer_bounds(read_surface(stack.mesh), replace(plan, contour_rule=None)) <= tolerance + _ROUNDING
    partly = beyond & level & ~rule.find_partly_level(plan.top)
    places = _list_places(contours, plan.top, np.where(partly, tolerance, np.inf))
    partly &= np.isin(plan.top, [place[0] for place in places])
    return InexactLayers(
        places, plan.top[beyond & level & ~partly].tolist(), plan.top[beyond & ~level].tolist()
    )


def _list_places(
    contours: ContourDeviations, top: Float, tolerance: Float
) -> list[tuple[float, float, float]]:
    """Return the places of layers with tops (L,), mm, where extrusions do not keep the tolerance (L,), mm."""
    layer = np.searchsorted(contours.top, contours.larger[:, 0] - SAME_TOP)
    some = contours.larger[:, 3] > tolerance[layer] + _ROUNDING
    cell = np.round(contours.larger[some, 1:3] / _PLACE_SPACING) * _PLACE_SPACING
    return sorted({(float(top[one]), *place) for one, place in zip(layer[some], cell.tolist(), strict=True)})


def join_contours(stack: ObjectStack, objects: Sequence[ObjectStack]) -> ObjectStack:
    """Return the stack of several objects with the contoured tops of all of them; a layer is level if one of them is.

    Args:
        stack: of the objects.
        objects: the stack of each object as it is printed.
    """
    rules = [one.plan.contour_rule for one in objects]
    tops = sorted({top for rule in rules if rule for top in rule.level_tops})
    contours = ContourDeviations.find_worst([one.contours for one in objects])
    places = sorted({place for rule in rules if rule for place in rule.level_places})
    return replace(stack, plan=level_layers(stack.plan, tops, places), contours=contours)


def level_layers(
    plan: LayerPlan, tops: Sequence[float], places: Sequence[tuple[float, float, float]]
) -> LayerPlan:
    """Return a plan in which less is contoured than before.

    Args:
        plan: with the rule of contouring.
        tops: of layers that are not contoured, mm.
        places: tops of layers that are not contoured around a place, and x and y of the place, mm.
    """
    rule = plan.contour_rule
    if rule is None or not (tops or places):
        return plan
    rule = replace(rule, level_tops=(*rule.level_tops, *tops), level_places=(*rule.level_places, *places))
    return replace(plan, contour_rule=rule)
