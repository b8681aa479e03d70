"""Layers that are too thick for their print are divided in two."""

from __future__ import annotations

import numpy as np
import pytest

from printer_slicer.model import LayerPlan
from printer_slicer.planning.inexact_layers import divide_layers
from printer_slicer.profile import Profile
from tests.parts import box, profile

MESH = box((10.0, 10.0, 1.0))
PLAN = LayerPlan.from_tops(np.array([0.2, 0.5, 0.8, 1.0]), "optimal")


def settings(**changes: object) -> Profile:
    return profile(planner__kind="optimal", z_step=0.01, first_layer_height=0.2, **changes)


def test_only_the_chosen_layers_are_divided_into_halves() -> None:
    found = divide_layers(PLAN, [0.8], MESH, settings())
    assert found.top == pytest.approx([0.2, 0.5, 0.65, 0.8, 1.0])
    assert found.cut == pytest.approx((found.top + found.bottom) / 2)
    assert found.planner == "optimal"


def test_parts_of_a_layer_have_allowed_heights_if_possible() -> None:
    found = divide_layers(PLAN, [0.5, 0.8], MESH, settings(layer_heights=(0.1, 0.2, 0.3)))
    assert np.sort(np.round(found.height, 6)).tolist() == [0.1, 0.1, 0.2, 0.2, 0.2, 0.2]


def test_layers_of_given_heights_and_those_at_the_limit_of_the_printer_stay() -> None:
    own = settings(planner__ranges="0.5:0.8:layer_height=0.3")
    assert divide_layers(PLAN, [0.8], MESH, own).top == pytest.approx(PLAN.top)
    limited = settings(min_layer=0.16)
    assert divide_layers(PLAN, [0.8], MESH, limited).top == pytest.approx(PLAN.top)
