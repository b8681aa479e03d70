"""The fields of trees against a search by breadth, for one radius at a time."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from printer_slicer.arrays import Bool, Float
from printer_slicer.geometry.raster import Float32, clearance
from printer_slicer.supports.reach_fields import CellMoves, find_branch_routes
from printer_slicer.supports.tree_settings import TreeSettings, read_tree_settings
from tests.effort import examples
from tests.parts import plain

SIDE, CELL, SLAB = 20, 0.5, 1.5
SETTINGS: TreeSettings = read_tree_settings(plain(), 0.2, 30.0)


def random_fields(seed: int) -> tuple[Bool, Float32, Float32, Float32]:
    """Solid cells of 20 slabs, how thick a branch may be in each, on the part below, and on the bed."""
    rng = np.random.default_rng(seed)
    solid = rng.random((SIDE, SIDE, SIDE)) < rng.choice([0.005, 0.02, 0.06])
    solid[rng.integers(2, SIDE), :, : rng.integers(1, SIDE)] = True  # a wall that lies flat
    clear = clearance(solid, CELL, 3.0) - np.float32(0.3)
    on_part = np.full_like(clear, -1.0)
    on_part[1:] = np.where(
        solid[:-1] & ~solid[1:], rng.choice([-1.0, 0.6, 1.2], (SIDE - 1, SIDE, SIDE)), -1.0
    )
    on_bed = np.full((SIDE, SIDE), 2.0, np.float32)
    on_bed[:, :3] = -1.0
    return solid, clear, on_part, on_bed


def reachable(clear: Float32, on_part: Float32, on_bed: Float32, moves: CellMoves, radius: float) -> Bool:
    """From which cells on which levels a disc of this radius gets to the bed or to the part."""
    result = np.zeros(clear.shape, np.bool_)
    result[0] = on_bed >= radius
    for level in range(1, len(clear)):
        for row, column in np.ndindex(clear.shape[1:]):
            if on_part[level, row, column] >= radius:
                result[level, row, column] = True
            elif clear[level - 1, row, column] >= radius:
                for y, x in np.add(moves.step, (row, column)).tolist():
                    on = 0 <= y < SIDE and 0 <= x < SIDE
                    if on and clear[level - 1, y, x] >= radius and result[level - 1, y, x]:
                        result[level, row, column] = True
                        break
    return result


@given(seed=st.integers(0, 10_000), radius=st.floats(0.3, 2.0), slope=st.sampled_from([0.4, 0.75, 1.0]))
@settings(max_examples=examples(6))
def test_one_field_tells_for_every_radius_what_a_search_finds(seed: int, radius: float, slope: float) -> None:
    _, clear, on_part, on_bed = random_fields(seed)
    moves = CellMoves.within(slope * SLAB, SLAB, CELL)

    ways = find_branch_routes(clear, (on_part, np.full_like(clear, 20.0)), on_bed, moves, SETTINGS)

    assert (reachable(clear, on_part, on_bed, moves, radius) == (ways.radius >= radius)).all()
    # Only where a thin branch gets through is there a price, at least that of going straight down.
    thin = ways.radius >= SETTINGS.tip_radius
    assert (np.isfinite(ways.price) == thin).all()
    level = np.broadcast_to(np.arange(SIDE)[:, None, None], thin.shape)
    least = np.minimum(level * SLAB, SETTINGS.scar_price)
    assert (ways.price[thin] >= least[thin] - 1e-3).all()


def test_over_an_empty_bed_the_way_is_straight_down() -> None:
    clear = np.full((SIDE, SIDE, SIDE), 2.0, np.float32)
    moves = CellMoves.within(SLAB, SLAB, CELL)

    ways = find_branch_routes(
        clear,
        (np.full_like(clear, -1), np.full_like(clear, 20.0)),
        np.full((SIDE, SIDE), 2.0, np.float32),
        moves,
        SETTINGS,
    )

    assert (ways.radius == 2.0).all()
    assert ways.price[-1] == pytest.approx((SIDE - 1) * SLAB, rel=1e-5)


@pytest.mark.parametrize("aside", [0.4, 0.5, 1.1, 1.5])
def test_moves_are_all_cells_within_reach_and_the_shortest_comes_first(aside: float) -> None:
    moves = CellMoves.within(aside, SLAB, CELL)

    grid: Float = np.stack(np.meshgrid(np.arange(-9, 10), np.arange(-9, 10)), axis=-1).reshape(-1, 2)
    near = grid[np.hypot(*grid.T) * CELL <= aside + 1e-9]
    assert {tuple(step) for step in moves.step.tolist()} == {tuple(step) for step in near.tolist()}
    assert moves.step[0].tolist() == [0, 0]
    assert (np.diff(moves.aside) >= 0).all()
    assert moves.length == pytest.approx(np.hypot(moves.aside, SLAB))
