"""Group the objects of a plate by their layer plans, and find those that may have plans of their own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Final

import numpy as np

from printer_slicer.arrays import Float
from printer_slicer.errors import UsageError
from printer_slicer.model import LayerPlan, Mesh, ObjectStack, PlateObject
from printer_slicer.profile import Profile
from printer_slicer.profile.planners import OptimalPlanner
from printer_slicer.texts import list_with_counts

__all__ = [
    "PlanGroup",
    "Plans",
    "extract_objects",
    "find_equal_groups",
    "find_plan_groups",
    "group_close_objects",
    "list_plans",
    "list_stack_plans",
    "make_stacks",
    "number_plans",
]

_SMALLEST_GAP: Final = 1.0
"""Objects that are closer than this in the top view have the same plan, mm: they may touch or overlap."""
_SAME_PLACE: Final = 1e-6  # mm, for rounding of shifts

PlanGroup = tuple[int, ...]
"""Indices of objects that must have the same plan."""
Plans = LayerPlan | Sequence[LayerPlan] | Sequence[ObjectStack]
"""One plan for all objects, one for each object, or the stacks of features."""


def extract_objects(part: Mesh, items: Sequence[PlateObject]) -> Mesh:
    """Return the given objects of a part as one mesh."""
    pieces = [part.triangles[item.facets] for item in items]
    given = [one for one in (part.volumes, *(item.volumes for item in items)) if one]
    volumes = given[0].joined(given) if given else None
    return Mesh(
        np.concatenate(pieces), ", ".join(list_with_counts(item.name for item in items)), volumes=volumes
    )


def list_plans(part: Mesh, plan: Plans) -> list[LayerPlan]:
    """Return the plan of each object of a part.

    Args:
        part: placed on the bed.
        plan: one plan for all objects, or one for each.

    Raises:
        UsageError: the number of plans is not the number of objects.
    """
    n_objects = max(len(part.objects), 1)
    plans = (
        [plan] * n_objects
        if isinstance(plan, LayerPlan)
        else [one for one in plan if isinstance(one, LayerPlan)]
    )
    if len(plans) != n_objects:
        raise UsageError(
            f"{part.name}: {len(plans)} layer plans for {n_objects} objects",
            remedy="Give one plan for all objects, or one for each",
        )
    return plans


def number_plans(plans: Sequence[LayerPlan]) -> list[int]:
    """Return for each plan the index of the first plan that is equal to it."""
    numbers: dict[tuple[bytes, ...], int] = {}
    keys = [
        (plan.top.tobytes(), plan.cut.tobytes(), plan.bottom.tobytes(), plan.containment.encode())
        for plan in plans
    ]
    return [numbers.setdefault(key, index) for index, key in enumerate(keys)]


def make_stacks(
    part: Mesh, plan: Plans, known: Mapping[PlanGroup, Mesh] | None = None
) -> tuple[ObjectStack, ...]:
    """Return the stacks of a part: objects with equal plans are in the same stack.

    Args:
        part: placed on the bed.
        plan: one plan for all objects, or one for each, or the stacks of features.
        known: meshes of some groups of objects.

    Raises:
        UsageError: the number of plans is not the number of objects.
    """
    if not isinstance(plan, LayerPlan) and plan and isinstance(plan[0], ObjectStack):
        return tuple(one for one in plan if isinstance(one, ObjectStack))
    plans = list_plans(part, plan)
    numbers = number_plans(plans)
    if not any(numbers):
        return (ObjectStack(plans[0], part, tuple(range(len(plans)))),)
    stacks = list[ObjectStack]()
    for number in sorted(set(numbers)):
        objects = tuple(index for index, one in enumerate(numbers) if one == number)
        mesh = (known or {}).get(objects)
        mesh = extract_objects(part, [part.objects[index] for index in objects]) if mesh is None else mesh
        stacks.append(ObjectStack(plans[number], mesh, objects))
    return tuple(stacks)


def list_stack_plans(stacks: Sequence[ObjectStack]) -> Plans:
    """Return the plan of a single stack, or the plan of each object; or the stacks, if some are those of features."""
    if len(stacks) == 1:
        return stacks[0].plan
    if stacks[0].whole_plan:
        return stacks
    plans = {index: one.plan for one in stacks for index in one.objects}
    return [plans[index] for index in sorted(plans)]


def find_plan_groups(part: Mesh, profile: Profile) -> list[PlanGroup]:
    """Return the groups of objects that are planned separately (`quality.planner.stacks`).

    Objects that are closer than 1 mm in the top view are in the same group, because they may touch. All objects are in
    one group if their facets are unknown after a repair, or with `quality.spiral`.
    """
    planner, every = profile.quality.planner, tuple(range(max(len(part.objects), 1)))
    own_plans = isinstance(planner, OptimalPlanner) and planner.stacks != "one"
    if not own_plans or profile.quality.spiral or not all(item.count for item in part.objects):
        return [every]
    return group_close_objects(part) if len(every) > 1 else [every]


def group_close_objects(part: Mesh) -> list[PlanGroup]:
    """Return groups of objects: those of different groups are at least 1 mm apart in the top view."""
    low, high = (np.array([getattr(item, side)[:2] for item in part.objects]) for side in ("low", "high"))
    group = list(range(len(part.objects)))
    for a, b in combinations(range(len(group)), 2):
        apart = np.maximum(low[a] - high[b], low[b] - high[a]).max()
        if group[a] != group[b] and apart < _SMALLEST_GAP and _are_close(part, a, b):
            group = [group[a] if one == group[b] else one for one in group]
    return [tuple(k for k, one in enumerate(group) if one == number) for number in sorted(set(group))]


def _are_close(part: Mesh, a: int, b: int) -> bool:
    """Return whether two objects are closer than 1 mm in the top view."""
    from printer_slicer.arranging.spacing import find_smallest_distance  # noqa: PLC0415 - few plates need it
    from printer_slicer.surface.top_view import project_from_above  # noqa: PLC0415 - few plates need it

    outlines = [project_from_above(extract_objects(part, [part.objects[index]])) for index in (a, b)]
    return find_smallest_distance(outlines, _SMALLEST_GAP) < _SMALLEST_GAP


def find_equal_groups(part: Mesh, groups: Sequence[PlanGroup]) -> list[int]:
    """Return for each group the index of the first group with the same shape, which may stand at another place."""
    shapes = [np.concatenate([part.triangles[part.objects[one].facets] for one in group]) for group in groups]
    first = list[int]()
    for index, shape in enumerate(shapes):
        equal = (k for k in range(index) if first[k] == k and _is_shifted(shapes[k], shape))
        first.append(next(equal, index))
    return first


def _is_shifted(one: Float, other: Float) -> bool:
    """Return whether two lists of facets (F, 3, 3) are equal after a shift in x and y."""
    if one.shape != other.shape:
        return False
    difference = other - one
    return bool(np.abs(difference - difference[0, 0] * [1, 1, 0]).max(initial=0.0) < _SAME_PLACE)
