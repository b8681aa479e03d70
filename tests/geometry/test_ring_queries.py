"""Points in rings and ways across rings, against shapely."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer.arrays import Float, Int
from printer_slicer.geometry import Areas, crosses_rings, crossings, find_enclosing_rings
from tests.parts import shapely
from tests.strategies import box, clean_areas

stacks = clean_areas(3)
seeds = st.integers(0, 10**6)


def scattered(seed: int, count: int = 40) -> tuple[Float, Int]:
    """Points over and around the areas that the strategies make, and their layers."""
    rng = np.random.default_rng(seed)
    return rng.uniform(-30, 30, (count, 2)), np.sort(rng.integers(0, 3, count))


# --- points in rings ---


@given(areas=stacks, seed=seeds)
def test_the_smallest_ring_around_a_point_is_found(areas: Areas, seed: int) -> None:
    points, layer = scattered(seed)
    rings = [shapely.Polygon(areas.ring(i)) for i in range(areas.n_rings)]

    found = find_enclosing_rings(areas, points, layer)

    for point, k, ring in zip(points, layer.tolist(), found.tolist(), strict=True):
        around = [
            i
            for i, other in enumerate(rings)
            if areas.ring_layer[i] == k and other.contains(shapely.Point(point))
        ]
        assert ring == min(around, key=lambda i: rings[i].area, default=-1)


def test_a_point_in_nested_rings_is_in_the_innermost() -> None:
    nested = Areas.from_rings([[box(2, 2, 8, 8)[::-1], box(0, 0, 10, 10), box(4, 4, 6, 6)]])
    points = np.array([(5.0, 5.0), (3.0, 3.0), (1.0, 1.0), (11.0, 5.0)])

    assert find_enclosing_rings(nested, points, np.zeros(4, np.int64)).tolist() == [2, 0, 1, -1]


def test_rings_of_other_layers_do_not_count() -> None:
    areas = Areas.from_rings([[box(0, 0, 1, 1)], [], [box(0, 0, 9, 9)]])
    points = np.full((3, 2), 0.5)

    assert find_enclosing_rings(areas, points, np.array([0, 1, 2])).tolist() == [0, -1, 1]


def test_no_points_and_no_rings_are_nothing() -> None:
    nothing = np.zeros((0, 2)), np.zeros(0, np.int64)

    assert find_enclosing_rings(Areas.from_rings([[box(0, 0, 1, 1)]]), *nothing).tolist() == []
    assert find_enclosing_rings(Areas.empty(1), np.zeros((2, 2)), np.zeros(2, np.int64)).tolist() == [-1, -1]


# --- ways across rings ---


@given(areas=stacks, seed=seeds)
def test_crossings_of_ways_and_rings_are_counted(areas: Areas, seed: int) -> None:
    begin, layer = scattered(seed)
    end, _ = scattered(seed + 1)

    found = crossings(areas, begin, end, layer)

    for a, b, k, count in zip(begin, end, layer.tolist(), found.tolist(), strict=True):
        way = shapely.LineString([a, b])
        rings = map(shapely.LinearRing, areas.rings(k))
        assert count == sum(shapely.get_num_coordinates(way.intersection(ring)) for ring in rings)
    assert crosses_rings(areas, begin, end, layer).tolist() == (found > 0).tolist()


@pytest.mark.parametrize(
    ("begin", "end", "hits"),
    [
        ((1, 1), (9, 9), False),
        ((-5, 5), (15, 5), True),
        ((5, 5), (15, 5), True),
        ((9, 9), (11, 11), True),
        ((9, 9), (21, 21), True),
        ((9, 1), (21, -11), True),
        ((5, 5), (15, 15), True),
        ((-1, 5), (5, 11), True),
        ((-3, 0), (3, -6), False),
        ((11, 0), (11, 10), False),
        ((4, 4), (4, 4), False),
    ],
)
def test_a_way_through_a_corner_crosses_the_ring(
    begin: tuple[float, float], end: tuple[float, float], hits: bool
) -> None:
    square = Areas.from_rings([[box(0, 0, 10, 10)]])

    assert crosses_rings(
        square, np.array([begin], float), np.array([end], float), np.zeros(1, np.int64)
    ).tolist() == [hits]


def test_nothing_crosses_an_empty_layer() -> None:
    areas = Areas.from_rings([[box(0, 0, 1, 1)], []])
    begin, end = np.array([(-1.0, 0.5)] * 2), np.array([(2.0, 0.5)] * 2)

    assert crosses_rings(areas, begin, end, np.array([0, 1])).tolist() == [True, False]


def test_many_ways_across_many_edges_need_little_memory() -> None:
    """A bed full of small parts: 300 travels over 20 000 edges in one layer."""
    rings = [box(x, y, x + 1, y + 1) for x in range(0, 140, 2) for y in range(0, 140, 2)]
    areas = Areas.from_rings([rings])
    rng = np.random.default_rng(0)
    begin, end = rng.uniform(0, 140, (2, 300, 2))
    tracemalloc.start()
    try:
        crosses_rings(areas, begin, end, np.zeros(300, np.int64))
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()

    assert peak < 100e6
