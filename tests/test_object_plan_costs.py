"""The modelled print time of plates, and the choice between a plan for each object and one for all."""

from __future__ import annotations

import numpy as np
import pytest

import printer_slicer as ps
from printer_slicer.extrusion import move_seconds
from printer_slicer.model import LayerPlan, Mesh
from printer_slicer.object_plan_costs import GroupLayers, estimate_plate_seconds, list_changes_of_group
from printer_slicer.pipeline import plan_objects, slice_stages
from printer_slicer.planning.shared_layer_times import compute_error_price
from printer_slicer.surface import certify_stacks
from tests.parts import box, plain
from tests.test_stacks import optimal, plate

PART = box((15.0, 15.0, 6.0))
EVEN = LayerPlan.from_tops(np.arange(1, 31, dtype=np.float64) * 0.2)


def group(plan: LayerPlan, place: tuple[float, float] = (0.0, 0.0), mesh: Mesh = PART) -> GroupLayers:
    return GroupLayers(mesh, plan, place, 0.0)


@pytest.mark.parametrize(
    ("tops", "changes"),
    [
        ([[0.2, 0.4, 0.6]], []),
        ([[0.2, 0.4], [0.2, 0.4]], [(0, 1), (1, 0)]),
        ([[0.2, 0.4], [0.2, 0.4], [0.2]], [(0, 1), (1, 2), (2, 0), (0, 1)]),
        ([[0.2, 0.4], [0.3, 0.6]], [(0, 1), (1, 0), (0, 1)]),
        ([[0.2, 0.4], [0.5, 0.8]], [(0, 1)]),
    ],
)
def test_changes_of_group(tops: list[list[float]], changes: list[tuple[int, int]]) -> None:
    begin, end = list_changes_of_group([np.array(one) for one in tops])

    assert list(zip(begin.tolist(), end.tolist(), strict=True)) == changes


def test_equal_groups_take_equal_time_and_travels_between_them() -> None:
    profile = plain()
    one = estimate_plate_seconds([group(EVEN)], profile)
    two = estimate_plate_seconds([group(EVEN), group(EVEN, (40.0, 0.0))], profile)
    far = estimate_plate_seconds([group(EVEN), group(EVEN, (140.0, 0.0))], profile)
    by_object = plain(print_order="by_object")

    assert 2 * one < two < far
    assert estimate_plate_seconds([group(EVEN), group(EVEN, (40.0, 0.0))], by_object) == pytest.approx(
        2 * one
    )


def test_layers_at_different_heights_cost_more_travels() -> None:
    profile, shifted = (
        plain(),
        LayerPlan.from_tops(np.append(np.arange(1, 30, dtype=np.float64) * 0.2 + 0.1, 6.0)),
    )
    same, apart = (
        estimate_plate_seconds([group(EVEN), group(other, (40.0, 0.0))], profile) for other in (EVEN, shifted)
    )

    assert apart > same + 5


def test_layers_above_the_top_of_a_group_are_not_counted() -> None:
    profile = plain()
    low = box((15.0, 15.0, 3.0))
    half = LayerPlan.from_tops(np.arange(1, 16, dtype=np.float64) * 0.2)

    assert estimate_plate_seconds([group(EVEN, mesh=low)], profile) == pytest.approx(
        estimate_plate_seconds([group(half, mesh=low)], profile)
    )


def test_a_single_plan_is_used_if_it_costs_less() -> None:
    """Boxes have no volume error, so separate layers would only cost travels."""
    boxes = [box((12.0, 12.0, 4.0)), box((12.0, 12.0, 7.0), (20.0, 0.0, 0.0))]
    [single] = plan_objects(
        ps.join([Mesh(one.triangles, f"box_{k}") for k, one in enumerate(boxes)]), optimal()
    )

    assert single.objects == (0, 1)


def test_separate_plans_are_used_if_they_cost_less() -> None:
    part = plate(["box", "cone"])
    price = compute_error_price(part, optimal())
    costs = [
        float(move_seconds(stages.program, optimal()).sum())
        + price * certify_stacks(stages.stacks).volume_error
        for stages in (slice_stages(part, optimal(planner__stacks=stacks)) for stacks in ("objects", "one"))
    ]

    assert len(plan_objects(part, optimal())) == 2
    assert costs[0] < costs[1]
