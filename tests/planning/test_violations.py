"""What a plan could not keep is told, all of it and nothing else, with what stood in the way."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer.model import LayerPlan, Mesh
from printer_slicer.planning import plan_layers
from printer_slicer.planning.violations import PlanViolation, find_violations
from printer_slicer.planning.z_steps import layer_tolerances
from printer_slicer.profile import HeightRange, Profile
from printer_slicer.surface import certify, find_flats, read_surface
from tests.parts import box, profile, sphere, step_pyramid
from tests.planning.plans import frusta

NEAR = 0.00125 + 1e-6  # mm; half of a z step


def optimal(**changes: Any) -> Profile:
    usual: dict[str, Any] = {"z_step": 0.0025, "first_layer_height": 0, "planner__kind": "optimal"}
    return profile(**(usual | changes))


def judged(mesh: Mesh, wanted: Profile, plan: LayerPlan | None = None) -> list[PlanViolation]:
    plan = plan or plan_layers(mesh, wanted)
    return find_violations(mesh, certify(read_surface(mesh), plan), wanted)


def test_a_plan_that_keeps_everything_has_nothing_to_tell() -> None:
    for mesh in (box((9, 9, 5)), sphere(2), step_pyramid([30, 20, 10], [0.35, 2.06, 0.5])):
        assert judged(mesh, optimal(tolerance=0.12, planner__max_step=0.3)) == []


def test_a_tolerance_under_half_of_the_thinnest_layer_tells_what_that_layer_can_do() -> None:
    (*many, last) = judged(sphere(4), optimal(tolerance=0.02, min_layer=0.08))

    for violation in (*many, last):
        assert violation.rule == "tolerance"
        assert 0.02 < violation.amount <= 0.04 + 1e-9
        assert violation.cause == "layers of 0.08 mm, the thinnest allowed, can deviate by 0.04 mm"


def test_contained_layers_can_be_wrong_by_their_whole_height() -> None:
    found = judged(sphere(4), optimal(tolerance=0.05, min_layer=0.08, containment="positive"))

    assert found
    assert {violation.cause for violation in found} == {
        "layers of 0.08 mm, the thinnest allowed, can deviate by 0.08 mm"
    }


def test_a_first_layer_that_is_too_thick_is_the_cause_and_nothing_else() -> None:
    (violation,) = judged(sphere(4), optimal(tolerance=0.06, first_layer_height=0.3))

    assert (violation.rule, violation.low, violation.high) == ("tolerance", 0.0, 0.3)
    assert violation.cause == "the first layer is set to 0.3 mm"


def test_of_two_flats_too_near_to_each_other_one_is_missed_and_the_other_one_is_named() -> None:
    mesh = step_pyramid([30, 20, 10], [1.0, 0.03, 1.0])
    (violation,) = judged(mesh, optimal(tolerance=0.12, min_layer=0.08))

    assert violation.rule == "flat"
    assert (violation.low, violation.amount) == (pytest.approx(1.03), pytest.approx(0.03))
    assert "thinnest layer, 0.08 mm, away from z 1" in violation.cause


def test_a_flat_within_the_first_layer_is_missed_because_of_it() -> None:
    (violation,) = judged(step_pyramid([30, 20], [0.15, 3.0]), optimal(tolerance=0.3, first_layer_height=0.3))

    assert violation.rule == "flat"
    assert violation.cause == "the first layer is set to 0.3 mm"


def test_few_layers_are_the_cause_of_what_more_of_them_would_mend() -> None:
    mesh = sphere(4)
    found = judged(mesh, optimal(tolerance=0.06, planner__max_layers=27))

    assert found
    assert {violation.cause for violation in found} == {"no more than 27 layers are allowed"}
    assert judged(mesh, optimal(tolerance=0.06, planner__max_layers=200)) == []


def test_a_range_that_the_part_does_not_reach_is_told() -> None:
    stretch = HeightRange(low=40, high=41, tolerance=0.1)
    (violation,) = judged(box((9, 9, 5)), optimal(planner__ranges=(stretch,)))

    assert (violation.rule, violation.low, violation.high) == ("range", 40, 41)
    assert violation.cause == "the part is 5 mm high"


def test_a_range_height_that_does_not_divide_the_range_is_told_with_z() -> None:
    stretch = HeightRange(low=1, high=2, layer_height=0.3)
    found = judged(box((9, 9, 5)), optimal(planner__ranges=(stretch,)))

    assert found
    assert {violation.rule for violation in found} <= {"range height", "range end"}
    assert all(violation.low >= 1 - NEAR and violation.high <= 2 + NEAR for violation in found)


def test_every_uneven_pair_that_flats_ask_for_is_told() -> None:
    mesh = step_pyramid([30, 20, 10], [0.08, 0.15, 1.0])
    wanted = optimal(planner__max_step=0.02, min_layer=0.08)
    plan = plan_layers(mesh, wanted)
    uneven = plan.top[:-1][np.abs(np.diff(plan.height)) > 0.02 + 1e-6]

    assert len(uneven)
    assert [one.low for one in judged(mesh, wanted) if one.rule == "max_step"] == pytest.approx(uneven)


@pytest.mark.parametrize("kind", ["uniform", "area"])
def test_planners_that_promise_neither_tolerance_nor_flats_break_none(kind: str) -> None:
    assert judged(sphere(4), profile(planner__kind=kind, tolerance=0.01)) == []


def test_planners_that_measure_errors_in_another_way_say_so() -> None:
    wanted = profile(planner__kind="cusp", planner__metric="topography", tolerance=0.03, first_layer_height=0)
    found = judged(sphere(4), wanted)
    thick = {one.cause for one in found if "thinnest" not in one.cause}

    assert thick == {"planner 'cusp' limits another measure of the deviation"}


@given(
    st.lists(st.floats(0.02, 1.5), min_size=1, max_size=4),
    st.sampled_from([0.0, 0.2]),
    st.sampled_from([0, 3, 6]),
    st.sampled_from([0.0, 0.03]),
    st.floats(0.02, 0.2),
)
def test_what_is_told_is_what_is_broken(
    heights: list[float], first: float, most: int, change: float, tolerance: float
) -> None:
    """Any part, any dials; each rule is looked at here in the plainest way."""
    mesh = frusta([10, 8, 9, 5, 7][: len(heights) + 1], heights)
    if mesh.height < 0.4:
        return
    most = most and most + int(mesh.height / 0.3)
    dials: dict[str, Any] = {"planner__max_layers": most, "planner__max_step": change}
    wanted = optimal(first_layer_height=first, tolerance=tolerance, **dials)
    plan = plan_layers(mesh, wanted)
    certificate, found = certify(read_surface(mesh), plan), judged(mesh, wanted, plan)
    told = {rule: [one for one in found if one.rule == rule] for rule in ("tolerance", "flat", "max_step")}
    over = certificate.bound > layer_tolerances(wanted, plan.bottom, plan.top) + 1e-6
    covered = np.zeros(plan.n_layers, np.bool_)
    for one in told["tolerance"]:
        covered |= (plan.bottom >= one.low - 1e-9) & (plan.top <= one.high + 1e-9)
    off = np.abs(np.append(0.0, plan.top)[:, None] - find_flats(mesh)[0]).min(axis=0)

    assert covered.tolist() == over.tolist()
    assert len(told["flat"]) == (off > NEAR).sum()
    assert len(told["max_step"]) == ((np.abs(np.diff(plan.height)) > change + 1e-6).sum() if change else 0)
    assert all(one.cause for one in found)
