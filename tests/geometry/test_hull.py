"""The convex hull is what shapely's is."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from printer_slicer.arrays import Float
from printer_slicer.geometry import convex_hull
from tests.parts import shape, shapely

POINTS = st.lists(st.tuples(st.integers(-9, 9), st.integers(-9, 9)), min_size=1, max_size=40)


@given(POINTS)
@settings(deadline=None)
def test_the_hull_is_that_of_another_library(points: list[tuple[int, int]]) -> None:
    xy = np.array(points, np.float64)
    hull = convex_hull(xy)
    other = shapely.convex_hull(shapely.MultiPoint(xy))

    assert hull.area()[0] == shapely.area(other)
    assert bool(shapely.equals(shape(hull, 0), other)) or shapely.area(other) == 0


def circles(count: int, points: int) -> Float:
    turn = 2 * np.pi * np.arange(points) / points
    circle = 5 * np.column_stack([np.cos(turn), np.sin(turn)])
    return np.concatenate([circle + np.array([7.0 * i, 0.0]) for i in range(count)])


def test_many_round_shapes_in_a_row_have_few_corners_on_the_inside() -> None:
    """Between two arcs only a few points can be dropped at a time: the slow way takes over and gives the same."""
    points = circles(9, 720)
    hull = convex_hull(points)

    assert hull.n_rings == 1
    assert hull.ring_area()[0] > 0
    assert abs(hull.area()[0] - shapely.area(shapely.convex_hull(shapely.MultiPoint(points)))) < 1e-9


def test_no_points_have_no_hull() -> None:
    assert convex_hull(np.zeros((0, 2))).n_rings == 0
