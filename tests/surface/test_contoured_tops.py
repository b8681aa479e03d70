"""The errors of layers with contoured tops: against integrals over columns, and the planner's tables against them."""

from __future__ import annotations

import numpy as np
import pytest

from printer_slicer.arrays import Float
from printer_slicer.contouring import make_contour_rule
from printer_slicer.model import ContourRule, LayerPlan, Mesh
from printer_slicer.planning import plan_layers
from printer_slicer.planning.candidate_layers import CandidateLayers
from printer_slicer.planning.height_grid import HeightGrid
from printer_slicer.planning.z_steps import ZSteps
from printer_slicer.surface import certify, read_surface
from printer_slicer.surface.contoured_tops import measure_slopes
from printer_slicer.values import replace
from tests.contoured_parts import wedge as make_wedge
from tests.parts import box, joined, layers, profile, pyramid, sphere

WIDTH = 0.45
RULE = ContourRule(0.05, WIDTH, 0.0, 0.0125, 1.0)


def wedge(degrees: float) -> Mesh:
    return make_wedge(degrees, (30.0, 10.0))


def contoured(plan: LayerPlan, rule: ContourRule = RULE) -> LayerPlan:
    return replace(plan, contour_rule=rule)


def sum_columns(plan: LayerPlan, slope: float, length: float, width: float, n: int = 400_000) -> float:
    """The volume error of a contoured wedge, column by column; no other error is in it."""
    x = (np.arange(n) + 0.5) / n * length
    z = 1.0 + slope * x
    layer = np.minimum(np.searchsorted(plan.top, z), plan.n_layers - 1)
    height = z - plan.bottom[layer]
    error = np.where(height < RULE.min_height, np.minimum(height, RULE.min_height - height), 0.0)
    error += np.where(height > RULE.min_height / 2, WIDTH / 4 * slope, 0.0)
    return float(error.mean()) * length * width


@pytest.mark.parametrize("slope_deg", [5.0, 10.0, 15.0, 20.0])
@pytest.mark.parametrize("height", [0.2, 0.3])
def test_the_volume_error_of_a_wedge_is_that_of_its_columns(slope_deg: float, height: float) -> None:
    mesh, slope = wedge(slope_deg), float(np.tan(np.deg2rad(slope_deg)))
    plan = contoured(layers(int(np.ceil(mesh.height / height)), height))
    found = certify(read_surface(mesh), plan)
    assert found.volume_error == pytest.approx(sum_columns(plan, slope, 30.0, 10.0), rel=2e-3)


def test_the_deviation_is_that_of_half_a_width() -> None:
    mesh, plan = wedge(10.0), layers(31, 0.2)
    half = WIDTH / 2 * np.sin(np.deg2rad(10)) + RULE.tolerance
    for rule, contoured_bound in ((RULE, half), (replace(RULE, min_height=0.2), 0.1 + RULE.tolerance)):
        level, found = (certify(read_surface(mesh), one).bound for one in (plan, contoured(plan, rule)))
        sloped = plan.bottom >= 1.0 - 1e-9
        assert found[sloped] == pytest.approx(contoured_bound)
        assert np.array_equal(found[~sloped], level[~sloped])


def test_level_layers_count_where_another_surface_is_in_the_layer() -> None:
    plan = layers(28, 0.2)
    steep = pyramid(10.0, 3.0).moved((60.0, 0.0, 0.0))  # up to z = 3
    mesh = joined([wedge(10.0), steep])
    level, found = (certify(read_surface(mesh), one).bound for one in (plan, contoured(plan)))
    half = WIDTH / 2 * np.sin(np.deg2rad(10)) + RULE.tolerance
    beside = (plan.bottom >= 1.0 - 1e-9) & (plan.bottom < 3.0 - 1e-9)
    assert found[beside] == pytest.approx(np.maximum(level[beside], half))
    assert found[plan.bottom >= 3.0 - 1e-9] == pytest.approx(half)
    assert level[beside].min() > half


def test_facets_that_lean_by_rounding_only_are_vertical() -> None:
    corners = np.array([[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, lean, 9.0]] for lean in (0.0, 5e-6, -5e-6)])
    assert (measure_slopes(corners) == 0).all()
    up = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 1.0]])
    level = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    found = measure_slopes(np.stack([up, up[::-1], level, level[::-1]]))
    assert found == pytest.approx([1.0, np.inf, 0.0, np.inf])


def test_the_worst_layer_names_a_contoured_facet() -> None:
    mesh = wedge(25.0)
    found = certify(read_surface(mesh), contoured(layers(100, 0.2)))
    worst = found.worst
    assert worst.kind == "contoured facet"
    assert worst.bound == found.max_error == found.bound[worst.layer - 1] > 0.1
    assert found.plan.bottom[worst.layer - 1] <= worst.z <= found.plan.top[worst.layer - 1]


@pytest.mark.parametrize("mesh", [box(), pyramid(10.0, 20.0)], ids=["box", "steep pyramid"])
def test_parts_without_shallow_tops_have_the_errors_of_level_layers(mesh: Mesh) -> None:
    plan = layers(int(np.ceil(mesh.height / 0.25)), 0.25)
    level, found = (certify(read_surface(mesh), one) for one in (plan, contoured(plan)))
    assert np.array_equal(found.bound, level.bound)
    if mesh.name != "box":  # the top of a box is level
        assert np.array_equal(found.volume, level.volume)


def test_steeper_facets_are_contoured_in_thicker_layers() -> None:
    mesh, volumes = wedge(20.0), list[Float]()
    for height in (0.1, 0.2):
        plan = layers(int(np.ceil(mesh.height / height)), height)
        level, found = (certify(read_surface(mesh), one).volume_error for one in (plan, contoured(plan)))
        volumes.append(np.array([level, found]))
    assert volumes[0][0] == volumes[0][1]  # 0.45 mm x tan(20 degrees) is more than 1.2 x 0.1 mm
    assert volumes[1][1] < volumes[1][0]


@pytest.mark.parametrize("mesh", [wedge(8.0), sphere(5.0), joined([wedge(15.0), box((5, 5, 7), (60, 0, 0))])])
def test_the_tables_of_the_planner_agree_with_certificates(mesh: Mesh) -> None:
    settings = profile(z_contouring=True, planner__kind="optimal", z_step=0.01, first_layer_height=0.2)
    steps = ZSteps(mesh, settings)
    grid = HeightGrid.of(steps)
    candidates = CandidateLayers.for_part(mesh, grid, steps, settings)
    graph, rule = candidates.graph, make_contour_rule(settings)
    bottom_of, top_of = (np.asarray(grid.unit * nodes, np.float64) for nodes in (graph.start, graph.end))
    for height in (0.1, 0.2, 0.3):
        of_height = np.flatnonzero(np.isclose(top_of - bottom_of, height))
        bottom = bottom_of[of_height]
        for offset in range(3):
            chain, at = list[int](), offset * 0.1
            for arc in of_height[np.argsort(bottom, kind="stable")].tolist():
                if bottom_of[arc] >= at - 1e-9 and top_of[arc] < mesh.height - 1e-6:
                    chain.append(arc)
                    at = float(top_of[arc])
            cut = (bottom_of[chain] + top_of[chain]) / 2
            plan = LayerPlan(top_of[chain], cut, base=bottom_of[chain], contour_rule=rule)
            found = certify(read_surface(mesh), plan)
            assert (candidates.bound[chain] >= found.bound - 1e-6).all()
            # The volume above the last layer is in its error.
            assert candidates.volume[chain[:-1]] == pytest.approx(found.volume[:-1], rel=0.02, abs=0.02)


def test_planners_with_a_tolerance_follow_only_slopes_that_keep_it() -> None:
    mesh = joined([sphere(8.0), box((2, 2, 2), (-1, -1, 14))])
    usual, aware = (
        plan_layers(mesh, profile(z_contouring=on, planner__kind="optimal", planner__objective="time"))
        for on in (False, True)
    )
    assert aware.contour_rule is not None
    largest = aware.contour_rule.bound_deviations(np.array([aware.contour_rule.steepest]))
    assert largest == pytest.approx(0.12)
    assert (
        aware.n_layers <= usual.n_layers
    )  # slopes that extrusions cannot follow well do not make layers thin
    assert certify(read_surface(mesh), aware).max_error <= 0.12 + 1e-6
    for tolerance, planner, is_followed in ((0.03, "optimal", False), (0.03, "uniform", True)):
        settings = profile(z_contouring=True, tolerance=tolerance, planner__kind=planner)
        assert (make_contour_rule(settings) is not None) == is_followed


def test_the_planner_uses_thicker_layers_under_contoured_tops() -> None:
    mesh = wedge(8.0)
    usual, aware = (
        plan_layers(mesh, profile(z_contouring=on, planner__kind="optimal", planner__error_price=20.0))
        for on in (False, True)
    )
    surface = read_surface(mesh)
    assert aware.contour_rule is not None
    assert aware.n_layers < 0.75 * usual.n_layers
    assert certify(surface, aware).volume_error < certify(surface, usual).volume_error
