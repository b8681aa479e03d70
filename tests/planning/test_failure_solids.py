"""Ten solids on which the area test of the paper fails, and what `optimal` does with them."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest

from printer_slicer.model import LayerPlan, Mesh
from printer_slicer.planning import plan_layers
from printer_slicer.profile import Profile
from printer_slicer.surface import Certificate, certify, find_flats, read_surface
from tests.parts import profile
from tests.planning.failure_solids import SOLIDS, cylinder
from tests.surface.distances import distance_to_mesh, wrong_points

LIMITS: dict[str, Any] = {
    "nozzle_diameter": 0.5,
    "min_layer": 0.1,
    "max_layer": 0.4,
    "z_step": 0.01,
    "first_layer_height": 0,
}
TOLERANCE = 0.05
HALF_A_STEP = 0.00501  # mm; the printer's z_step is 0.01

each_solid = pytest.mark.parametrize("name", SOLIDS)


def paper(**changes: Any) -> Profile:
    """The literal area test with the paper's two thicknesses."""
    return profile(planner__kind="area", thinnest_layer=0.1, thickest_layer=0.4, **(LIMITS | changes))


def optimal(**changes: Any) -> Profile:
    """Fewest layers of four thicknesses within the tolerance."""
    usual: dict[str, Any] = {"layer_heights": (0.1, 0.2, 0.3, 0.4), "tolerance": TOLERANCE}
    return profile(planner__kind="optimal", planner__objective="layers", **(LIMITS | usual | changes))


@cache
def solid(name: str) -> Mesh:
    return SOLIDS[name].make()


@cache
def plans(name: str) -> tuple[LayerPlan, LayerPlan]:
    """The paper's plan and the optimal one."""
    return plan_layers(solid(name), paper()), plan_layers(solid(name), optimal())


def proven(mesh: Mesh, plan: LayerPlan) -> Certificate:
    return certify(read_surface(mesh), plan)


def found(mesh: Mesh, plan: LayerPlan) -> float:
    """How far the worst of the wrong points that were tried is from the surface, mm."""
    points, _ = wrong_points(mesh, plan, 2000, np.random.default_rng(1))
    return float(distance_to_mesh(points, mesh, 0.5).max(initial=0.0))


@each_solid
def test_the_solids_are_closed_and_as_high_as_they_say(name: str) -> None:
    mesh = solid(name)
    edges = np.stack([mesh.triangles, np.roll(mesh.triangles, -1, axis=1)], axis=2).reshape(-1, 2, 3)
    there, back = ({one.tobytes() for one in some} for some in (edges, edges[:, ::-1]))

    assert there == back
    assert mesh.volume > 0
    assert mesh.height == (82.5 if name == "overshoot" else 20)


@each_solid
def test_the_area_test_of_the_paper_fails_as_it_is_known_to(name: str) -> None:
    expected, mesh, plan = SOLIDS[name], solid(name), plans(name)[0]
    error = found(mesh, plan)

    assert plan.n_layers == expected.paper
    assert set(np.round(plan.height, 6)) <= {0.1, 0.4}
    assert error == pytest.approx(expected.paper_error, rel=0.05, abs=2e-4)
    assert error <= proven(mesh, plan).max_error + 1e-6


@pytest.mark.parametrize("name", ["sheared prism", "two wedges", "flange", "slot", "overshoot", "cylinder"])
def test_the_area_test_breaks_the_tolerance_where_it_cannot_see(name: str) -> None:
    mesh, plan = solid(name), plans(name)[0]

    assert found(mesh, plan) > 1.5 * TOLERANCE
    assert proven(mesh, plan).ranges_above(TOLERANCE)


@pytest.mark.parametrize("name", ["draft 0.5", "draft 3", "hemisphere"])
def test_the_area_test_saves_nothing_where_the_area_changes_however_little(name: str) -> None:
    height = plans(name)[0].height

    assert set(np.round(height, 6)) == {0.1}


def test_with_a_thin_first_layer_the_area_test_rises_over_the_part_by_as_much() -> None:
    plan = plans("cylinder")[0]

    assert plan.runs() == [(1, 0.1), (50, 0.4)]
    assert proven(cylinder(), plan).overshoot == pytest.approx(0.1)


def test_without_a_tolerance_for_areas_rounding_breaks_the_thick_layers() -> None:
    plan = plan_layers(cylinder(), paper(planner__tolerance=0, planner__relative_tolerance=0))

    assert plan.n_layers > 75  # 50 would do


@each_solid
def test_optimal_keeps_the_tolerance_by_proof_and_by_trial(name: str) -> None:
    mesh, plan = solid(name), plans(name)[1]
    certificate = proven(mesh, plan)

    assert certificate.max_error <= TOLERANCE + 1e-6
    assert certificate.ranges_above(TOLERANCE) == []
    assert found(mesh, plan) <= certificate.max_error + 1e-6


@each_solid
def test_optimal_needs_no_more_layers_than_are_known_to_do(name: str) -> None:
    assert plans(name)[1].n_layers <= SOLIDS[name].best


@each_solid
def test_optimal_ends_layers_on_all_flats_and_on_the_top(name: str) -> None:
    mesh, plan = solid(name), plans(name)[1]
    ends = np.append(plan.top, 0.0)

    for flat in find_flats(mesh)[0]:
        assert np.abs(ends - flat).min() <= HALF_A_STEP
    assert plan.top[-1] == pytest.approx(mesh.height, abs=HALF_A_STEP)


@each_solid
def test_optimal_takes_only_the_four_heights_apart_from_flats(name: str) -> None:
    mesh, plan = solid(name), plans(name)[1]
    planes = np.append(find_flats(mesh)[0], mesh.height)
    away = [np.abs(ends[:, None] - planes).min(axis=1) > HALF_A_STEP for ends in (plan.bottom, plan.top)]

    assert set(np.round(plan.height[away[0] & away[1]], 6)) <= {0.1, 0.2, 0.3, 0.4}
    assert plan.height.min() >= 0.1 - 1e-9
    assert plan.height.max() <= 0.4 + 1e-9


def test_optimal_makes_a_cylinder_of_thick_layers_only_with_hardly_any_tolerance() -> None:
    assert plan_layers(cylinder(), optimal(tolerance=0.001)).runs() == [(50, 0.4)]


def test_optimal_keeps_a_first_layer_and_the_top_where_the_paper_shifts_the_grid() -> None:
    plan = plan_layers(cylinder(), optimal(first_layer_height=0.1))

    assert plan.height[0] == pytest.approx(0.1)
    assert plan.n_layers <= 51
    assert plan.top[-1] == pytest.approx(20)


@each_solid
def test_optimal_never_needs_more_layers_than_uniform_thin_ones(name: str) -> None:
    thin = plan_layers(solid(name), profile(planner__kind="uniform", layer_height=0.1, **LIMITS))

    assert plans(name)[1].n_layers <= thin.n_layers
