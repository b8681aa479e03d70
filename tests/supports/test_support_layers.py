"""Layers of supports: exact gaps under flats, gaps within the slack under slopes, heights within the limits."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer.arrays import Int
from printer_slicer.model import Areas, LayerPlan, Overhangs
from printer_slicer.profile import load_profile
from printer_slicer.supports.support_layers import list_places_without_room, plan_support_layers

PROFILE = load_profile()
LOW, HIGH = PROFILE.printer.min_layer, 0.75 * PROFILE.printer.nozzle_diameter
GAP, SLACK = PROFILE.quality.support_gap, PROFILE.quality.support_gap_slack
SQUARE = np.array([(0.0, 0.0), (4.0, 0.0), (4.0, 4.0), (0.0, 4.0)])


def hanging(plan: LayerPlan, layers: Int, *, flat: bool = True) -> Overhangs:
    """A square that hangs in each of some layers."""
    area = Areas.from_rings([[SQUARE] if layer in layers else [] for layer in range(plan.n_layers)])
    none = Areas.empty(plan.n_layers)
    return Overhangs(plan, area, np.arange(area.n_rings), none, none, area.used & flat)


def stack(heights: list[int]) -> LayerPlan:
    """Layers of these heights, in hundredths of a mm."""
    return LayerPlan.from_tops(np.round(np.cumsum(heights) / 100, 7))


heights = st.lists(st.integers(10, 30), min_size=3, max_size=60)


@given(heights, st.data())
def test_flats_get_exactly_the_gap(tall: list[int], data: st.DataObject) -> None:
    plan = stack(tall)
    layers = np.array(sorted(data.draw(st.sets(st.integers(1, len(tall) - 1), min_size=1, max_size=6))))
    found = plan_support_layers(hanging(plan, layers), PROFILE)
    room = plan.bottom[layers] - GAP - plan.top[0]

    some = room >= LOW
    assert found.gap[layers[some]] == pytest.approx(GAP, abs=1e-6)
    assert (found.gap[layers[~some & (room >= 0)]] >= GAP - 1e-9).all()
    assert ((found.carrier[layers] >= 0) == (room >= -GAP / 2 - 1e-6)).all()
    rests = layers[found.carrier[layers] >= 0]
    assert found.gap[rests] == pytest.approx(plan.bottom[rests] - found.layers.top[found.carrier[rests]])


@given(heights, st.booleans())
def test_slopes_get_a_gap_within_the_slack(tall: list[int], flat: bool) -> None:
    plan = stack(tall)
    layers = np.arange(1, len(tall))
    found = plan_support_layers(hanging(plan, layers, flat=flat), PROFILE)

    above = layers[plan.bottom[layers] - GAP - plan.top[0] >= LOW]
    most = GAP if flat else GAP + SLACK
    assert (found.gap[above] >= GAP - 1e-6).all()
    assert (found.gap[above] <= most + 1e-6).all()


@given(heights, st.integers(1, 60), st.sampled_from([0.0, 0.1, 0.15, 0.35]))
def test_heights_are_within_the_limits_of_the_printer(tall: list[int], layer: int, gap: float) -> None:
    plan = stack(tall)
    profile = load_profile(changes={"support_gap": gap})
    layers = plan_support_layers(hanging(plan, np.array([layer % plan.n_layers or 1])), profile).layers

    assert (layers.height[1:] >= LOW - 1e-6).all()
    assert (layers.height[1:] <= HIGH + 1e-6).all()
    assert (layers.top[:1] == plan.top[0]).all()


def test_slopes_need_fewer_layers_than_the_part_where_the_slack_allows() -> None:
    plan = LayerPlan.from_tops(np.arange(1, 101) * 0.1)
    every = np.arange(10, 100)

    assert (
        plan_support_layers(hanging(plan, every, flat=False), PROFILE).layers.n_layers < 0.6 * plan.n_layers
    )
    assert plan_support_layers(hanging(plan, every), PROFILE).layers.n_layers > 0.9 * plan.n_layers


def test_flats_far_up_need_the_fewest_layers_possible() -> None:
    plan = LayerPlan.from_tops(np.arange(1, 101) * 0.2)
    layers = plan_support_layers(hanging(plan, np.array([99])), PROFILE).layers

    assert layers.n_layers == 1 + np.ceil((layers.top[-1] - 0.2) / HIGH - 1e-9)
    assert np.ptp(layers.height[1:]) <= 0.02 + 1e-6


def test_what_hangs_lower_than_one_layer_is_told() -> None:
    plan = LayerPlan.from_tops(np.arange(1, 11) * 0.2)
    overhangs = hanging(plan, np.array([1]))
    found = plan_support_layers(overhangs, PROFILE)

    (place,) = list_places_without_room(overhangs, found)
    assert found.layers.n_layers == 1
    assert (place.x, place.y, place.z, place.area) == pytest.approx((2, 2, 0.2, 16))
    assert "no support layer fits" in place.reason


def test_the_first_layer_may_come_as_near_as_half_the_gap() -> None:
    plan = LayerPlan.from_tops(np.array([0.2, 0.3, 0.5]))
    found = plan_support_layers(hanging(plan, np.array([2])), PROFILE)

    assert found.gap[2] == pytest.approx(GAP / 2)
    assert found.layers.top.tolist() == [0.2]


def test_synchronized_supports_end_where_layers_of_the_part_end() -> None:
    plan = stack([20, 24, 16, 20, 28, 12, 20, 20])
    profile = load_profile(changes={"support_synchronize_layers": True})
    found = plan_support_layers(hanging(plan, np.array([7])), profile)

    assert np.isin(found.layers.top, plan.top).all()
    assert found.gap[7] >= GAP - 1e-6
