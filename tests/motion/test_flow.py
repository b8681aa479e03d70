"""Plastic per second of moves that are too short to tell alone."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer.motion.vectorized import FLOW_WINDOW, compute_volumetric_flow


def test_a_long_move_is_as_fast_as_it_is() -> None:
    assert compute_volumetric_flow(np.array([2.0, 0.5]), np.array([1.0, 0.1])).tolist() == pytest.approx(
        [2.0, 5.0]
    )


def test_short_moves_are_as_fast_as_one_long_move() -> None:
    short = compute_volumetric_flow(np.full(100, 0.02), np.full(100, 0.001))

    assert (short[:9] == 0).all()  # so little says nothing yet
    assert short[9:] == pytest.approx(20.0)


def test_nothing_is_nothing() -> None:
    assert len(compute_volumetric_flow(np.zeros(0), np.zeros(0))) == 0


PIECES = st.lists(st.tuples(st.floats(1e-4, 3.0), st.floats(1e-4, 2.0)), min_size=1, max_size=40)


@given(PIECES)
def test_it_is_what_was_laid_last_by_the_time_that_took(pieces: list[tuple[float, float]]) -> None:
    volume, seconds = np.array(pieces).T
    found = compute_volumetric_flow(volume, seconds)

    for i in range(len(pieces)):
        some = volume[: i + 1].sum()
        if abs(some - FLOW_WINDOW) < 1e-6:
            continue
        begin = next((k for k in range(i, -1, -1) if volume[k : i + 1].sum() >= FLOW_WINDOW - 1e-7), None)
        if begin is None:
            assert found[i] == 0
        elif abs(volume[begin : i + 1].sum() - FLOW_WINDOW) > 1e-6:  # else rounding decides
            wanted = volume[begin : i + 1].sum() / seconds[begin : i + 1].sum()
            assert found[i] == pytest.approx(wanted, rel=1e-6)
    assert found.max() <= (volume / seconds).max() * (1 + 1e-6)
