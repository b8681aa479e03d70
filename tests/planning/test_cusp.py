"""The greedy planner: four metrics against values worked out by hand, and what each of them guarantees."""

from __future__ import annotations

from math import sqrt
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer.model import Mesh
from printer_slicer.planning.cusp import METRICS, height_limit, plan_cusp
from printer_slicer.profile import Profile
from printer_slicer.surface.flats import find_flats
from tests.parts import box, box_with_hole, cone, joined, profile, sphere, step_pyramid
from tests.planning.plans import RELAXED, cusp_heights, freely_chosen, frusta, wedge
from tests.planning.test_promises import PARTS, is_kept

each_metric = pytest.mark.parametrize("metric", METRICS)


def wanted(metric: str = "cusp", **changes: Any) -> Profile:
    usual: dict[str, Any] = {"first_layer_height": 0, "tolerance": 0.1}
    return profile(planner__kind="cusp", planner__metric=metric, **(usual | changes))


# --- the promises ---


@each_metric
@pytest.mark.parametrize("mesh", PARTS, ids=lambda mesh: f"{mesh.name} {mesh.height:g}")
@pytest.mark.parametrize(
    "changes",
    [{"first_layer_height": 0.2}, {"layer_heights": (0.1, 0.2, 0.3)}, {"tolerance": 0.02}],
    ids=["first", "list", "fine"],
)
def test_a_plan_keeps_the_promises_and_the_list(metric: str, mesh: Mesh, changes: dict[str, Any]) -> None:
    asked = wanted(metric, **changes)

    plan = plan_cusp(mesh, asked)

    is_kept(plan, mesh, asked, marches=False)
    allowed = asked.quality.layer_heights or np.arange(8, 33) / 100
    assert set(plan.height[freely_chosen(mesh, plan, asked)]) <= set(np.round(allowed, 7))


def test_the_plan_says_who_made_it() -> None:
    assert plan_cusp(box(), wanted()).planner == "cusp"


def test_another_planner_s_profile_gets_the_cusp_metric() -> None:
    other = plan_cusp(sphere(), profile(first_layer_height=0, tolerance=0.1))

    assert other.runs() == plan_cusp(sphere(), wanted()).runs()


# --- the metrics ---


@pytest.mark.parametrize(
    ("metric", "shallow", "diagonal", "steep"),
    [
        # |n_z| = 0.866, 0.707, 0.5; the cusp height is 0.1 mm, so 0.1414 mm are allowed at 45 degrees.
        ("cusp", 0.1155, 0.1414, 0.2),  # 0.1 / n
        ("triangle", 0.1075, 0.1414, 0.1861),  # 0.1414 sqrt(tan): 0.7598, 1, 1.3161
        ("wasserfall", 0.1232, 0.1414, 0.1752),  # 0.1414 * 0.5376 / (0.184 + n / 2): / 0.617, 0.5376, 0.434
        ("topography", 0.0816, 0.1414, 0.2449),  # 0.1414 tan: 0.5774, 1, 1.7321
    ],
)
def test_single_slopes_get_the_height_worked_out_by_hand(
    metric: str, shallow: float, diagonal: float, steep: float
) -> None:
    asked = wanted(metric, tolerance=0.05)
    slopes = np.array([sqrt(3) / 2, sqrt(0.5), 0.5])

    assert height_limit(metric, slopes, asked) == pytest.approx([shallow, diagonal, steep], abs=6e-5)
    for degrees, height in zip((30, 45, 60), (shallow, diagonal, steep), strict=True):
        count, printed = plan_cusp(wedge(degrees), asked).runs()[0]
        assert printed == pytest.approx(np.floor(height * 100) / 100)
        assert count * printed > 3


@each_metric
def test_all_metrics_allow_the_same_height_at_45_degrees(metric: str) -> None:
    for tolerance in (0.03, 0.1, 0.7):
        asked = wanted(metric, tolerance=tolerance)
        assert height_limit(metric, np.array([sqrt(0.5)]), asked) == pytest.approx(2 * tolerance * sqrt(2))


@each_metric
def test_gentler_slopes_never_get_thicker_layers(metric: str) -> None:
    limits = height_limit(metric, np.linspace(0, 1, 500), wanted(metric))

    assert (np.diff(limits) <= 1e-12).all()


@pytest.mark.parametrize(
    ("metric", "worst"), [("cusp", 1), ("triangle", 1), ("wasserfall", 1.112), ("topography", sqrt(2))]
)
def test_no_slope_gets_more_than_the_stated_share_of_the_cusp_height(metric: str, worst: float) -> None:
    slopes = np.linspace(1e-6, 1, 2000)
    cusps = slopes * height_limit(metric, slopes, wanted(metric, tolerance=0.05)) / 0.1

    assert cusps.max() == pytest.approx(worst, abs=2e-3)


@pytest.mark.parametrize(
    ("metric", "in_diagonals"), [("triangle", 1 / (1.44 * 0.184)), ("wasserfall", 0.53755 / 0.184)]
)
def test_the_bulge_of_the_bead_bounds_layers_on_walls(metric: str, in_diagonals: float) -> None:
    asked = wanted(metric, tolerance=0.02)

    limit = height_limit(metric, np.array([0.0]), asked)

    assert limit == pytest.approx(0.04 * sqrt(2) * in_diagonals, rel=1e-4)
    assert plan_cusp(box(), asked).runs()[0][1] == pytest.approx(np.floor(limit[0] * 100) / 100)


def test_one_sided_layers_may_be_half_as_thick() -> None:
    both, outside = (plan_cusp(wedge(30), wanted(containment=side)) for side in ("mid", "positive"))

    assert both.runs()[0][1] == pytest.approx(0.23)
    assert outside.runs()[0][1] == pytest.approx(0.11)


# --- what comes out ---


@each_metric
def test_walls_get_the_thickest_layers(metric: str) -> None:
    for mesh in (box((10, 10, 9.6)), box_with_hole((20, 20, 9.6))):
        assert plan_cusp(mesh, wanted(metric)).runs() == [(30, 0.32)]


@each_metric
def test_a_shallow_cone_gets_the_thinnest_layers(metric: str) -> None:
    plan = plan_cusp(cone(40, 4, 64), wanted(metric, tolerance=0.04))

    assert set(plan.height[:-2]) == {0.08}


@each_metric
def test_a_wall_beside_a_slope_is_as_thin_as_the_slope(metric: str) -> None:
    beside = joined([wedge(30), box((5, 5, 4), (40, 0, 0))])

    assert plan_cusp(beside, wanted(metric)).runs() == plan_cusp(wedge(30), wanted(metric)).runs()


def test_flats_are_the_ends_of_layers_for_the_metrics_that_have_flats() -> None:
    mesh = step_pyramid([30, 20, 15, 10], [1.13, 2.47, 3.33, 1.0])
    flats = find_flats(mesh)[0][1:]

    for metric in ("cusp", "wasserfall"):
        plan = plan_cusp(mesh, wanted(metric, layer_heights=(0.1, 0.3)))
        assert np.abs(plan.top[:, None] - flats).min(axis=0).max() < 1e-9
    blind = plan_cusp(mesh, wanted("topography", layer_heights=(0.1, 0.3)))
    assert np.abs(blind.top[:, None] - flats).min(axis=0).max() > 0.05


def test_without_flats_a_layer_over_one_is_thin_for_triangle_and_as_ever_for_topography() -> None:
    mesh = step_pyramid([30, 20], [1.15, 2.0])

    thin, blind = (
        plan_cusp(mesh, wanted(metric, layer_heights=(0.1, 0.3))) for metric in ("triangle", "topography")
    )

    assert thin.height[(thin.bottom < 1.15) & (thin.top > 1.15)].tolist() == [0.1]
    assert blind.runs()[0] == (10, 0.3)


def test_topography_does_not_see_a_slope_that_begins_in_the_upper_half_of_a_layer() -> None:
    early, late = (frusta([30, 30, 20], [0.96 + wall, 0.72 - wall]) for wall in (0.1, 0.2))
    asked = wanted("topography", tolerance=0.05)

    plan = plan_cusp(late, asked)

    assert plan_cusp(early, asked).height[3] < 0.32
    assert plan.height[:4].tolist() == [0.32] * 4
    assert cusp_heights(late, plan)[3] > 0.3
    assert cusp_heights(late, plan_cusp(late, wanted(tolerance=0.05))).max() <= 0.1 + 1e-6


parts = st.lists(
    st.tuples(st.floats(4, 40), st.floats(0.05, 4).map(lambda h: round(h, 3))), min_size=1, max_size=6
).map(lambda rows: frusta([20, *(side for side, _ in rows)], [height for _, height in rows]))


@pytest.mark.parametrize("listed", [(), (0.08, 0.16, 0.24)])
@given(mesh=parts, tolerance=st.floats(RELAXED, 0.2))
def test_no_facet_exceeds_the_cusp_height(listed: tuple[float, ...], mesh: Mesh, tolerance: float) -> None:
    for metric, share in (("cusp", 1), ("triangle", 1), ("wasserfall", 1.112)):
        asked = wanted(metric, tolerance=tolerance, layer_heights=listed)
        if mesh.height < 0.09:
            continue
        plan = plan_cusp(mesh, asked)
        over = cusp_heights(mesh, plan) > share * 2 * tolerance + 1e-5

        assert not (over & (plan.height > 0.0801)).any()


@given(mesh=parts, tolerance=st.floats(0.005, RELAXED))
def test_where_the_thinnest_layer_is_too_thick_only_a_few_below_the_top_are_thicker(
    mesh: Mesh, tolerance: float
) -> None:
    """Layers of 8 and 9 steps have any sum over 56: of eight layers all but seven can be the thinnest."""
    if mesh.height < 0.09:
        return
    plan = plan_cusp(mesh, wanted(tolerance=tolerance))
    over = (cusp_heights(mesh, plan) > 2 * tolerance + 1e-5) & (plan.height > 0.0801)

    assert not (over & (mesh.height - plan.bottom > 8 * 0.09)).any()
    assert (plan.height[over] < 0.1601).all()


def test_the_heights_follow_the_curve_of_a_sphere() -> None:
    plan = plan_cusp(sphere(20), wanted(tolerance=0.05))
    middle = plan.n_layers // 2

    assert plan.height[middle] == pytest.approx(0.32)
    assert plan.height[2] < 0.13
    assert plan.height[-3] < 0.13
