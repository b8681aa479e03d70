"""How deep points lie in areas, held against shapely's distances."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer.geometry import Areas, depths
from printer_slicer.geometry.depth import mark_near_outlines
from tests.parts import shape, shapely
from tests.strategies import clean_areas


@given(areas=clean_areas(3), reach=st.sampled_from([0.1, 0.5, 3.0]), seed=st.integers(0, 999))
def test_depths_are_distances_to_the_outline_with_the_sign_of_the_side(
    areas: Areas, reach: float, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    low, high = (areas.xy.min(axis=0), areas.xy.max(axis=0)) if len(areas.xy) else (np.zeros(2), np.ones(2))
    points, layer = rng.uniform(low - 1, high + 1, (200, 2)), rng.integers(0, 3, 200)

    found = depths(areas, points, layer, reach)

    for k in range(3):
        here, area = layer == k, shape(areas, k)
        spots = shapely.points(points[here])
        if shapely.is_empty(area):
            assert np.isnan(found[here]).all()
            continue
        away = shapely.distance(shapely.boundary(area), spots)
        signed = np.where(shapely.contains(area, spots), away, -away)
        clear = np.abs(away - reach) > 1e-6
        assert np.array_equal(np.isnan(found[here])[clear], (away > reach)[clear])
        seen = ~np.isnan(found[here]) & (away > 1e-4)
        assert found[here][seen] == pytest.approx(signed[seen], abs=1e-6)


def test_no_points_and_no_areas_have_no_depths() -> None:
    none = Areas.empty(2)

    assert len(depths(none, np.zeros((0, 2)), np.zeros(0, np.int64), 1.0)) == 0
    assert np.isnan(depths(none, np.zeros((3, 2)), np.zeros(3, np.int64), 1.0)).all()


@given(areas=clean_areas(3), reach=st.sampled_from([0.1, 0.5, 3.0]), seed=st.integers(0, 999))
def test_no_point_beside_an_outline_is_taken_for_far_from_it(areas: Areas, reach: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    low, high = (areas.xy.min(axis=0), areas.xy.max(axis=0)) if len(areas.xy) else (np.zeros(2), np.ones(2))
    span = high - low
    points, layer = rng.uniform(low - span - 9, high + span + 9, (200, 2)), rng.integers(0, 3, 200)

    near = mark_near_outlines(areas, points, layer, reach)

    known = ~np.isnan(depths(areas, points, layer, reach))
    assert near[known].all()
    far = np.maximum(low - points, points - high).max(axis=1) > 6 * reach
    assert not near[far].any()
