"""Areas on a raster, and distances to solid cells, against slow definitions."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import ndimage

from printer_slicer.geometry import Areas, normalize
from printer_slicer.geometry.raster import (
    CellGrid,
    cheapest_within,
    clearance,
    highest_within,
    rasterize_areas,
)
from tests.parts import shape, shapely

SEEDS = st.integers(0, 10_000)
GRID = CellGrid(-4.0, -3.0, 0.5, 20, 24)


def areas_of(seed: int, n_layers: int = 3) -> Areas:
    """Overlapping and nested polygons in several layers, some of them beyond the grid."""
    rng = np.random.default_rng(seed)
    rings = []
    for _ in range(n_layers):
        corners = [int(rng.integers(3, 9)) for _ in range(int(rng.integers(0, 5)))]
        turns = [np.sort(rng.uniform(0, 2 * np.pi, n)) for n in corners]
        rings.append(
            [
                rng.uniform(-4, 6, 2) + rng.uniform(0.3, 5) * np.column_stack([np.cos(turn), np.sin(turn)])
                for turn in turns
            ]
        )
    return normalize(Areas.from_rings(rings))


@given(seed=SEEDS)
def test_cells_are_inside_if_their_middles_are(seed: int) -> None:
    areas = areas_of(seed)

    mask = rasterize_areas(areas, GRID)

    middles = GRID.find_middles(np.arange(GRID.n_cells))
    for layer in range(areas.n_layers):
        own = shape(areas, layer)
        inside = shapely.contains_xy(own, *middles.T)
        clear = shapely.distance(shapely.boundary(own), shapely.points(middles)) > 1e-6
        assert (mask[layer].ravel() == inside)[clear].all()


def test_many_layers_are_rasterized_like_single_ones() -> None:
    areas = areas_of(3, 40)
    fine = CellGrid.around(
        np.array([-4.0, -3.0]), np.array([6.0, 7.0]), 0.02
    )  # more cells than fit one batch

    mask = rasterize_areas(areas, fine)

    assert mask.any()
    for layer in (0, 17, 39):
        assert (mask[layer] == rasterize_areas(areas.copy_layers(np.array([layer])), fine)[0]).all()


def test_cells_of_points() -> None:
    middles = GRID.find_middles(np.arange(GRID.n_cells))

    assert (GRID.find_cells(middles) == np.arange(GRID.n_cells)).all()
    assert GRID.find_cells(np.array([[-100.0, -100.0], [100.0, 100.0]])).tolist() == [0, GRID.n_cells - 1]


def test_the_grid_covers_its_box() -> None:
    grid = CellGrid.around(np.array([-1.3, 2.1]), np.array([4.2, 2.2]), 0.5)

    assert grid.x <= -1.3
    assert grid.y <= 2.1
    assert grid.x + grid.n_columns * grid.cell >= 4.2
    assert grid.y + grid.n_rows * grid.cell >= 2.2


@given(seed=SEEDS, reach=st.floats(0.3, 6.0), cell=st.sampled_from([0.5, 0.7, 1.0]))
def test_clearance_is_the_distance_to_the_nearest_solid_cell(seed: int, reach: float, cell: float) -> None:
    rng = np.random.default_rng(seed)
    solid = rng.random((2, 14, 19)) < rng.choice([0.0, 0.005, 0.05, 0.4])

    found = clearance(solid, cell, reach)

    for one, mask in zip(found, solid, strict=True):
        free = np.pad(~mask, 40, constant_values=True)
        true = ndimage.distance_transform_edt(free)[40:-40, 40:-40] * cell if mask.any() else np.inf
        assert one == pytest.approx(np.minimum(true, reach), abs=1e-4)


@given(seed=SEEDS)
def test_best_values_among_moves(seed: int) -> None:
    rng = np.random.default_rng(seed)
    field = rng.random((7, 9)).astype(np.float32)
    moves = rng.integers(-3, 4, (5, 2))
    cost = rng.random(5)

    highest, cheapest = highest_within(field, moves), cheapest_within(field, moves, cost)

    for row in range(7):
        for column in range(9):
            to = moves + np.array([row, column])
            on = ((to >= 0) & (to < (7, 9))).all(axis=1)
            values = field[tuple(to[on].T)]
            assert highest[row, column] == values.max(initial=-np.inf)
            assert cheapest[row, column] == pytest.approx((values + cost[on]).min(initial=np.inf), abs=1e-6)
