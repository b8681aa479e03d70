"""What areas pass over that are moved along a straight way."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer.geometry import Areas, sweep_areas
from printer_slicer.geometry.engine import ENGINES, using_engine
from tests.parts import shape, shapely
from tests.strategies import box, clean_areas


@pytest.mark.parametrize("engine", list(ENGINES))
@given(areas=clean_areas(2), turn=st.integers(0, 359), far=st.floats(0, 6))
def test_swept_areas_are_all_the_places_on_the_way(engine: str, areas: Areas, turn: int, far: float) -> None:
    ways = far * np.array([[np.cos(turn), np.sin(turn)], [0.0, 1.0]])

    with using_engine(engine):
        result = sweep_areas(areas, ways)

    for layer, way in enumerate(ways):
        area, found = shape(areas, layer), shape(result, layer)
        places = [shapely.affinity.translate(area, *(step * way)) for step in np.linspace(-1, 1, 25)]
        passed = shapely.union_all(places)
        assert shapely.area(shapely.difference(passed, found)) < 1e-3
        # Between two places nothing is farther from both than half a step.
        assert shapely.area(shapely.difference(found, passed.buffer(far / 24 + 1e-3))) < 1e-3


@pytest.mark.parametrize("engine", list(ENGINES))
def test_a_way_shorter_than_any_step_is_none(engine: str) -> None:
    areas = Areas.from_rings([[box(0, 0, 10, 10)]])

    with using_engine(engine):
        assert sweep_areas(areas, np.array([[1e-308, 1e-308]])).area() == pytest.approx([100])


def test_a_square_is_longer_by_twice_the_way_and_a_narrow_hole_is_closed() -> None:
    areas = Areas.from_rings([[box(0, 0, 10, 10), box(4, 3, 6, 7)[::-1]]])

    result = sweep_areas(areas, np.array([[1.5, 0.0]]))

    assert result.area() == pytest.approx([13 * 10])
    assert sweep_areas(areas, np.array([[0.0, 1.5]])).area() == pytest.approx([13 * 10 - 2 * 1])
