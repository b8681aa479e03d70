"""Choose layer plans within a time budget, using the time of the actual moves besides the planner's estimate."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Final, Protocol

import numpy as np

from printer_slicer.extrusion import move_seconds
from printer_slicer.model import LayerPlan, Mesh, ObjectStack
from printer_slicer.object_plans import (
    PlanGroup,
    Plans,
    extract_objects,
    find_equal_groups,
    find_plan_groups,
    list_plans,
    list_stack_plans,
    make_stacks,
)
from printer_slicer.planning import plan_layers
from printer_slicer.profile import Profile, profile_with
from printer_slicer.profile.planners import OptimalPlanner
from printer_slicer.stages import Stages
from printer_slicer.strategies import Strategies, check_plan
from printer_slicer.surface import certify, certify_stacks, read_surface

__all__ = ["choose_plan", "choose_stacks"]

_MAX_SECONDS: Final = 1e8  # s
_MAX_PLANS: Final = 6  # maximum number of plans to try
_ENOUGH_RATIO: Final = 0.98  # fraction of the budget that is sufficient
_PRICE_EXPONENT: Final = 12.0  # typical change of log(error price) per log(print time)
_MAX_COST_RATIO: Final = 0.995  # of separate plans to a single one; the estimate is not exact
_MAX_PRICE_RATIO: Final = 16.0  # between two trials without an upper and a lower bound


class _SliceFunction(Protocol):
    """Signature of `pipeline.slice_planned`."""

    def __call__(self, part: Mesh, plan: Plans, profile: Profile, *, strategies: Strategies) -> Stages: ...


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
        if _ENOUGH_RATIO * budget <= seconds <= budget or (
            len(tried) > 1 and plan.runs() == tried[-2][1].runs()
        ):
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


_PlanFunction = Callable[[Mapping[str, float | str]], tuple[ObjectStack, ...]]
"""Plans all objects with changed settings."""
_TimeFunction = Callable[[Sequence[ObjectStack]], float]
"""Estimates the print time of plans, s."""


def choose_stacks(
    part: Mesh, profile: Profile, strategies: Strategies, slice_planned: _SliceFunction
) -> tuple[ObjectStack, ...]:
    """Plan the layers of all objects, separately with `quality.planner.stacks = objects` if this costs less.

    All objects have the same price of the volume error, so that no exchange of time between them would reduce the total
    error. Arguments and errors are those of `choose_plan`.
    """
    plan_groups, model_seconds = (
        (None, None) if strategies.planner else _prepare_separate_plans(part, profile)
    )
    if plan_groups is None:
        return make_stacks(part, choose_plan(part, profile, strategies, slice_planned))

    def estimate_seconds(stacks: Sequence[ObjectStack]) -> float:
        """Return the time of the moves that slicing with these plans gives, s."""
        program = slice_planned(part, list_stack_plans(stacks), profile, strategies=strategies).program
        return float(move_seconds(program, profile).sum())

    from printer_slicer.planning.shared_layer_times import compute_error_price  # noqa: PLC0415 - few plates need it

    price, dials = compute_error_price(part, profile), profile.dials
    if not dials.time_budget or dials.max_layers:
        stacks = plan_groups({"quality.planner.error_price": price})
        if len(stacks) > 1 and dials.objective == "balanced" and not dials.max_layers:
            return _choose_cheaper(stacks, part, profile, price, model_seconds or estimate_seconds)
        return stacks
    return _find_stacks_within_budget(dials.time_budget, price, plan_groups, estimate_seconds)


def _choose_cheaper(
    stacks: tuple[ObjectStack, ...],
    part: Mesh,
    profile: Profile,
    price: float,
    estimate_seconds: _TimeFunction,
) -> tuple[ObjectStack, ...]:
    """Return the stacks of objects or features, or a single one if it costs less.

    The planner knows neither all travels between objects or features nor how well their layers cool together.
    """
    single = make_stacks(part, plan_layers(part, profile))
    costs = [estimate_seconds(one) + price * certify_stacks(one).volume_error for one in (stacks, single)]
    return stacks if costs[0] < _MAX_COST_RATIO * costs[1] else single


def _prepare_separate_plans(
    part: Mesh, profile: Profile
) -> tuple[_PlanFunction | None, _TimeFunction | None]:
    """Return a function that plans objects or features separately; None if there is one plan.

    Also return one that estimates print times with a model; None if only slicing tells them.
    """
    groups = find_plan_groups(part, profile)
    first = find_equal_groups(part, groups) if len(groups) > 1 else []
    if any(first):
        return _prepare_plans(part, groups, first, profile)
    planner = profile.quality.planner
    if len(part.objects) > 1 or not isinstance(planner, OptimalPlanner) or planner.stacks != "features":
        return None, None
    from printer_slicer.feature_stacks import prepare_feature_plans  # noqa: PLC0415 - off by default

    return prepare_feature_plans(part, profile), None


def _prepare_plans(
    part: Mesh, groups: Sequence[PlanGroup], first: Sequence[int], profile: Profile
) -> tuple[_PlanFunction, _TimeFunction]:
    """Return functions that plan groups of objects and estimate print times.

    `first` has the index of the first group of equal shape for each group.
    """
    unlike = sorted(set(first))
    meshes = {groups[k]: extract_objects(part, [part.objects[index] for index in groups[k]]) for k in unlike}
    least = _divide_min_layer_time(meshes, [first.count(k) for k in unlike], profile)
    owners = [groups[k] for k in first]

    def plan_groups(changes: Mapping[str, float | str]) -> tuple[ObjectStack, ...]:
        """Plan each group of objects with changed settings."""
        own = profile_with(profile, changes)
        plans = {
            group: plan_layers(mesh, profile_with(own, {"material.min_layer_time": least[group]}))
            for group, mesh in meshes.items()
        }
        owner = {index: owners[k] for k, group in enumerate(groups) for index in group}
        return make_stacks(part, [plans[owner[index]] for index in sorted(owner)], meshes)

    def model_seconds(stacks: Sequence[ObjectStack]) -> float:
        """Estimate the print time of all groups, s."""
        from printer_slicer.object_plan_costs import (  # noqa: PLC0415 - few plates need it
            GroupLayers,
            estimate_plate_seconds,
        )

        plans = list_plans(part, list_stack_plans(stacks))
        places = [_find_middle(part, group) for group in groups]
        layers = [
            GroupLayers(meshes[owner], plans[group[0]], place, least[owner])
            for owner, group, place in zip(owners, groups, places, strict=True)
        ]
        return estimate_plate_seconds(layers, profile)

    return plan_groups, model_seconds


def _find_middle(part: Mesh, group: PlanGroup) -> tuple[float, float]:
    """Return the middle of the bounding box of a group of objects, mm."""
    low = np.min([part.objects[index].low for index in group], axis=0)
    high = np.max([part.objects[index].high for index in group], axis=0)
    x, y, _ = ((low + high) / 2).tolist()
    return x, y


def _divide_min_layer_time(
    meshes: Mapping[PlanGroup, Mesh], counts: Sequence[int], profile: Profile
) -> dict[PlanGroup, float]:
    """Return the part of the minimum layer time that each group of objects needs, s."""
    from printer_slicer.planning.shared_layer_times import compute_time_shares  # noqa: PLC0415 - few plates need it

    least = profile.material.min_layer_time
    if profile.quality.print_order == "by_object":  # nothing else is printed while a layer cools
        return dict.fromkeys(meshes, least)
    shares = compute_time_shares(list(meshes.values()), counts, profile)
    return {group: least * share for group, share in zip(meshes, shares.tolist(), strict=True)}


def _find_stacks_within_budget(
    budget: float,
    price: float,
    plan_groups: _PlanFunction,
    estimate_seconds: _TimeFunction,
) -> tuple[ObjectStack, ...]:
    """Return the most accurate plans within the budget, s, or the fastest, from plans with different error prices."""
    no_budget: dict[str, float | str] = {"quality.planner.time_budget": 0}
    tried: list[tuple[float, float, tuple[ObjectStack, ...]]] = []
    for _ in range(_MAX_PLANS):
        prices: dict[str, float | str] = {
            "quality.planner.objective": "balanced",
            "quality.planner.error_price": price,
        }
        stacks = plan_groups(no_budget | prices)
        seconds = estimate_seconds(stacks)
        tried.append((price, seconds, stacks))
        if _ENOUGH_RATIO * budget <= seconds <= budget:
            break
        price = _choose_next_price([one[:2] for one in tried], budget)
    if all(seconds > budget for _, seconds, _ in tried):
        stacks = plan_groups(no_budget | {"quality.planner.objective": "time"})
        tried.append((0.0, estimate_seconds(stacks), stacks))
    within = [stacks for _, seconds, stacks in tried if seconds <= budget]
    if not within:
        return min(tried, key=lambda one: one[1])[2]
    return min(within, key=lambda stacks: certify_stacks(stacks).volume_error)


def _choose_next_price(tried: Sequence[tuple[float, float]], budget: float) -> float:
    """Return the next error price, s/mm³, for pairs of an error price and the print time that it gave, s."""
    cheap = max((one for one in tried if one[1] <= budget), default=None)
    dear = min((one for one in tried if one[1] > budget), default=None)
    if cheap and dear and cheap[0] < dear[0]:
        share = np.log(budget / cheap[1]) / np.log(dear[1] / cheap[1])
        return float(cheap[0] * (dear[0] / cheap[0]) ** np.clip(share, 0.1, 0.9))
    price, seconds = tried[-1]
    ratio = (budget / seconds) ** _PRICE_EXPONENT
    return float(np.clip(price * np.clip(ratio, 1 / _MAX_PRICE_RATIO, _MAX_PRICE_RATIO), 1e-6, 1e6))
