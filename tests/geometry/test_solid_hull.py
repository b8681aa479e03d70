"""The convex hull of points in space, compared with that of scipy."""

from __future__ import annotations

from collections import Counter
from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import ConvexHull

from printer_slicer.arrays import Float, Int
from printer_slicer.geometry.solid_hull import find_hull_facets


def volume(points: Float, facets: Int) -> float:
    a, b, c = points[facets].transpose(1, 0, 2)
    return float((a * np.cross(b, c)).sum()) / 6


def is_closed(facets: Int) -> bool:
    edges = Counter(edge for a, b, c in facets.tolist() for edge in ((a, b), (b, c), (c, a)))
    return all(count == 1 and edges[end, begin] == 1 for (begin, end), count in edges.items())


@given(st.integers(0, 1000), st.integers(5, 60))
def test_the_hull_of_any_points_is_closed_and_as_large_as_that_of_scipy(seed: int, count: int) -> None:
    points = np.random.default_rng(seed).normal(size=(count, 3)) * [10.0, 5.0, 1.0]
    facets = find_hull_facets(points, 1e-9)

    assert is_closed(facets)
    assert volume(points, facets) == pytest.approx(ConvexHull(points).volume)


def test_points_in_planes_and_on_edges_are_no_trouble() -> None:
    points = np.array(list(product((0.0, 1.0, 2.0), repeat=3)))
    facets = find_hull_facets(points, 1e-6)

    assert is_closed(facets)
    assert volume(points, facets) == pytest.approx(8)


@pytest.mark.parametrize("seed", range(6))
def test_points_that_are_almost_in_planes_are_no_trouble(seed: int) -> None:
    """As in a turned part, whose coordinates were rounded."""
    chance = np.random.default_rng(seed)
    turn, _ = np.linalg.qr(chance.normal(size=(3, 3)))
    ring = 40 * np.array([(np.cos(t), np.sin(t)) for t in np.linspace(0, 2 * np.pi, 90)[:-1]])
    solid = np.concatenate([np.column_stack([ring, np.full(len(ring), z)]) for z in (0.0, 3.0, 7.0)])
    points = (solid @ turn.T).astype(np.float32).astype(np.float64)
    facets = find_hull_facets(points, 0.01)

    assert is_closed(facets)
    assert volume(points, facets) == pytest.approx(ConvexHull(points).volume, rel=2e-3)


def test_few_points_already_resemble_all() -> None:
    way = np.random.default_rng(0).normal(size=(5000, 3))
    points = 50 * way / np.sqrt((way**2).sum(axis=1))[:, None]
    facets = find_hull_facets(points, 0.0, most=200)

    assert len(facets) < 420
    assert volume(points, facets) > 0.95 * ConvexHull(points).volume


@pytest.mark.parametrize(
    "points", [[(0, 0, 0)], [(0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1, 0)], [(1, 2, 3)] * 4]
)
def test_flat_points_have_no_hull(points: list[tuple[float, float, float]]) -> None:
    assert len(find_hull_facets(np.array(points, np.float64), 1e-6)) == 0
