"""Change layers whose contoured extrusions do not keep the tolerance: make their tops level, or divide them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from printer_slicer.arrays import Float
from printer_slicer.contouring import find_inexact_layers, level_layers
from printer_slicer.model import LayerPlan, Mesh, ObjectStack
from printer_slicer.model.layers import SAME_TOP
from printer_slicer.planning.z_steps import ZSteps, layer_tolerances
from printer_slicer.profile import Profile
from printer_slicer.values import replace

__all__ = ["change_inexact_layers", "divide_layers"]


def change_inexact_layers(stacks: Sequence[ObjectStack], profile: Profile) -> list[ObjectStack] | None:
    """Return stacks without the layers that break the tolerance; None if there are none, or none that can be changed.

    Layers that keep the tolerance with level tops get them, at first only around the places that break it. Thicker ones
    are divided, but not those of features, whose plans share layers.

    Args:
        stacks: as they are printed.
        profile: gives the tolerance and the allowed heights.
    """
    changed = [_change_stack(one, profile) for one in stacks]
    is_same = all(new.plan is old.plan for new, old in zip(changed, stacks, strict=True))
    return None if is_same else changed


def _change_stack(stack: ObjectStack, profile: Profile) -> ObjectStack:
    """Return a stack without the layers that break the tolerance; the same one if none can be changed."""
    plan = stack.plan
    places, level, thick = find_inexact_layers(stack, layer_tolerances(profile, plan.bottom, plan.top))
    if thick and stack.whole_plan is None:
        divided = divide_layers(plan, thick, stack.mesh, profile)
        plan = divided if divided.n_layers > plan.n_layers else plan
    return replace(stack, plan=level_layers(plan, level, places))


def divide_layers(plan: LayerPlan, tops: Sequence[float], mesh: Mesh, profile: Profile) -> LayerPlan:
    """Return a plan in which each of some layers is two layers, as equal as the allowed heights permit.

    Layers that the printer cannot divide stay as they are, and so do those in height ranges with their own layer
    height.

    Args:
        plan: made for this part.
        tops: of the layers to divide, mm.
        mesh: the part, standing on z = 0.
        profile: allowed heights and ranges.
    """
    steps = ZSteps(mesh, profile)
    heights = list[int]()
    for bottom, top, height in zip(plan.bottom, plan.top, plan.height, strict=True):
        parts: tuple[int, ...] = (steps.to_steps(height),)
        chosen = np.abs(np.array(tops) - top).min(initial=np.inf) < SAME_TOP
        if chosen and not _has_own_height(bottom, top, profile):
            parts = _divide_height(parts[0], steps)
        heights.extend(parts)
    made = steps.make_plan(np.array(heights, np.int64), plan.planner)
    return LayerPlan(made.top, made.cut, plan.planner, plan.containment, contour_rule=plan.contour_rule)


def _has_own_height(bottom: Float, top: Float, profile: Profile) -> bool:
    """Return whether a layer between two heights, mm, is in a height range with its own layer height."""
    return any(one.layer_height and bottom < one.high and top > one.low for one in profile.dials.ranges)


def _divide_height(height: int, steps: ZSteps) -> tuple[int, ...]:
    """Return two heights with this sum, in z steps, or only this height if none can be printed."""
    if height < 2 * steps.lowest:
        return (height,)
    listed = steps.allowed[np.isin(height - steps.allowed, steps.allowed)]
    lower = int(listed[np.abs(2 * listed - height).argmin()]) if len(listed) else height // 2
    return lower, height - lower
