"""The convex hull contains all points, has only their corners, and is the hull that shapely computes."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from printer_slicer.arrays import Float
from printer_slicer.geometry import convex_hull
from tests.parts import shapely

coarse = st.integers(-5, 5).map(float)  # many points on straight lines, many equal ones
fine = st.floats(-500, 500).map(lambda x: round(x, 9))
grid = st.integers(-(10**7), 10**7).map(lambda steps: steps / 100_000)


def clouds() -> st.SearchStrategy[Float]:
    sizes = st.integers(0, 40).map(lambda n: (n, 2))
    return st.one_of(arrays.arrays(np.float64, sizes, elements=of) for of in (coarse, fine, grid))


@given(clouds())
def test_the_hull_is_that_of_shapely(points: Float) -> None:
    hull, expected = convex_hull(points), shapely.convex_hull(shapely.multipoints(points))
    if expected.area == 0:
        assert hull.n_rings == 0 or hull.area().item() < 1e-12
        return
    ring = shapely.get_coordinates(shapely.orient_polygons(expected))[:-1]

    assert hull.n_layers == hull.n_rings == 1
    assert hull.xy.tolist() == np.roll(ring, -np.lexsort(ring.T[::-1])[0], axis=0).tolist()


def test_a_large_cloud_keeps_only_its_corners() -> None:
    rng = np.random.default_rng(5)
    square = np.array([[0.0, 0.0], [30.0, 0.0], [30.0, 30.0], [0.0, 30.0]])
    sides = square[[0, 1, 2, 3]] + rng.uniform(0, 1, (500, 4, 1)) * (square[[1, 2, 3, 0]] - square)
    points = np.concatenate([rng.uniform(0, 30, (5000, 2)), sides.reshape(-1, 2), square, square])

    assert convex_hull(rng.permutation(points)).xy.tolist() == square.tolist()


def circles(count: int, points: int) -> Float:
    turn = 2 * np.pi * np.arange(points) / points
    circle = 5 * np.column_stack([np.cos(turn), np.sin(turn)])
    return np.concatenate([circle + np.array([7.0 * i, 0.0]) for i in range(count)])


def test_many_round_shapes_in_a_row_have_few_corners_on_the_inside() -> None:
    points = circles(9, 720)
    hull = convex_hull(points)

    assert hull.n_rings == 1
    assert hull.ring_area()[0] > 0
    assert abs(hull.area()[0] - shapely.area(shapely.convex_hull(shapely.MultiPoint(points)))) < 1e-9


def test_points_on_one_line_span_no_area() -> None:
    for points in (np.zeros((0, 2)), np.ones((3, 2)), np.array([[0.1, 0.3], [0.2, 0.6], [0.4, 1.2]])):
        assert convex_hull(points).n_rings == 0
