"""Choose a layer plan within a time budget, using the time of the actual moves besides the planner's estimate."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, Protocol

import numpy as np

from printer_slicer.extrusion import move_seconds
from printer_slicer.model import LayerPlan, Mesh
from printer_slicer.planning import plan_layers
from printer_slicer.profile import Profile, profile_with
from printer_slicer.stages import Stages
from printer_slicer.strategies import Strategies, check_plan
from printer_slicer.surface import certify, read_surface

__all__ = ["choose_plan"]

_MAX_SECONDS: Final = 1e8  # s
_MAX_PLANS: Final = 6  # maximum number of plans to try


class _SliceFunction(Protocol):
    """Signature of `pipeline.slice_planned`."""

    def __call__(
        self, part: Mesh, plan: LayerPlan, profile: Profile, *, strategies: Strategies
    ) -> Stages: ...


def choose_plan(
    part: Mesh, profile: Profile, strategies: Strategies, slice_planned: _SliceFunction
) -> LayerPlan:
    """Plan the layers; with `time_budget`, return the most accurate plan whose print time is within the budget.

    The planner estimates times with a model, so its budget is adjusted until the actual moves fit. If no plan is fast
    enough, the fastest is returned. A user's planner is called once.

    Args:
        part: the part, standing on z = 0.
        profile: printer, material and quality.
        strategies: may have a planner.
        slice_planned: slices the part with given layers.

    Raises:
        PartError: the part cannot be divided into layers.
        StrategyError: the user's planner returned an invalid value.
    """
    if strategies.planner:
        return check_plan(strategies.planner(part, profile), part, profile, strategies.planner)

    def estimate_seconds(plan: LayerPlan) -> float:
        """Return the time of the moves that slicing with this plan gives, s."""
        program = slice_planned(part, plan, profile, strategies=strategies).program
        return float(move_seconds(program, profile).sum())

    return _find_plan_within_budget(part, profile, estimate_seconds)


def _find_plan_within_budget(
    part: Mesh, profile: Profile, estimate_seconds: Callable[[LayerPlan], float]
) -> LayerPlan:
    """Return the most accurate plan within the budget, or the fastest one."""
    plan, budget = plan_layers(part, profile), profile.dials.time_budget
    if not budget:
        return plan

    asked, low, high = budget, 0.0, np.inf
    tried: list[tuple[float, LayerPlan]] = []
    for _ in range(_MAX_PLANS):
        seconds = estimate_seconds(plan)
        tried.append((seconds, plan))
        if 0.98 * budget <= seconds <= budget or (len(tried) > 1 and plan.runs() == tried[-2][1].runs()):
            break
        low, high = (asked, high) if seconds <= budget else (low, asked)
        asked = (
            (low + high) / 2 if low and high < np.inf else min(asked * 0.995 * budget / seconds, _MAX_SECONDS)
        )
        plan = plan_layers(part, profile_with(profile, {"quality.planner.time_budget": asked}))
    if all(seconds > budget for seconds, _ in tried):
        hurry = {"quality.planner.time_budget": 0, "quality.planner.objective": "time"}
        plan = plan_layers(part, profile_with(profile, hurry))
        tried.append((estimate_seconds(plan), plan))
    within = [plan for seconds, plan in tried if seconds <= budget]
    if not within:
        return min(tried, key=lambda one: one[0])[1]
    return min(within, key=lambda plan: certify(read_surface(part), plan).volume_error)
