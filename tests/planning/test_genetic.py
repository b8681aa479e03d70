"""The genetic planner: always a legal plan, the same for the same seed, never worse than it began."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer.model import LayerPlan, Mesh
from printer_slicer.planning.cusp import plan_cusp
from printer_slicer.planning.genetic import plan_genetic
from printer_slicer.profile import Profile
from printer_slicer.surface.flats import find_flats
from tests.effort import crossed
from tests.parts import box, cone, profile, sheared_prism, sphere, step_pyramid
from tests.planning.plans import RELAXED, cusp_heights, freely_chosen, frusta
from tests.planning.test_promises import PARTS, is_kept


def wanted(**changes: Any) -> Profile:
    usual: dict[str, Any] = {"first_layer_height": 0, "tolerance": 0.1, "planner__generations": 25}
    return profile(planner__kind="genetic", **(usual | changes))


def planned(mesh: Mesh, **changes: Any) -> LayerPlan:
    return plan_genetic(mesh, wanted(**changes))


@pytest.mark.parametrize(
    ("mesh", "changes"),
    crossed(PARTS, [{"first_layer_height": 0.2}, {"layer_heights": (0.1, 0.2, 0.3)}, {"tolerance": 0.02}]),
)
def test_a_plan_keeps_the_promises_and_the_list(mesh: Mesh, changes: dict[str, Any]) -> None:
    asked = wanted(**changes)

    plan = plan_genetic(mesh, asked)

    is_kept(plan, mesh, asked, marches=False)
    allowed = asked.quality.layer_heights or np.arange(8, 33) / 100
    assert set(plan.height[freely_chosen(mesh, plan, asked)]) <= set(np.round(allowed, 7))
    assert plan.planner == "genetic"


def test_the_same_seed_gives_the_same_plan() -> None:
    for seed in (0, 7):
        first, again = (planned(sphere(5), planner__seed=seed) for _ in range(2))
        assert np.array_equal(first.top, again.top)


def test_different_seeds_give_different_plans_and_all_are_legal() -> None:
    mesh = sphere(5)
    plans = [planned(mesh, planner__seed=seed) for seed in range(6)]

    assert len({tuple(plan.top) for plan in plans}) > 1
    for plan in plans:
        is_kept(plan, mesh, wanted(), marches=False)
        assert cusp_heights(mesh, plan).max() <= 0.2 + 1e-6


@pytest.mark.parametrize("mesh", [sphere(5), cone(3, 7.77, 12), sheared_prism()], ids=lambda mesh: mesh.name)
@pytest.mark.parametrize("seed", [0, 1])
def test_more_generations_are_never_worse_and_many_are_better(mesh: Mesh, seed: int) -> None:
    counts = [
        planned(mesh, planner__generations=generations, planner__seed=seed).n_layers
        for generations in (1, 5, 20, 60)
    ]

    assert counts == sorted(counts, reverse=True)
    assert counts[-1] < counts[0]


@pytest.mark.parametrize("mesh", [sphere(5), cone(3, 7.77, 12), box()], ids=lambda mesh: mesh.name)
def test_the_search_comes_near_the_greedy_plan_and_not_below(mesh: Mesh) -> None:
    """Over one range of heights the greedy plan has the fewest layers: whoever jumps farthest is never behind."""
    least = plan_cusp(mesh, profile(planner__kind="cusp", first_layer_height=0, tolerance=0.1)).n_layers

    found = planned(mesh, planner__generations=200).n_layers

    assert least <= found <= 1.25 * least


def test_a_handful_of_plans_will_do() -> None:
    plan = planned(sphere(5), planner__population=4, planner__generations=1)

    is_kept(plan, sphere(5), wanted(), marches=False)


def test_flats_are_met() -> None:
    mesh = step_pyramid([30, 20, 15, 10], [1.13, 2.47, 3.33, 1.0])

    for listed in ((), (0.1, 0.2, 0.3), (0.3,)):
        tops = planned(mesh, layer_heights=listed).top
        assert np.abs(tops[:, None] - find_flats(mesh)[0][1:]).min(axis=0).max() < 1e-9


def test_a_part_with_one_possible_plan_gets_it() -> None:
    assert planned(box((5, 5, 1.5)), layer_heights=(0.3,)).runs() == [(5, 0.3)]
    assert planned(box((5, 5, 0.1))).runs() == [(1, 0.1)]


def test_a_first_layer_that_is_the_whole_part_is_the_plan() -> None:
    assert planned(box((5, 5, 0.25)), first_layer_height=0.2).runs() == [(1, 0.25)]


parts = st.lists(
    st.tuples(st.floats(4, 40), st.floats(0.05, 4).map(lambda h: round(h, 3))), min_size=1, max_size=6
).map(lambda rows: frusta([20, *(side for side, _ in rows)], [0.1, *(height for _, height in rows[1:])]))


@pytest.mark.parametrize("listed", [(), (0.08, 0.16, 0.24)])
@given(mesh=parts, tolerance=st.floats(RELAXED, 0.2), seed=st.integers(0, 100))
def test_no_facet_exceeds_the_cusp_height(
    listed: tuple[float, ...], mesh: Mesh, tolerance: float, seed: int
) -> None:
    asked = wanted(tolerance=tolerance, layer_heights=listed, planner__seed=seed)

    plan = plan_genetic(mesh, asked)

    is_kept(plan, mesh, asked, marches=False)
    over = cusp_heights(mesh, plan) > 2 * tolerance + 1e-5
    assert not (over & (plan.height > 0.0801)).any()
