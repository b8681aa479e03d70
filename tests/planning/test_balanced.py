"""The usual objective: minutes and volume error at a price that goes with the machine, in smooth layers."""

from __future__ import annotations

from itertools import pairwise
from typing import Any, Final

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from printer_slicer.arrays import Bool, Float
from printer_slicer.model import LayerPlan, Mesh
from printer_slicer.planning import plan_layers
from printer_slicer.planning.layer_times import LayerTimes
from printer_slicer.planning.smoothness import SMOOTH_STEP, SMOOTH_STEP_RATIO
from printer_slicer.planning.z_steps import ZSteps
from printer_slicer.profile import Profile, profile_with
from printer_slicer.surface import certify, find_flats, read_surface
from tests.effort import crossed, examples, few_of
from tests.parts import box, cone, pyramid, sphere, step_pyramid
from tests.planning.machines import MACHINES, machine, on_another_clock
from tests.planning.plans import frusta

NEARLY: Final = 2e-3
ROUNDING: Final = 1e-6  # mm

MOVED: Final = {
    "cone": cone(20, 15),
    "sphere": sphere(8),
    "pyramid": pyramid(30, 12),
    "frusta": frusta([30, 22, 26, 10], [3.7, 2.1, 5.0]),
    "steps": step_pyramid([40, 28, 16], [2.03, 3.11, 2.57]),
}

any_machine = pytest.mark.parametrize("name", MACHINES)


@st.composite
def stacks(draw: st.DrawFn) -> Mesh:
    """Frusta with or without steps between them: any profile of area over height."""
    n = draw(st.integers(1, 4))
    heights = [draw(st.integers(3, 60)) / 20 + draw(st.sampled_from([0.0, 0.013])) for _ in range(n)]
    sides = [draw(st.integers(2, 40)) / 2 + 2 for _ in range(n + 1)]
    if draw(st.booleans()):
        return frusta([float(side) for side in sides], heights)
    ordered = sorted({float(side) for side in sides}, reverse=True)[:n]
    return step_pyramid(ordered, heights[: len(ordered)])


def cost_of(mesh: Mesh, profile: Profile, plan: LayerPlan) -> Float:
    """Modelled seconds and certified volume error, mm³."""
    times = LayerTimes(read_surface(mesh), profile, (plan.top + plan.bottom) / 2)
    seconds = sum(times.seconds(np.array([i]), float(h))[0] for i, h in enumerate(plan.height))
    return np.array([seconds, certify(read_surface(mesh), plan).volume_error])


def uniform_plans(mesh: Mesh, profile: Profile) -> list[LayerPlan]:
    """Those of all heights that the machine's list has, which need no other ones than that to be the last."""
    steps = ZSteps(mesh, profile)
    changes = [
        {"quality.planner.kind": "uniform", "quality.layer_height": float(height)}
        for height in steps.allowed * steps.size
    ]
    plans = [plan_layers(mesh, profile_with(profile, change)) for change in changes]
    units = [np.rint(plan.height[1:-1] / steps.size).astype(np.int64) for plan in plans]
    return [plan for plan, inner in zip(plans, units, strict=True) if np.isin(inner, steps.allowed).all()]


def beaten(mine: Float, theirs: Float) -> bool:
    """Whether a plan is as quick and exact as mine, and better at one of it."""
    return bool((theirs <= mine + 1e-6).all() and (theirs < mine * (1 - NEARLY) - 1e-6).any())


@any_machine
@settings(max_examples=examples(2, 24))
@given(mesh=stacks())
def test_no_uniform_plan_is_quicker_for_the_same_error_or_more_exact_in_the_same_time(
    name: str, mesh: Mesh
) -> None:
    wanted = machine(name)
    mine = cost_of(mesh, wanted, plan_layers(mesh, wanted))

    for plan in uniform_plans(mesh, wanted):
        assert not beaten(mine, cost_of(mesh, wanted, plan)), plan.runs()


@any_machine
@settings(max_examples=examples(2, 32))
@given(part=st.sampled_from([*MOVED]), k=st.sampled_from([0.25, 0.5, 2.0, 4.0]))
def test_a_machine_on_another_clock_has_the_same_plan(name: str, part: str, k: float) -> None:
    usual = machine(name)
    before, after = (plan_layers(MOVED[part], one) for one in (usual, on_another_clock(usual, k)))

    assert after.runs() == before.runs()


def test_a_price_of_ones_own_is_in_seconds_whatever_the_machine() -> None:
    """On a machine that is quicker by far the same seconds buy more layers."""
    usual = machine("marlin_220", planner__error_price=20)
    slow, quick = (plan_layers(MOVED["sphere"], on_another_clock(usual, k)).n_layers for k in (0.5, 8.0))

    assert quick > slow * 1.3


@pytest.mark.parametrize("name", few_of(MACHINES, 1))
def test_a_higher_price_ratio_never_gives_more_volume_error(name: str) -> None:
    for mesh in (MOVED["sphere"], MOVED["frusta"]):
        errors = [
            certify(
                read_surface(mesh), plan_layers(mesh, machine(name, planner__error_price_ratio=ratio))
            ).volume_error
            for ratio in (1, 10, 45, 200, 1000)
        ]
        assert all(less <= more * (1 + 1e-3) for more, less in pairwise(errors))


# --- smooth layers ---


def jumps(plan: LayerPlan) -> Bool:
    """(L - 1,) which neighbours differ by more than smooth ones may."""
    thicker = np.maximum(plan.height[1:], plan.height[:-1])
    return np.asarray(
        np.abs(np.diff(plan.height)) > np.maximum(SMOOTH_STEP, SMOOTH_STEP_RATIO * thicker) + ROUNDING
    )


def beside(planes: Float, plan: LayerPlan) -> Bool:
    """(L - 1,) neighbours of which one begins or ends at one of the planes."""
    ends = np.append(0.0, plan.top)
    at = (np.abs(ends[:, None] - planes) <= 0.006).any(axis=1)
    return np.asarray(at[:-2] | at[1:-1] | at[2:])


@any_machine
@settings(max_examples=examples(10))
@given(mesh=stacks())
def test_neighbouring_layers_are_smooth_but_beside_flats(name: str, mesh: Mesh) -> None:
    plan = plan_layers(mesh, machine(name))
    flats = np.append(find_flats(mesh)[0], [0.0, mesh.height])  # the first layer is set, and the top is met

    assert not (jumps(plan) & ~beside(flats, plan)).any(), plan.runs()


@pytest.mark.parametrize(("name", "part"), crossed(MACHINES, MOVED))
def test_smooth_layers_cost_three_percent_at_most(name: str, part: str) -> None:
    usual, mesh = machine(name), MOVED[part]
    surface = read_surface(mesh)
    price = 45 * LayerTimes(surface, usual, np.array([1.0])).seconds_per_mm3(0.2)
    smooth, free = (
        cost_of(mesh, one, plan_layers(mesh, one)) @ [1.0, price]
        for one in (usual, machine(name, planner__smooth=False))
    )

    assert free * (1 - NEARLY) <= smooth <= free * 1.03


def test_a_wall_beside_a_gentle_slope_has_no_bands() -> None:
    """The slope asks for thin layers; the walls above and below go there by steps, and not all at once."""
    mesh = frusta([30, 30, 20, 20], [4.0, 0.6, 4.0])
    rough, smooth = (
        plan_layers(mesh, machine("marlin_220", planner__smooth=value)) for value in (False, True)
    )
    ends = np.array([0.0, mesh.height])

    assert (jumps(rough) & ~beside(ends, rough)).any()
    assert not (jumps(smooth) & ~beside(ends, smooth)).any()


@any_machine
def test_a_uniform_plan_with_a_jump_at_its_end_is_no_quicker(name: str) -> None:
    """A layer of 0.2 mm under three of 0.3 mm and one of 0.2 mm on top."""
    mesh = box((16, 16, 1.3))
    wanted = machine(name)
    mine = cost_of(mesh, wanted, plan_layers(mesh, wanted))

    for plan in uniform_plans(mesh, wanted):
        assert not beaten(mine, cost_of(mesh, wanted, plan)), plan.runs()


def test_heights_that_follow_each_other_in_a_list_may_meet() -> None:
    plan = plan_layers(MOVED["steps"], machine("marlin_220", layer_heights=(0.1, 0.3)))

    assert {round(h, 3) for h in plan.height.tolist()} >= {0.1, 0.3}


def test_a_greatest_step_of_ones_own_holds_instead() -> None:
    for step in (0.02, 0.3):
        changes: dict[str, Any] = {"planner__max_step": step, "first_layer_height": 0}
        smooth, other = (
            plan_layers(MOVED["sphere"], machine("marlin_220", planner__smooth=value, **changes))
            for value in (True, False)
        )
        assert smooth.runs() == other.runs()
        assert np.abs(np.diff(smooth.height)).max() <= step + ROUNDING
