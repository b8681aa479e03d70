"""Stepwise refinement: slabs of the thickest layer, evenly divided, no steep start missed."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer.model import LayerPlan, Mesh
from printer_slicer.planning.cusp import plan_cusp
from printer_slicer.planning.stepwise import plan_stepwise
from printer_slicer.profile import Profile
from printer_slicer.surface.flats import find_flats
from tests.parts import box, cone, profile, sphere, step_pyramid
from tests.planning.plans import RELAXED, cusp_heights, freely_chosen, frusta, wedge
from tests.planning.test_promises import PARTS, is_kept


def wanted(**changes: Any) -> Profile:
    usual: dict[str, Any] = {"planner__kind": "stepwise", "first_layer_height": 0, "tolerance": 0.1}
    return profile(**(usual | changes))


def planned(mesh: Mesh, **changes: Any) -> LayerPlan:
    return plan_stepwise(mesh, wanted(**changes))


@pytest.mark.parametrize("mesh", PARTS, ids=lambda mesh: f"{mesh.name} {mesh.height:g}")
@pytest.mark.parametrize(
    "changes",
    [{}, {"first_layer_height": 0.2}, {"layer_heights": (0.1, 0.2, 0.3)}, {"layer_heights": (0.2, 0.3)}],
    ids=["any", "first", "three", "two"],
)
def test_a_plan_keeps_the_promises_and_the_list(mesh: Mesh, changes: dict[str, Any]) -> None:
    asked = wanted(**changes)

    plan = plan_stepwise(mesh, asked)

    is_kept(plan, mesh, asked, marches=False)
    allowed = asked.quality.layer_heights or np.arange(8, 33) / 100
    assert set(plan.height[freely_chosen(mesh, plan, asked)]) <= set(np.round(allowed, 7))
    assert plan.planner == "stepwise"


def test_walls_get_the_thickest_layers() -> None:
    assert planned(box((10, 10, 9.6))).runs() == [(30, 0.32)]


def test_a_shallow_cone_gets_the_thinnest_layers() -> None:
    assert planned(cone(40, 4, 64), tolerance=0.04).runs()[0][1] == 0.08


@pytest.mark.parametrize(
    ("degrees", "limit", "slab"),
    [
        # tolerance 0.05: cusp heights up to 0.1
        (45, 0.141, [0.11, 0.11, 0.10]),
        (60, 0.2, [0.16, 0.16]),
        (65, 0.2366, [0.16, 0.16]),
        (30, 0.115, [0.11, 0.11, 0.10]),
        (75, 0.386, [0.32]),
    ],
)
def test_a_slab_is_divided_into_the_fewest_equal_layers(
    degrees: float, limit: float, slab: list[float]
) -> None:
    plan = planned(wedge(degrees), tolerance=0.05)

    assert max(slab) <= limit
    assert plan.height[: 10 * len(slab)].tolist() == slab * 10


def test_every_slab_is_divided_evenly() -> None:
    plan = planned(sphere(20), tolerance=0.05)
    slabs = np.floor((plan.top - 1e-9) / 0.32).astype(int)[:-8]

    for slab in range(slabs[-1]):
        inside = plan.height[:-8][slabs == slab]
        assert inside.sum() == pytest.approx(0.32)
        assert np.ptp(inside) <= 0.01 + 1e-9


@pytest.mark.parametrize(
    ("listed", "degrees", "expected"),
    [
        ((0.1, 0.2, 0.3), 60, [0.1, 0.1, 0.1]),  # two of 0.15 are not in the list
        ((0.08, 0.2), 65, [0.2]),
        ((0.12, 0.2, 0.32), 65, [0.2, 0.12]),  # 0.32 cannot be divided evenly
        ((0.2, 0.3), 60, [0.2, 0.2]),  # nor 0.3 at all: the slab is a little thicker
    ],
)
def test_where_the_list_has_no_even_division_the_slab_takes_what_there_is(
    listed: tuple[float, ...], degrees: float, expected: list[float]
) -> None:
    plan = planned(wedge(degrees), tolerance=0.0501, layer_heights=listed)

    assert plan.height[: 3 * len(expected)].tolist() == expected * 3


def test_slabs_end_on_flats() -> None:
    mesh = step_pyramid([30, 20, 15, 10], [1.13, 2.47, 3.33, 1.0])

    for listed in ((), (0.1, 0.2, 0.3), (0.3,)):
        tops = planned(mesh, layer_heights=listed).top
        assert np.abs(tops[:, None] - find_flats(mesh)[0][1:]).min(axis=0).max() < 1e-9


def test_a_slab_never_leaves_what_a_narrow_printer_cannot_fill() -> None:
    # After one of 0.25 mm, 0.55 would be left: too much for two layers and too little for three.
    assert planned(box((5, 5, 0.8)), min_layer=0.2, max_layer=0.25).runs() == [(4, 0.2)]


@pytest.mark.parametrize("wall", [0.97, 1.05, 1.15, 1.2, 1.27])
def test_a_steep_start_anywhere_in_a_slab_is_found(wall: float) -> None:
    """Greedy by topography looks no higher than the middle of a layer, and misses those in the upper half."""
    mesh = frusta([30, 30, 20], [wall, 2.08 - wall])
    greedy = plan_cusp(mesh, wanted(planner__kind="cusp", planner__metric="topography", tolerance=RELAXED))

    plan = planned(mesh, tolerance=RELAXED)

    assert cusp_heights(mesh, plan).max() <= 2 * RELAXED + 1e-6
    assert plan.height[:3].tolist() == [0.32] * 3
    assert set(plan.height[3:5]) == {0.16}
    assert (cusp_heights(mesh, greedy).max() > 0.3) == (wall > 0.96 + 0.16)


def test_the_whole_slab_pays_for_its_steepest_facet_so_greedy_needs_fewer_layers() -> None:
    for tolerance in (0.05, 0.1):
        greedy = plan_cusp(sphere(), wanted(planner__kind="cusp", tolerance=tolerance))
        assert planned(sphere(), tolerance=tolerance).n_layers > greedy.n_layers


parts = st.lists(
    st.tuples(st.floats(4, 40), st.floats(0.05, 4).map(lambda h: round(h, 3))), min_size=1, max_size=6
).map(lambda rows: frusta([20, *(side for side, _ in rows)], [0.1, *(height for _, height in rows[1:])]))


@pytest.mark.parametrize("listed", [(), (0.08, 0.16, 0.24)])
@given(mesh=parts, tolerance=st.floats(RELAXED, 0.2))
def test_no_facet_exceeds_the_cusp_height(listed: tuple[float, ...], mesh: Mesh, tolerance: float) -> None:
    plan = planned(mesh, tolerance=tolerance, layer_heights=listed)
    over = cusp_heights(mesh, plan) > 2 * tolerance + 1e-5

    assert not (over & (plan.height > 0.0801)).any()


@given(mesh=parts, tolerance=st.floats(0.005, RELAXED))
def test_where_the_thinnest_layer_is_too_thick_only_those_of_the_last_slab_are_thicker(
    mesh: Mesh, tolerance: float
) -> None:
    plan = planned(mesh, tolerance=tolerance)
    over = cusp_heights(mesh, plan) > 2 * tolerance + 1e-5
    last_slab = mesh.height - plan.bottom < 0.32 + 0.08

    assert not (over & (plan.height > 0.0801) & ~last_slab).any()
    assert (plan.height[over] < 0.1601).all()
