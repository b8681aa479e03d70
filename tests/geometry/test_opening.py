"""Areas without what is narrower than some distance."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer.geometry import Areas, fits_circle, intersection, normalize, offset, offset_open
from printer_slicer.geometry.engine import using_engine
from tests.geometry.test_engine import engines, is_clean, is_within
from tests.strategies import box, clean_areas


@engines
def test_opening_drops_what_is_narrower_than_twice_the_distance(engine: str) -> None:
    fin = [box(0, 0, 10, 10), box(10, 4, 15, 4.8)]
    with using_engine(engine):
        stack = normalize(Areas.from_rings([fin, fin, [box(0, 0, 0.5, 9)]]))
        opened = offset_open(stack, np.array([0.5, 0.3, 0.3]))

    assert opened.area() == pytest.approx([100, 104, 0], abs=1e-2)


@engines
def test_opening_leaves_the_points_of_what_is_wide_enough_alone(engine: str) -> None:
    stack = Areas.from_rings([[box(0, 0, 10, 10), box(4, 4, 6, 6)[::-1]]])
    with using_engine(engine):
        opened = offset_open(stack, 1.0)

    assert sorted(opened.xy.tolist()) == sorted(stack.xy.tolist())


@engines
@given(stack=clean_areas(3), distance=st.integers(0, 12))
def test_opened_areas_lie_within_the_original(engine: str, stack: Areas, distance: int) -> None:
    with using_engine(engine):
        opened = offset_open(stack, distance / 8)

        assert is_within(opened, stack)
        assert is_clean(opened)


def test_openings_do_not_go_backward() -> None:
    with pytest.raises(ValueError, match="0 or more"):
        offset_open(Areas.empty(2), np.array([0.1, -0.1]))


@engines
@given(stack=clean_areas(3), distance=st.integers(1, 12))
def test_opened_areas_are_those_that_were_shrunk_and_grown_again(
    engine: str, stack: Areas, distance: int
) -> None:
    by = distance / 8
    with using_engine(engine):
        opened = offset_open(stack, by)
        again = intersection(stack, offset(offset(stack, -by), by + 2e-5))

        assert is_within(opened, again)
        assert is_within(again, opened, 1e-3)


@engines
def test_a_small_ring_with_a_hole_is_dropped_whole(engine: str) -> None:
    ring = [box(0, 0, 1, 1), box(0.4, 0.4, 0.6, 0.6)[::-1]]
    with using_engine(engine):
        opened = offset_open(Areas.from_rings([ring]), 0.6)

    assert not opened.n_rings


@engines
@given(stack=clean_areas(3), distance=st.integers(1, 24))
def test_circles_fit_where_something_is_left_after_shrinking(
    engine: str, stack: Areas, distance: int
) -> None:
    with using_engine(engine):
        assert (fits_circle(stack, distance / 8) == offset(stack, -distance / 8).used).all()
