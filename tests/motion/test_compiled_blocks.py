"""The compiled kernel makes the blocks of moves that the Python code makes, to the last bit."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer.kernel import VARIABLE, load_kernel
from printer_slicer.motion.blocks import MotionLimits
from printer_slicer.motion.vectorized import _make_blocks_and_corners
from tests.kernels import needs_kernel


def limits(least_seconds: float) -> MotionLimits:
    return MotionLimits(
        max_speed=(200.0, 180.0, 12.0, 60.0),
        max_acceleration=(1500.0, 1200.0, 100.0, 4000.0),
        acceleration=1000.0,
        travel_acceleration=1400.0,
        retract_acceleration=900.0,
        corner="jerk",
        junction_deviation=0.01,
        jerk=(9.0, 8.0, 0.4, 4.5),
        square_corner_velocity=5.0,
        min_segment_seconds=least_seconds,
    )


def random_moves(seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Travel (n, 4), speeds and accelerations of moves, many of them along one axis, tiny or zero."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(0, 200))
    delta = rng.normal(0, 5, (n, 4)) * rng.choice([0, 0, 1, 1e-7], (n, 4))
    return delta, rng.choice([0, 0.01, 20, 90, 500], n), rng.choice([300.0, 2000, 9000], n)


@needs_kernel
@given(st.integers(0, 2**32 - 1), st.booleans(), st.sampled_from([0.0, 0.02]))
def test_blocks_are_the_same_to_the_last_bit(seed: int, with_accelerations: bool, least: float) -> None:
    delta, speed, acceleration = random_moves(seed)
    found = []
    for kernel in ("required", "off"):
        with pytest.MonkeyPatch.context() as patched:
            patched.setenv(VARIABLE, kernel)
            moving, blocks, corners = _make_blocks_and_corners(
                delta, speed, acceleration if with_accelerations else None, limits(least)
            )
        columns = blocks.length, blocks.speed, blocks.acceleration, blocks.share, corners
        found.append((moving.tolist(), [column.tobytes() for column in columns]))
    assert found[0] == found[1]


@needs_kernel
@pytest.mark.parametrize(
    ("speed", "acceleration", "numbers"), [((2,), (0,), (18,)), ((1,), (2,), (18,)), ((1,), (0,), (17,))]
)
def test_arrays_that_do_not_match_are_an_error(
    speed: tuple[int], acceleration: tuple[int], numbers: tuple[int]
) -> None:
    kernel = load_kernel()
    assert kernel
    with pytest.raises(ValueError, match=r"match|limits"):
        kernel.make_blocks(np.zeros((1, 4)), np.zeros(speed), np.zeros(acceleration), np.zeros(numbers))
