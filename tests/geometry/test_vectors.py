"""Products of vectors and feet on segments: against numpy and shapely."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer.geometry.vectors import (
    cross,
    dot,
    measure_distances_from_triangles,
    nearest_on_segments,
    nearest_share,
)

seeds = st.integers(0, 2**32 - 1)


@given(seed=seeds, dimensions=st.integers(1, 4), shape=st.sampled_from([(0,), (7,), (2, 5)]))
def test_products_are_those_of_numpy(seed: int, dimensions: int, shape: tuple[int, ...]) -> None:
    a, b = np.random.default_rng(seed).uniform(-300, 300, (2, *shape, dimensions))

    assert dot(a, b) == pytest.approx(np.einsum("...i,...i->...", a, b))
    if dimensions == 2:
        solid = [np.concatenate([one, np.zeros((*shape, 1))], axis=-1) for one in (a, b)]
        assert cross(a, b) == pytest.approx(np.cross(*solid)[..., 2])


def test_the_cross_product_of_whole_numbers_is_exact() -> None:
    a, b = np.array([[10**9, 10**9 - 1]]), np.array([[10**9 - 1, 10**9 - 2]])

    assert cross(a, b).tolist() == [10**9 * (10**9 - 2) - (10**9 - 1) ** 2] == [-1]


@given(seed=seeds)
def test_a_foot_is_the_nearest_place_of_its_segment(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points, begin, end = rng.uniform(-300, 300, (3, 40, 2))
    end[:10] = begin[:10]  # segments of no length

    foot, share = nearest_on_segments(points, begin, end)

    lines = shapely.linestrings(np.stack([begin, end], axis=1))
    away = np.where(
        share == 0, np.hypot(*(points - begin).T), shapely.distance(lines, shapely.points(points))
    )
    assert np.hypot(*(foot - points).T) == pytest.approx(away)
    assert foot == pytest.approx(begin + share[:, None] * (end - begin))
    assert ((share >= 0) & (share <= 1)).all()
    assert not share[:10].any()


def test_feet_are_found_in_space_and_for_many_points_of_one_segment() -> None:
    begin, end = np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, 5.0])
    points = np.array([[3.0, 4.0, 2.0], [1.0, 0.0, -7.0], [1.0, 1.0, 9.0]])

    foot, share = nearest_on_segments(points, begin, end)

    assert foot.tolist() == [[0, 0, 2], [0, 0, 1], [0, 0, 5]]
    assert share.tolist() == nearest_share(points - begin, end - begin).tolist() == [0.25, 0, 1]


@given(st.integers(0, 2**32 - 1))
def test_distances_from_triangles_are_those_of_their_nearest_points(seed: int) -> None:
    rng = np.random.default_rng(seed)
    corners, points = rng.normal(size=(20, 3, 3)), 2 * rng.normal(size=(20, 3))
    share = np.sort(rng.random((4000, 2)), axis=1)
    weights = np.column_stack([share[:, 0], share[:, 1] - share[:, 0], 1 - share[:, 1]])
    inside = np.einsum("pc,nck->npk", np.vstack([np.eye(3), weights]), corners)
    sampled = np.linalg.norm(points[:, None] - inside, axis=2).min(axis=1)

    found = measure_distances_from_triangles(points, corners)

    assert (found <= sampled + 1e-12).all()
    assert (found >= sampled - 0.3).all()
    assert np.median(sampled - found) < 0.02


def test_distances_from_triangles_without_area_are_those_of_their_sides() -> None:
    corners = np.array([[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]]])
    assert measure_distances_from_triangles(np.array([[1.5, 3.0, 4.0]]), corners) == pytest.approx(5.0)
