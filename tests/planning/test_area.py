"""The paper's planner: tables 1 and 2 of the paper, its steps against a second writing of them, its two mends."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer.model import LayerPlan, Mesh
from printer_slicer.placing import place
from printer_slicer.planning import plan_layers
from printer_slicer.profile import Profile
from tests.parts import (
    CASE_STUDY_LEVELS,
    box,
    case_study,
    cone,
    joined,
    loft,
    profile,
    pyramid,
    sheared_prism,
    step_pyramid,
    two_boxes,
)

LITERAL = {"planner__aligned": False}
GUARDED = {"planner__aligned": False, "planner__guarded": True}
ALIGNED = {"planner__aligned": True}


def paper(**changes: Any) -> Profile:
    """0.1 and 0.4 mm, as in the paper."""
    return profile("marlin_220_06", quality="case_study", **changes)


def heights(plan: LayerPlan) -> list[float]:
    return [float(h) for h in plan.height]


# --- the tables ---


def test_table_1_of_the_paper_describes_the_case_study() -> None:
    mesh = case_study()

    assert mesh.n_facets == 28
    assert len(mesh.triangles.reshape(-1, 3)) == 84
    assert tuple(np.unique(mesh.triangles[:, :, 2])) == CASE_STUDY_LEVELS
    assert np.diff(CASE_STUDY_LEVELS).tolist() == [30, 22.5, 30]
    assert mesh.size.tolist() == [50, 50, 82.5]


@pytest.mark.parametrize(
    ("variant", "runs"),
    [
        (LITERAL, [(1, 0.1), (75, 0.4), (224, 0.1), (75, 0.4)]),
        (ALIGNED, [(75, 0.4), (225, 0.1), (75, 0.4)]),
        (GUARDED, [(1, 0.1), (74, 0.4), (228, 0.1), (75, 0.4)]),
    ],
    ids=["literal", "aligned", "guarded"],
)
def test_table_2_of_the_paper_gives_the_runs_of_the_case_study(
    variant: dict[str, Any], runs: list[tuple[int, float]]
) -> None:
    plan = plan_layers(case_study(), paper(**variant))

    assert plan.runs() == runs
    assert plan.n_layers == sum(count for count, _ in runs)


def test_54_percent_of_the_layers_are_saved() -> None:
    thin = plan_layers(case_study(), paper(planner__kind="uniform")).n_layers
    variable = plan_layers(case_study(), paper(**LITERAL)).n_layers

    assert int(100 * (1 - variable / thin)) == 54


@pytest.mark.parametrize("variant", [LITERAL, GUARDED, ALIGNED], ids=["literal", "guarded", "aligned"])
def test_coordinates_as_rounded_in_an_stl_file_far_from_the_origin_change_nothing(
    variant: dict[str, Any],
) -> None:
    rounded = Mesh(case_study().moved((77.7, -31.3, 12.5)).triangles.astype(np.float32).astype(np.float64))
    settings_ = paper(**variant)

    placed = place(rounded, settings_.printer)

    assert plan_layers(placed, settings_).runs() == plan_layers(case_study(), settings_).runs()


def test_a_top_that_an_stl_file_rounds_down_costs_the_guarded_march_no_layers() -> None:
    # 12.1 + 82.5 becomes 94.5999985 in single precision: the plane at 82.5 then lies in the air by 0.001 µm.
    rounded = Mesh(case_study().moved((0.0, 0.0, 12.1)).triangles.astype(np.float32).astype(np.float64))
    guarded = paper(**GUARDED)

    assert plan_layers(place(rounded, guarded.printer), guarded).runs() == [
        (1, 0.1),
        (74, 0.4),
        (228, 0.1),
        (75, 0.4),
    ]


def test_without_any_tolerance_rounding_breaks_the_thick_runs() -> None:
    rounded = Mesh(case_study().moved((77.7, -31.3, 0.0)).triangles.astype(np.float32).astype(np.float64))
    strict = paper(**LITERAL, planner__tolerance=0, planner__relative_tolerance=0)

    assert plan_layers(rounded, strict).n_layers > 375


# --- literal and guarded steps, written a second time ---


def march(
    area: Callable[[float], float], part: float, thin: float, thick: float, *, guarded: bool
) -> list[float]:
    """The paper's steps in plain words: a look ahead at each plane, areas from a formula."""
    size, z = 1000, round(thin * 1000)
    result = [z]
    while z < round(part * size):
        ahead = [z + round(thin * size)]
        if guarded:
            ahead = [
                *range(z + round(thin * size), z + round(thick * size), round(thin * size)),
                z + round(thick * size),
            ]
        same = all(abs(area(z / size) - area(there / size)) < 1e-6 for there in ahead)
        result.append(round((thick if same else thin) * size))
        z += result[-1]
    return [step / size for step in result]


def blocks_area(sides: list[int], tops: list[float]) -> Callable[[float], float]:
    """Area of blocks on each other; on a flat the one below counts, over the top nothing does."""
    return lambda z: float(next((s**2 for s, top in zip(sides, tops, strict=True) if z <= top + 1e-9), 0))


@given(
    blocks=st.lists(st.integers(1, 60), min_size=1, max_size=4),
    thick=st.sampled_from([0.1, 0.2, 0.25, 0.3, 0.4]),
    guarded=st.booleans(),
)
def test_the_march_is_the_papers_for_blocks_of_any_height(
    blocks: list[int], thick: float, guarded: bool
) -> None:
    sides, levels = [20, 13, 8, 5][: len(blocks)], [height / 20 for height in blocks]
    tops = np.cumsum(levels).tolist()
    chosen = paper(**LITERAL, planner__guarded=guarded, thickest_layer=thick)
    if tops[-1] < 0.1:
        return

    plan = plan_layers(step_pyramid(sides, levels), chosen)

    assert heights(plan) == pytest.approx(
        march(blocks_area(sides, tops), tops[-1], 0.1, thick, guarded=guarded)
    )


def test_the_march_gives_thin_layers_on_every_slope() -> None:
    assert plan_layers(pyramid(), paper(**LITERAL)).runs() == [(200, 0.1)]
    assert plan_layers(cone(), paper(**GUARDED)).runs() == [(200, 0.1)]


def test_the_first_layer_height_replaces_the_thin_one_at_the_bottom() -> None:
    plan = plan_layers(box((10, 10, 4.3)), paper(**LITERAL, first_layer_height=0.3))

    assert plan.runs() == [(1, 0.3), (10, 0.4)]


def test_equal_areas_in_other_places_pass_for_no_change() -> None:
    """The paper's test is blind to a leaning part; this is said in the planner's description."""
    assert plan_layers(sheared_prism(), paper(**LITERAL)).runs() == [(1, 0.1), (50, 0.4)]


def flange() -> Mesh:
    """A box of 20 with a rim of 0.2 from 10.15 to 10.35, between planes that are 0.4 apart."""
    return joined([box((20, 20, 20)), box((24, 24, 0.2), (-2, -2, 10.15))])


def test_a_flange_between_planes_is_noticed_by_the_guarded_march_only() -> None:
    """Guarded, the layers around the flange are thin; literally, one thick layer jumps over part of it."""

    def thickest_beside_flange(plan: LayerPlan) -> float:
        near = (plan.top > 10.15) & (plan.bottom < 10.35)
        return float(plan.height[near].max())

    guarded = plan_layers(flange(), paper(**GUARDED, first_layer_height=0.1))

    assert thickest_beside_flange(guarded) == pytest.approx(0.1)
    assert thickest_beside_flange(
        plan_layers(flange(), paper(**LITERAL, first_layer_height=0.2))
    ) == pytest.approx(0.4)


@pytest.mark.parametrize(
    "mesh", [case_study(), step_pyramid([20, 12, 5], [3.3, 0.7, 2.2])], ids=lambda m: m.name
)
def test_guarded_thick_layers_hold_one_area_from_bottom_to_top(mesh: Mesh) -> None:
    plan = plan_layers(mesh, paper(**GUARDED))
    levels = np.unique(mesh.triangles[:, :, 2])

    for bottom, top in zip(plan.bottom[1:], plan.top[1:], strict=True):
        inside = levels[(levels > bottom + 1e-9) & (levels < top - 1e-9)]
        assert top - bottom < 0.11 or len(inside) == 0


# --- aligned ---


block_heights = st.lists(st.integers(4, 60), min_size=1, max_size=4)


@given(blocks=block_heights, first=st.sampled_from([0, 0.1, 0.2, 0.3]))
def test_no_aligned_layer_crosses_a_flat(blocks: list[int], first: float) -> None:
    levels = [height / 10 for height in blocks]
    flats = np.cumsum(levels)

    plan = plan_layers(step_pyramid([20, 13, 8, 5][: len(blocks)], levels), paper(first_layer_height=first))

    assert np.abs(plan.top[:, None] - flats[None]).min(axis=0).max() < 1e-6
    assert plan.top[-1] == pytest.approx(flats[-1])


@given(blocks=block_heights)
def test_aligned_blocks_need_no_more_layers_than_thick_ones_and_one_for_the_rest(blocks: list[int]) -> None:
    levels = [height / 10 for height in blocks]

    plan = plan_layers(step_pyramid([20, 13, 8, 5][: len(blocks)], levels), paper())

    assert plan.n_layers <= sum(int(np.ceil(level / 0.4 - 1e-9)) + 1 for level in levels)


def test_slopes_between_levels_get_thin_layers_and_walls_thick_ones() -> None:
    plan = plan_layers(case_study(), paper())

    on_slope = (plan.bottom > 30 - 1e-6) & (plan.top < 52.5 + 1e-6)
    assert np.unique(plan.height[on_slope]).tolist() == [0.1]
    assert np.unique(plan.height[~on_slope]).tolist() == [0.4]


@pytest.mark.parametrize(
    "mesh", [pyramid(), pyramid(20, 19.97), cone()], ids=["pyramid", "odd pyramid", "cone"]
)
def test_aligned_layers_are_thin_where_no_area_stays_the_same(mesh: Mesh) -> None:
    plan = plan_layers(mesh, paper())

    assert (plan.height[:-2] <= 0.1 + 1e-9).all()
    assert (plan.height[-2:] < 0.2).all()
    assert plan.top[-1] == pytest.approx(mesh.height, abs=0.0051)


def test_two_parts_of_different_height_are_one_region_each_up_to_the_lower_one() -> None:
    parts = joined([box((10, 10, 4)), box((10, 10, 10), (20, 0, 0))])

    plan = plan_layers(parts, paper())

    assert plan.runs() == [(25, 0.4)]
    assert 4.0 in np.round(plan.top, 6)


def test_a_flat_off_the_thick_grid_ends_a_layer() -> None:
    parts = joined([box((10, 10, 4.1)), box((10, 10, 10), (20, 0, 0))])

    plan = plan_layers(parts, paper())

    assert 4.1 in np.round(plan.top, 6)
    assert plan.top[-1] == 10


def test_a_wall_between_slopes_too_low_for_a_thick_layer_stays_thin() -> None:
    rings = [side * np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]) for side in (9, 6, 6, 3)]
    mesh = Mesh(loft(rings, [0.0, 3.0, 3.3, 6.3]))

    assert plan_layers(mesh, paper()).runs() == [(63, 0.1)]


def test_blocks_too_low_for_a_thick_layer_get_one_layer_each() -> None:
    plan = plan_layers(step_pyramid([20, 15, 10], [0.3, 0.3, 0.3]), paper())

    assert plan.runs() == [(3, 0.3)]


def test_a_flat_that_lies_exactly_on_a_plane_belongs_to_the_section_below() -> None:
    # Three planes of 0.1 end at 0.3, however 3 * 0.1 is rounded.
    plan = plan_layers(step_pyramid([20, 13], [0.3, 0.1]), paper(**LITERAL, thickest_layer=0.2))

    assert plan.runs() == [(1, 0.1), (1, 0.2), (1, 0.1)]


def test_a_tolerance_lets_a_slight_draft_pass_for_a_wall() -> None:
    """0.5° of draft over 20 mm: the area changes by a share of 0.0002 for each tenth of a mm."""
    foot = np.array([(-10.0, -10.0), (10.0, -10.0), (10.0, 10.0), (-10.0, 10.0)])
    stump = Mesh(loft([foot, foot * (1 - 0.0175 * 2 / 2)], [0.0, 20.0]))
    blind, sharp = paper(planner__relative_tolerance=0.05), paper(planner__relative_tolerance=1e-6)

    assert plan_layers(stump, blind).runs() == [(50, 0.4)]
    assert plan_layers(stump, sharp).runs() == [(200, 0.1)]


@pytest.mark.parametrize("height", [0.1, 0.15, 0.2])
def test_a_part_no_higher_than_its_first_layer_is_one_layer(height: float) -> None:
    adaptive = profile(planner__kind="area", planner__aligned=True, first_layer_height=0.2)

    plan = plan_layers(box((10, 10, height)), adaptive)

    assert plan.n_layers == 1
    assert plan.top[0] == pytest.approx(height)


def test_the_last_thick_layer_of_the_march_is_cut_in_the_material_it_contains() -> None:
    plan = plan_layers(two_boxes((5, 5, 4.0)), paper(**LITERAL))

    assert plan.top[-1] > 4.0
    assert plan.bottom[-1] < plan.cut[-1] < 4.0


def test_runs_add_up_to_the_plan() -> None:
    plan = plan_layers(case_study(), paper())

    assert sum(n for n, _ in plan.runs()) == plan.n_layers
    assert sum(n * h for n, h in plan.runs()) == pytest.approx(plan.top[-1])
    assert all(a[1] != b[1] for a, b in pairwise(plan.runs()))
