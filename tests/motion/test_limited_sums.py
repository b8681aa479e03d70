"""The compiled kernel adds with limits as the Python code does, to the last bit."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer.kernel import VARIABLE, load_kernel
from printer_slicer.motion.vectorized import accumulate_with_limit
from tests.kernels import needs_kernel


def sums_with(kernel: str, bounds: np.ndarray, gains: np.ndarray, first: float) -> bytes:
    with pytest.MonkeyPatch.context() as patched:
        patched.setenv(VARIABLE, kernel)
        return accumulate_with_limit(bounds, gains, first).tobytes()


@needs_kernel
@given(st.integers(0, 2**32), st.integers(1, 400), st.floats(0, 1e4), st.sampled_from([1.0, 30.0, 1e4]))
def test_the_kernel_adds_the_same_bits(seed: int, n: int, first: float, highest: float) -> None:
    rng = np.random.default_rng(seed)
    bounds, gains = rng.uniform(0, highest, n), rng.uniform(0, 10, n)
    bounds[rng.random(n) < 0.1] = np.inf

    assert sums_with("required", bounds, gains, first) == sums_with("off", bounds, gains, first)
    assert sums_with("required", bounds[::-1], gains[::-1], 0.0) == sums_with(
        "off", bounds[::-1], gains[::-1], 0.0
    )


@needs_kernel
def test_wrong_arrays_are_errors(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, "required")
    kernel = load_kernel()
    assert kernel
    for bounds, width in ((np.zeros(3), 1), (np.zeros(4), 0), (np.zeros(9, np.int8), 1)):
        with pytest.raises(ValueError, match="do not match"):
            kernel.accumulate_with_limit(bounds.data, np.zeros(4).data, 0.0, width)
