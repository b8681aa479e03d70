"""The look-ahead of a full planner over arrays, against the planner that takes its blocks one by one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer.motion.rules import Lookahead, MotionLimits, limits_of, make_block
from printer_slicer.motion.vectorized import compute_squared_corner_speeds, find_nonzero_moves, make_blocks
from printer_slicer.motion.vectorized_lookahead import compute_lookahead_seconds
from printer_slicer.profile import load_profile

CORNERS = ["junction_deviation", "jerk", "square_corner"]
STEPS = st.floats(-3, 3).map(lambda value: round(value, 3))
WAYS = st.lists(
    st.tuples(STEPS, STEPS, st.sampled_from([0.0, 0.0, 0.2]), st.floats(-0.1, 0.2)), min_size=1, max_size=60
)


def limits(corner: str, planner: int) -> MotionLimits:
    """Those of a shipped machine with another corner rule and planner."""
    return replace(
        limits_of(load_profile().printer), corner=corner, planner_blocks=planner, minimum_cruise_ratio=0.0
    )  # type: ignore[arg-type]


def one_by_one(ways: np.ndarray, speed: float, own: MotionLimits) -> list[float]:
    """Seconds of the blocks that begin while the planner is full."""
    planner, taken = Lookahead(own), []
    seen = own.planner_blocks - 1
    for way in ways.tolist():
        block = make_block(own, (way[0], way[1], way[2], way[3]), speed)
        if block is None:
            continue
        planner.push(block)
        if len(planner) > seen:
            taken.append(planner.pop())
    return taken


@pytest.mark.parametrize("corner", CORNERS)
@given(WAYS, st.sampled_from([4, 8, 16, 40]), st.sampled_from([5.0, 60.0, 300.0]))
def test_blocks_take_as_long_as_in_a_full_planner(
    corner: str, ways: list[tuple[float, float, float, float]], planner: int, speed: float
) -> None:
    own, table = limits(corner, planner), np.array(ways)
    moving, length = find_nonzero_moves(np.ascontiguousarray(table.T))
    blocks = make_blocks(
        np.ascontiguousarray(table[moving].T), length, np.full(len(moving), speed), None, own
    )
    corners = np.zeros(len(moving))
    corners[1:] = compute_squared_corner_speeds(
        own, blocks.take_slice(np.s_[:-1]), blocks.take_slice(np.s_[1:])
    )
    seconds, squares = compute_lookahead_seconds(blocks, corners, planner - 1, 0.0)

    assert seconds == pytest.approx(one_by_one(table, speed, own), rel=1e-9, abs=1e-12)
    assert len(squares) == len(seconds)
    assert (squares >= 0).all()
