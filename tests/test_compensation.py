"""Outlines are moved by what is asked for, and by nothing else."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer.compensation import compensate
from printer_slicer.geometry import Areas
from printer_slicer.model import LayerPlan, Sections
from tests.parts import plain, shape, shapely
from tests.strategies import box, clean_areas


def nested() -> Areas:
    """A frame with a block in its hole, four layers."""
    rings = [box(0, 0, 20, 20), box(5, 5, 15, 15)[::-1], box(8, 8, 12, 12)]
    return Areas.from_rings([rings] * 4)


def sections(solid: Areas) -> Sections:
    return Sections(LayerPlan.from_tops(0.2 * np.arange(1, solid.n_layers + 1)), solid)


def test_nothing_is_touched_if_nothing_is_asked_for() -> None:
    given_ones = sections(nested())

    assert compensate(given_ones, plain()) is given_ones


@pytest.mark.parametrize("by", [-0.2, 0.15])
def test_outer_outlines_move_and_holes_stay(by: float) -> None:
    made = compensate(sections(nested()), plain(xy_compensation=by))

    assert made.solid.area() == pytest.approx([(20 + 2 * by) ** 2 - 100 + (4 + 2 * by) ** 2] * 4, abs=1e-3)


@pytest.mark.parametrize("by", [-0.2, 0.15])
def test_holes_are_widened_and_what_stands_in_them_is_not_touched(by: float) -> None:
    made = compensate(sections(nested()), plain(hole_compensation=by))

    assert made.solid.area() == pytest.approx([400 - (10 + 2 * by) ** 2 + 16] * 4, abs=1e-3)


def test_the_first_layer_is_inset_and_the_inset_fades_with_height() -> None:
    made = compensate(sections(nested()), plain(elephant_foot=0.2, elephant_foot_height=0.4))

    insets = [0.2, 0.1, 0.0, 0.0]
    wanted = [(20 - 2 * e) ** 2 - (10 + 2 * e) ** 2 + (4 - 2 * e) ** 2 for e in insets]
    assert made.solid.area() == pytest.approx(wanted, abs=1e-3)


def test_without_a_height_only_the_first_layer_is_inset() -> None:
    made = compensate(sections(nested()), plain(elephant_foot=0.2))

    assert (made.solid.area() < nested().area() - 1).tolist() == [True, False, False, False]


def test_thin_walls_keep_their_foot() -> None:
    wall = Areas.from_rings([[box(0, 0, 20, 0.5)]])
    made = compensate(sections(wall), plain(elephant_foot=0.2))

    assert made.solid.area() == pytest.approx([10], abs=1e-2)


@given(solid=clean_areas(2), by=st.floats(0.01, 0.4))
def test_growing_covers_and_shrinking_is_covered(solid: Areas, by: float) -> None:
    grown = compensate(sections(solid), plain(xy_compensation=by, hole_compensation=-by)).solid
    shrunk = compensate(sections(solid), plain(xy_compensation=-by, hole_compensation=by)).solid

    for layer in range(2):
        own = shape(solid, layer)
        assert shapely.area(shapely.difference(own, shape(grown, layer))) < 1e-3
        assert shapely.area(shapely.difference(shape(shrunk, layer), own)) < 1e-3
