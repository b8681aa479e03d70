"""Uniform layers: as many as the height asks for, and a last one that fits."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from printer_slicer.errors import PlanError
from printer_slicer.model import LayerPlan, Mesh
from printer_slicer.planning import plan_layers
from printer_slicer.planning.z_steps import fill_with_layers
from tests.parts import box, case_study, profile


def planned(mesh: Mesh, **changes: Any) -> LayerPlan:
    return plan_layers(mesh, profile(**({"first_layer_height": 0} | changes)))


def test_the_case_study_has_825_layers_of_a_tenth() -> None:
    paper = profile("marlin_220_06", quality="case_study", planner__kind="uniform")

    assert plan_layers(case_study(), paper).runs() == [(825, 0.1)]


def test_the_case_study_has_207_layers_of_four_tenths_because_206_stop_short() -> None:
    paper = profile("marlin_220_06", quality="case_study", planner__kind="uniform", layer_height=0.4)

    plan = plan_layers(case_study(), paper)

    assert plan.n_layers == 207
    assert plan.runs() == [(206, 0.4), (1, 0.1)]
    assert plan.top[-1] == 82.5


def test_the_plan_says_who_made_it() -> None:
    assert planned(box()).planner == "uniform"


def test_the_first_layer_may_have_another_height() -> None:
    assert planned(box(), first_layer_height=0.3, layer_height=0.1).runs() == [(1, 0.3), (97, 0.1)]


def test_what_is_left_over_becomes_the_last_layer() -> None:
    assert planned(box((10, 10, 1.3)), layer_height=0.2).runs() == [(6, 0.2), (1, 0.1)]


def test_the_last_layer_shares_with_a_rest_too_thin_to_print() -> None:
    assert planned(box((10, 10, 1.05)), layer_height=0.2).runs() == [(4, 0.2), (1, 0.13), (1, 0.12)]


def test_two_layers_share_a_rest_that_neither_can_take() -> None:
    assert planned(box((10, 10, 0.95)), layer_height=0.3).runs() == [(2, 0.3), (1, 0.18), (1, 0.17)]


def test_sums_of_heights_carry_no_dust() -> None:
    tops = planned(box((5, 5, 100)), layer_height=0.1).top

    assert tops.tolist() == [round(0.1 * (k + 1), 1) for k in range(1000)]


@pytest.mark.parametrize(("height", "top"), [(1.0, 1.0), (1.004, 1.0), (1.006, 1.01), (0.996, 1.0)])
def test_the_top_is_the_step_nearest_to_the_part(height: float, top: float) -> None:
    assert planned(box((5, 5, height))).top[-1] == pytest.approx(top, abs=1e-9)


def test_the_mesh_is_cut_in_the_middle_of_each_layer() -> None:
    plan = planned(box((5, 5, 3)), layer_height=0.2)

    assert plan.cut == pytest.approx(0.1 + 0.2 * np.arange(15))


def test_a_part_thinner_than_any_layer_is_refused_by_name_height_and_limit() -> None:
    with pytest.raises(PlanError, match=r"wafer: 0.05 mm high.*0.08 mm") as caught:
        planned(Mesh(box((5, 5, 0.05)).triangles, "wafer"))

    assert "unit" in caught.value.remedy


def test_a_part_of_one_thinnest_layer_is_one_layer() -> None:
    assert planned(box((5, 5, 0.08)), first_layer_height=0.2).runs() == [(1, 0.08)]


def test_the_top_of_a_part_a_little_higher_than_its_first_layer_is_met() -> None:
    # 0.2 and 0.05 more: one layer of 0.25 would do, and 0.08 over 0.2 stands 0.03 out of the part.
    assert planned(box((5, 5, 0.25)), first_layer_height=0.2).top[-1] == pytest.approx(0.25, abs=0.0051)


def test_a_printer_with_a_narrow_range_still_meets_the_top() -> None:
    # 3.05 mm of 0.2 to 0.3: ten layers of 0.3 leave 0.05, which eleven layers of 0.27 or 0.28 do not.
    plan = planned(box((5, 5, 3.05)), min_layer=0.2, max_layer=0.3, layer_height=0.3)

    assert plan.top[-1] == pytest.approx(3.05, abs=0.0051)


steps = st.integers(1, 40)


@settings(deadline=None)
@given(total=st.integers(1, 4000), step=steps, lowest=steps, highest=steps)
def test_layers_fill_a_height_exactly_if_two_thinnest_are_no_thicker_than_one_thickest(
    total: int, step: int, lowest: int, highest: int
) -> None:
    lowest = min(lowest, step)
    highest = max(highest, step, 2 * lowest)
    total = max(total, lowest)

    heights = fill_with_layers(total, step, lowest, highest)

    assert heights.sum() == total
    assert heights.min() >= lowest
    assert heights.max() <= highest
    assert (heights[:-2] == step).all()


@settings(deadline=None)
@given(total=st.integers(0, 4000), step=steps, lowest=steps, highest=steps)
def test_layers_never_leave_the_limits_and_never_stop_short(
    total: int, step: int, lowest: int, highest: int
) -> None:
    lowest, highest = min(lowest, step), max(highest, step)

    heights = fill_with_layers(total, step, lowest, highest)

    assert total <= heights.sum() < total + lowest
    assert heights.min(initial=lowest) >= lowest
    assert heights.max(initial=highest) <= highest
