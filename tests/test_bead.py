"""Four formulas about one bead."""

from __future__ import annotations

from math import pi

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer import bead

heights = st.floats(0.05, 0.8)
ratios = st.floats(1.0, 4.0)


def test_a_bead_as_wide_as_high_is_round() -> None:
    assert bead.cross_section(0.4, 0.4) == pytest.approx(pi * 0.2**2)


def test_the_cross_section_is_a_rectangle_with_a_half_circle_on_each_side() -> None:
    assert bead.cross_section(0.45, 0.2) == pytest.approx(0.25 * 0.2 + pi * 0.1**2)


def test_known_filament_per_mm() -> None:
    # 0.45 x 0.2 mm: 0.08142 mm² of plastic, 2.40528 mm² of filament.
    assert bead.filament_per_mm(0.45, 0.2, 1.75) == pytest.approx(0.0338488, abs=1e-7)


@given(height=heights, ratio=ratios)
def test_beads_one_spacing_apart_fill_the_layer(height: float, ratio: float) -> None:
    width = height * ratio

    assert bead.spacing(width, height) == pytest.approx(width - height * (1 - pi / 4))
    assert bead.cross_section(width, height) == pytest.approx(bead.spacing(width, height) * height)
    assert height * pi / 4 <= bead.spacing(width, height) + 1e-12
    assert bead.spacing(width, height) < width


@given(height=heights, ratio=ratios)
def test_width_for_spacing_is_the_inverse_of_spacing(height: float, ratio: float) -> None:
    assert bead.width_for_spacing(bead.spacing(height * ratio, height), height) == pytest.approx(
        height * ratio
    )


@given(height=heights, ratio=ratios, diameter=st.floats(1, 4))
def test_as_much_filament_goes_in_as_bead_comes_out(height: float, ratio: float, diameter: float) -> None:
    fed = bead.filament_per_mm(height * ratio, height, diameter)

    assert fed * pi * diameter**2 / 4 == pytest.approx(bead.cross_section(height * ratio, height))


@given(height=heights, ratio=ratios)
def test_a_wider_or_higher_bead_holds_more(height: float, ratio: float) -> None:
    width = height * ratio

    assert bead.cross_section(width * 1.01, height) > bead.cross_section(width, height)
    assert bead.cross_section(width, height * 0.99) < bead.cross_section(width, height)


def test_layers_of_different_height_are_worked_out_at_once() -> None:
    height = np.array([0.1, 0.2, 0.3])

    assert bead.spacing(0.45, height).shape == (3,)
    assert bead.spacing(0.45, height).tolist() == [float(bead.spacing(0.45, h)) for h in height]
    assert bead.cross_section(np.full(3, 0.45), height).tolist() == [
        float(bead.cross_section(0.45, h)) for h in height
    ]


@given(height=heights, ratio=ratios)
def test_width_for_section_is_the_inverse_of_cross_section(height: float, ratio: float) -> None:
    width = height * ratio

    assert bead.width_for_section(bead.cross_section(width, height), height) == pytest.approx(width)


def test_what_is_too_little_to_be_pressed_flat_stays_a_round_thread() -> None:
    section = pi * 0.15**2

    assert bead.width_for_section(section, 0.4) == pytest.approx(0.3)
    assert bead.width_for_section(section, 0.3) == pytest.approx(0.3)
