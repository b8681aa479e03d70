"""What people can ask the optimal planner for, one by one, together, and from the command line."""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import cache
from itertools import pairwise
from typing import Any, Final

import numpy as np
import pytest

from printer_slicer.arrays import Float
from printer_slicer.errors import PlanError, ProfileError
from printer_slicer.extrusion import move_seconds
from printer_slicer.model import LayerPlan, Mesh
from printer_slicer.pipeline import plan_part, slice_part
from printer_slicer.placing import place
from printer_slicer.planning import plan_layers
from printer_slicer.profile import Profile, load_profile
from printer_slicer.surface import certify, find_flats, read_surface
from tests.effort import crossed, few_of
from tests.parts import box, cone, profile, pyramid, sheared_prism, sphere, step_pyramid
from tests.planning.plans import frusta
from tests.waiting import comes_back

ROUNDING = 1e-6


def optimal(**changes: Any) -> Profile:
    """All heights from 0.08 to 0.32 mm on a grid of 0.01 mm, the first layer free."""
    usual: dict[str, Any] = {"z_step": 0.01, "first_layer_height": 0, "planner__kind": "optimal"}
    return profile(**(usual | changes))


def planned(mesh: Mesh, **changes: Any) -> LayerPlan:
    with comes_back():
        return plan_layers(mesh, optimal(**changes))


def error(mesh: Mesh, plan: LayerPlan) -> float:
    return certify(read_surface(mesh), plan).max_error


def volume(mesh: Mesh, plan: LayerPlan) -> float:
    return certify(read_surface(mesh), plan).volume_error


def within(plan: LayerPlan, low: float, high: float) -> Float:
    """The heights of the layers that reach into a stretch of z."""
    return plan.height[(plan.top > low + ROUNDING) & (plan.bottom < high - ROUNDING)]


def ends_on(plan: LayerPlan, z: float, by: float = 0.005) -> bool:
    return bool(np.abs(np.append(plan.top, 0.0) - z).min() <= by + ROUNDING)


STEPS: Final = step_pyramid([20, 14, 8], [1.13, 2.07, 1.55])
PARTS_OF_ALL_KINDS: Final[Mapping[str, Mesh]] = {
    "sphere": sphere(2),
    "cone": cone(3, 4, 12),
    "leaning": sheared_prism(5, 4, 3),
    "frusta": frusta([10, 8, 9, 5], [1.3, 1.1, 0.7]),
    "steps": STEPS,
    "box": box((10, 10, 4)),
}
each_part = pytest.mark.parametrize("name", PARTS_OF_ALL_KINDS)


# --- greatest step between neighbours ---


@pytest.mark.parametrize(("name", "step"), crossed(PARTS_OF_ALL_KINDS, [0.01, 0.02, 0.05, 0.1]))
def test_neighbours_differ_by_no_more_than_the_greatest_step(name: str, step: float) -> None:
    plan = planned(PARTS_OF_ALL_KINDS[name], planner__max_step=step)

    assert np.abs(np.diff(plan.height)).max(initial=0.0) <= step + ROUNDING


@pytest.mark.parametrize("step", [0.015, 0.019, 0.027])
def test_a_greatest_step_that_is_no_multiple_of_the_lattice_holds_as_well(step: float) -> None:
    for mesh in (sphere(2), STEPS, box((9, 9, 4.07))):
        plan = planned(mesh, planner__max_step=step)
        assert np.abs(np.diff(plan.height)).max(initial=0.0) <= step + ROUNDING


def test_a_greatest_step_under_that_of_the_printer_makes_equal_layers() -> None:
    """4.07 mm are 37 layers of 0.11 mm, and nothing else."""
    plan = planned(box((9, 9, 4.07)), planner__max_step=0.004)

    assert plan.height == pytest.approx(0.11)


def test_evenness_gives_way_to_tolerance_and_flats() -> None:
    mesh = step_pyramid([20, 14, 8], [1.0, 0.08, 1.0])
    plan = planned(mesh, planner__max_step=0.01, tolerance=0.05)

    assert all(ends_on(plan, z) for z in (1.0, 1.08))
    assert error(mesh, plan) <= 0.05 + ROUNDING


@each_part
def test_evenness_never_makes_fewer_layers_and_no_limit_is_as_a_wide_one(name: str) -> None:
    mesh = PARTS_OF_ALL_KINDS[name]
    counts = [
        planned(mesh, planner__objective="layers", planner__max_step=step).n_layers
        for step in (0, 0.3, 0.1, 0.05, 0.02)
    ]

    assert counts[0] == counts[1]
    assert counts == sorted(counts)


# --- greatest number of layers ---


@each_part
def test_there_are_no_more_layers_than_allowed_and_more_of_them_are_no_worse(name: str) -> None:
    mesh = PARTS_OF_ALL_KINDS[name]
    wide = {"tolerance": 0.3}  # never in the way
    fewest = planned(mesh, planner__objective="layers", **wide).n_layers
    errors = []
    for most in (fewest, fewest + 3, fewest + 11, 1000):
        plan = planned(mesh, planner__max_layers=most, **wide)
        assert plan.n_layers <= most
        errors.append(volume(mesh, plan))

    assert all(less <= more + 1e-3 for more, less in pairwise(errors))


def test_so_few_layers_come_before_the_tolerance() -> None:
    mesh = pyramid(8, 4)
    fine = planned(mesh, tolerance=0.05, planner__objective="layers")
    plan = planned(mesh, tolerance=0.05, planner__max_layers=fine.n_layers - 5)

    assert plan.n_layers == fine.n_layers - 5
    assert certify(read_surface(mesh), plan).ranges_above(0.05)


def advice(caught: PlanError) -> int:
    """The number of layers that the remedy names."""
    found = re.search(r"\d+", caught.remedy)
    assert found, caught
    return int(found[0])


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"first_layer_height": 0.1},
        {"first_layer_height": 0.08, "min_layer": 0.08, "max_layer": 0.2},
        {"planner__max_step": 0.05},
        {"planner__max_step": 0.05, "first_layer_height": 0.1},
    ],
    ids=str,
)
@pytest.mark.parametrize("part", ["box", "pyramid"])
def test_too_few_layers_are_refused_with_a_number_that_will_do(part: str, changes: dict[str, Any]) -> None:
    mesh = {"box": box((10, 10, 3)), "pyramid": pyramid(8, 3)}[part]
    with pytest.raises(PlanError, match="layers") as caught:
        planned(mesh, planner__max_layers=3, **changes)
    plan = planned(mesh, planner__max_layers=advice(caught.value), **changes)

    assert plan.n_layers <= advice(caught.value)


@pytest.mark.parametrize("most", [11, 13, 15, 20])
def test_a_greatest_step_does_not_make_more_layers_than_allowed(most: int) -> None:
    for mesh in (box((10, 10, 3)), pyramid(8, 3)):
        plan = planned(mesh, planner__max_layers=most, planner__max_step=0.05)
        assert plan.n_layers <= most
        assert np.abs(np.diff(plan.height)).max() <= 0.05 + ROUNDING


def test_too_few_layers_for_the_heights_that_are_allowed_are_refused() -> None:
    """A part of 3 mm takes 15 layers of 0.2 mm; 10 would have to be thicker than anyone allowed."""
    with pytest.raises(PlanError) as caught:
        planned(box((9, 9, 3)), planner__max_layers=10, thinnest_layer=0.1, thickest_layer=0.2)

    assert advice(caught.value) == 15


# --- time budget, held against the moves ---


def taken(part: Mesh, wanted: Profile, plan: LayerPlan) -> float:
    """What the moves last that print this plan, s."""
    return float(move_seconds(slice_part(part, wanted, plan=plan), wanted).sum())


@cache
def placed(name: str) -> Mesh:
    return place(PARTS_OF_ALL_KINDS[name], optimal().printer)


@cache
def shortest(name: str) -> float:
    """What the plan of least time lasts, s."""
    wanted = optimal(planner__objective="time")
    return taken(placed(name), wanted, plan_part(placed(name), wanted))


@pytest.mark.parametrize(("name", "share"), crossed(PARTS_OF_ALL_KINDS, [1.02, 1.15, 1.5]))
def test_a_time_budget_is_kept_whenever_the_quickest_plan_keeps_it(name: str, share: float) -> None:
    part, budget = placed(name), shortest(name) * share
    wanted = optimal(planner__time_budget=budget)
    with comes_back():
        plan = plan_part(part, wanted)

    assert taken(part, wanted, plan) <= budget + ROUNDING


@pytest.mark.parametrize("name", few_of(["sphere", "frusta", "cone"], 1))
def test_more_time_is_spent_on_less_error(name: str) -> None:
    part, errors = placed(name), []
    for share in (1.02, 1.3, 3.0):
        wanted = optimal(planner__time_budget=shortest(name) * share)
        errors.append(volume(part, plan_part(part, wanted)))

    # The planner's model of time is not the program's: a little more time may be spent a little worse.
    assert all(later <= 1.1 * sooner for sooner, later in pairwise(errors))
    assert errors[-1] < 0.8 * errors[0]


@pytest.mark.parametrize("budget", [3600, 86400, 1e8])
def test_more_time_than_a_part_can_take_is_no_error(budget: float) -> None:
    part = place(box((9, 9, 2)), optimal().printer)
    with comes_back():
        plan = plan_part(part, optimal(planner__time_budget=budget))

    assert plan.top[-1] == pytest.approx(2)


@pytest.mark.parametrize("height", [0.25, 3.0])
@pytest.mark.parametrize("part", ["box", "pyramid"])
def test_less_time_than_a_part_takes_gives_a_plan_as_quick_as_there_is(part: str, height: float) -> None:
    mesh = {"box": box((10, 10, height)), "pyramid": pyramid(8, height)}[part]
    plan = planned(mesh, planner__time_budget=1)

    assert plan.top[-1] == pytest.approx(height)
    assert plan.n_layers <= planned(mesh, planner__objective="time").n_layers + 1


# --- flats that may be missed by a little ---


@pytest.mark.parametrize("snap", [0.0, 0.01, 0.03, 0.1])
def test_layers_end_within_the_snap_tolerance_of_flats(snap: float) -> None:
    for mesh in (STEPS, step_pyramid([20, 14, 8], [1.134, 0.611, 2.017])):
        plan = planned(mesh, planner__snap_tolerance=snap, planner__objective="layers")
        assert all(ends_on(plan, z, max(snap, 0.005)) for z in find_flats(mesh)[0])


def test_a_wider_snap_tolerance_never_needs_more_layers() -> None:
    mesh = step_pyramid([20, 14, 8], [1.134, 0.611, 2.017])
    counts = [
        planned(mesh, planner__snap_tolerance=snap, planner__objective="layers").n_layers
        for snap in (0.0, 0.02, 0.06, 0.15)
    ]

    assert counts == sorted(counts, reverse=True)


# --- ranges ---


@pytest.mark.parametrize(
    ("text", "low", "high", "height"),
    [
        ("1:3:layer_height=0.1", 1, 3, 0.1),
        ("1:3:layer_height=0.25", 1, 3, 0.25),
        ("0:1:layer_height=0.1", 0, 1, 0.1),
        ("3:4:layer_height=0.1", 3, 4, 0.1),
        ("3:9:layer_height=0.1", 3, 4, 0.1),
        ("1.003:2.997:layer_height=0.1", 1, 3, 0.1),
    ],
)
def test_a_range_with_a_layer_height_has_it_and_layers_end_at_its_ends(
    text: str, low: float, high: float, height: float
) -> None:
    plan = planned(pyramid(8, 4), planner__ranges=text, tolerance=0.15)

    assert within(plan, low, high) == pytest.approx(height)
    assert ends_on(plan, low)
    assert ends_on(plan, high)


def test_a_range_that_its_height_does_not_divide_still_has_that_height() -> None:
    plan = planned(pyramid(8, 4), planner__ranges="1:2.15:layer_height=0.2")

    assert within(plan, 1, 2.15) == pytest.approx(0.2)


def test_a_range_thinner_than_a_layer_does_not_hinder() -> None:
    plan = planned(pyramid(8, 4), planner__ranges="1:1.05:layer_height=0.1")

    assert within(plan, 1, 1.05) == pytest.approx(0.1)
    assert plan.top[-1] == pytest.approx(4)


@pytest.mark.parametrize("z_step", [0.001, 0.0005])
def test_the_layer_height_of_a_range_is_taken_to_the_step(z_step: float) -> None:
    plan = planned(box((9, 9, 2)), z_step=z_step, planner__ranges="0.505:1.515:layer_height=0.101")

    assert within(plan, 0.505, 1.515) == pytest.approx(0.101)


def test_a_range_may_have_a_finer_tolerance() -> None:
    mesh = pyramid(8, 4)
    plan = planned(mesh, tolerance=0.12, planner__ranges="1:3:tolerance=0.05", planner__objective="layers")
    bound = certify(read_surface(mesh), plan).bound
    inside = (plan.bottom >= 1 - ROUNDING) & (plan.top <= 3 + ROUNDING)

    assert bound[inside].max() <= 0.05 + ROUNDING
    assert bound[~inside].max() > 0.08
    assert ends_on(plan, 1)
    assert ends_on(plan, 3)


def test_a_range_may_have_a_coarser_tolerance_too() -> None:
    """Its tolerance is the tolerance in it, as the setting says."""
    mesh = pyramid(8, 4)
    plan = planned(mesh, tolerance=0.05, planner__ranges="1:3:tolerance=0.12", planner__objective="layers")
    bound = certify(read_surface(mesh), plan).bound
    inside = (plan.bottom >= 1 - ROUNDING) & (plan.top <= 3 + ROUNDING)

    assert bound[~inside].max() <= 0.05 + ROUNDING
    assert 0.08 < bound[inside].max() <= 0.12 + ROUNDING


def test_the_layer_height_of_a_range_is_forced_whatever_the_tolerance() -> None:
    """Layers of 0.25 mm are off by 0.1 mm there; everywhere else the tolerance is kept."""
    mesh = pyramid(8, 4)
    plan = planned(mesh, tolerance=0.05, planner__ranges="1:3:layer_height=0.25")
    bound = certify(read_surface(mesh), plan).bound
    inside = (plan.bottom >= 1 - ROUNDING) & (plan.top <= 3 + ROUNDING)

    assert inside.sum() == 8
    assert plan.height[inside] == pytest.approx(0.25)
    assert bound[~inside].max() <= 0.05 + ROUNDING


def test_a_range_beyond_the_part_changes_nothing() -> None:
    mesh = pyramid(8, 4)

    assert planned(mesh, planner__ranges="7:9:layer_height=0.1").runs() == planned(mesh).runs()


def test_several_ranges_hold_each_in_its_place() -> None:
    plan = planned(pyramid(8, 4), planner__ranges="0.5:1.5:layer_height=0.1; 2.5:3.5:layer_height=0.2")

    assert within(plan, 0.5, 1.5) == pytest.approx(0.1)
    assert within(plan, 2.5, 3.5) == pytest.approx(0.2)


def test_a_first_layer_that_is_set_is_kept_under_a_range() -> None:
    plan = planned(pyramid(8, 4), first_layer_height=0.2, planner__ranges="0:1:layer_height=0.1")

    assert plan.height[0] == pytest.approx(0.2)
    assert within(plan, 0.2, 1) == pytest.approx(0.1)


def test_ranges_are_told_as_tables_as_well() -> None:
    ranges = [{"low": 1.0, "high": 3.0, "layer_height": 0.1}]
    loaded = load_profile(
        "marlin_220",
        "pla",
        "adaptive",
        {"planner.ranges": ranges, "z_step": 0.01, "quality.first_layer_height": 0},
    )

    assert within(plan_layers(pyramid(8, 4), loaded), 1, 3) == pytest.approx(0.1)


# --- heights and first layer ---


@pytest.mark.parametrize("first", [0.08, 0.1, 0.2, 0.32])
@pytest.mark.parametrize("objective", ["layers", "volume"])
def test_a_first_layer_that_is_set_is_had_whatever_else_is_asked(first: float, objective: str) -> None:
    for mesh in PARTS_OF_ALL_KINDS.values():
        plan = planned(
            mesh,
            first_layer_height=first,
            planner__objective=objective,
            tolerance=0.05,
            layer_heights=(0.1, 0.2, 0.3),
        )
        assert plan.height[0] == pytest.approx(first)


@pytest.mark.parametrize("step", [0.02, 0.03, 0.08])
def test_heights_are_as_far_apart_as_the_layer_step(step: float) -> None:
    plan = planned(pyramid(8, 4), layer_step=step, thinnest_layer=0.08, thickest_layer=0.32)
    free = plan.height[1:-2]  # the others lie next to the bed and the top

    assert np.abs((free - 0.08) / step - np.round((free - 0.08) / step)).max() < 1e-4


@each_part
def test_everything_at_once_is_kept_together(name: str) -> None:
    mesh = PARTS_OF_ALL_KINDS[name]
    top = mesh.height
    plan = planned(
        mesh,
        first_layer_height=0.16,
        tolerance=0.1,
        thinnest_layer=0.1,
        thickest_layer=0.3,
        planner__max_step=0.04,
        planner__snap_tolerance=0.01,
        planner__ranges=f"{top / 2 - 0.5:.2f}:{top / 2 + 0.5:.2f}:tolerance=0.08",
        planner__objective="balanced",
    )

    assert plan.height[0] == pytest.approx(0.16)
    assert error(mesh, plan) <= 0.1 + ROUNDING
    assert all(ends_on(plan, z, 0.01) for z in find_flats(mesh)[0])
    assert abs(plan.top[-1] - top) <= 0.005 + ROUNDING


# --- what contradicts itself ---

CONTRADICTIONS: Final[list[tuple[dict[str, Any], str]]] = [
    ({"planner.max_layers": 50, "planner.time_budget": 600}, "max_layers"),
    ({"planner.ranges": "3:1:tolerance=0.05"}, "planner.ranges"),
    ({"planner.ranges": "1:3:layer_height=0.105"}, "planner.ranges"),
    ({"planner.ranges": "1:3:layer_height=0.9"}, "planner.ranges"),
    ({"planner.ranges": "1:3:tolerance=0.05:width=1"}, "planner.ranges"),
    ({"planner.ranges": "1:3"}, "planner.ranges"),
    ({"planner.ranges": "1:3:layer_height=0.1; 2:4:layer_height=0.2"}, "planner.ranges"),
    ({"layer_heights": "0.1, 0.9"}, "layer_heights"),
    ({"layer_heights": "0.1, 0.105"}, "layer_heights"),
    ({"layer_heights": "thin"}, "layer_heights"),
    ({"layer_step": 0.015}, "layer_step"),
    ({"thinnest_layer": 0.3, "thickest_layer": 0.1}, "thinnest_layer"),
    ({"first_layer_height": 0.9}, "first_layer_height"),
    ({"planner.max_step": -1}, "max_step"),
    ({"planner.snap_tolerance": 2}, "snap_tolerance"),
    ({"planner.error_price": -1}, "error_price"),
    ({"planner.objective": "cheap"}, "objective"),
    ({"containment": "both"}, "containment"),
]


@pytest.mark.parametrize(("changes", "key"), CONTRADICTIONS, ids=str)
def test_what_contradicts_itself_is_refused_by_key_with_a_remedy(changes: dict[str, Any], key: str) -> None:
    with pytest.raises(ProfileError) as caught:
        load_profile("marlin_220", "pla", "adaptive", {"z_step": 0.01} | changes)

    assert key in str(caught.value).splitlines()[0]
    assert caught.value.remedy
