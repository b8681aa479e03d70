"""The compiled kernel keeps the points of outlines that shapely keeps."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from printer_slicer.arrays import Float
from printer_slicer.geometry import Areas, simplify
from printer_slicer.kernel import VARIABLE, load_kernel
from tests.kernels import needs_kernel

coarse = st.integers(-4, 4).map(float)  # repeated points and straight lines
fine = st.floats(-300, 300).map(lambda x: round(x, 9))
grid = st.integers(-300_000, 300_000).map(lambda steps: steps / 100_000)


def rings() -> st.SearchStrategy[Float]:
    sizes = st.integers(0, 40).map(lambda n: (n, 2))
    return st.one_of(arrays.arrays(np.float64, sizes, elements=of) for of in (coarse, fine, grid))


def simplified_with(kernel: str, areas: Areas, tolerance: float) -> Areas:
    with pytest.MonkeyPatch.context() as patched:
        patched.setenv(VARIABLE, kernel)
        return simplify(areas, tolerance)


def same(one: Areas, other: Areas) -> bool:
    return all(
        getattr(one, name).tobytes() == getattr(other, name).tobytes()
        for name in ("xy", "ring_start", "ring_layer")
    )


@needs_kernel
@given(
    st.lists(st.lists(rings(), max_size=3), max_size=4),
    st.one_of(st.sampled_from([0.5, 1.0, 2.0]), st.floats(1e-6, 50)),
)
def test_the_kernel_keeps_the_same_points(layers: list[list[Float]], tolerance: float) -> None:
    areas = Areas.from_rings(layers)

    assert same(simplified_with("required", areas, tolerance), simplified_with("off", areas, tolerance))


@needs_kernel
def test_long_outlines_keep_the_same_points() -> None:
    turn = 2 * np.pi * np.arange(20_000) / 20_000
    wavy = (20 + np.sin(40 * turn) + 0.01 * np.sin(900 * turn))[:, None]
    ring = np.round(wavy * np.column_stack([np.cos(turn), np.sin(turn)]), 5)
    areas = Areas.from_rings([[ring], [ring[::-1], 0.5 * ring]])
    for tolerance in (0.0001, 0.0125, 0.3):
        found = simplified_with("required", areas, tolerance)

        assert same(found, simplified_with("off", areas, tolerance))
        assert 0 < len(found.xy) < len(areas.xy)


@needs_kernel
def test_wrong_arrays_are_errors(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, "required")
    kernel = load_kernel()
    assert kernel
    for start, message in (
        ([1, 4], "do not match"),
        ([], "do not match"),
        ([0, 3, 2, 4], "ascend"),
        ([0, 3], "not as many"),
    ):
        with pytest.raises(ValueError, match=message):
            kernel.outline_points(np.zeros((4, 2)).data, np.array(start, np.int64).data, 0.1)
