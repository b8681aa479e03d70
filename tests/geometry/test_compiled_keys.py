"""Functions of the kernel for keys and connected components: the same results as without it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer.geometry.connectivity import label_components, weld_keys
from printer_slicer.geometry.facet_topology import coordinate_keys, corner_keys
from printer_slicer.kernel import VARIABLE, load_kernel
from tests.kernels import needs_kernel

seeds = st.integers(0, 2**32 - 1)


def results(compute: Callable[[], object]) -> list[object]:
    """The results with the kernel and without it."""
    both = []
    for kernel in ("required", "off"):
        with pytest.MonkeyPatch.context() as patched:
            patched.setenv(VARIABLE, kernel)
            both.append(compute())
    return both


def same_arrays(one: tuple[np.ndarray, ...], other: tuple[np.ndarray, ...]) -> bool:
    return all(a.dtype == b.dtype and np.array_equal(a, b) for a, b in zip(one, other, strict=True))


@needs_kernel
@given(seed=seeds, n=st.integers(0, 300), kinds=st.integers(1, 400), shift=st.integers(0, 60))
def test_numbers_of_keys_are_the_same(seed: int, n: int, kinds: int, shift: int) -> None:
    key = np.random.default_rng(seed).integers(0, kinds, n).astype(np.uint64) << np.uint64(shift)

    assert same_arrays(*results(lambda: weld_keys(key)))


@needs_kernel
def test_numbers_of_many_keys_are_the_same() -> None:
    """So many that the Python code welds them in blocks."""
    key = np.random.default_rng(1).integers(0, 200_000, 400_000).astype(np.uint64) << np.uint64(40)

    assert same_arrays(*results(lambda: weld_keys(key)))


@needs_kernel
@given(seed=seeds, n=st.integers(1, 60), links=st.integers(0, 90), k=st.integers(2, 3))
def test_components_are_the_same(seed: int, n: int, links: int, k: int) -> None:
    members = np.random.default_rng(seed).integers(0, n, (k, links))

    assert same_arrays(*results(lambda: (label_components(members, n),)))


@needs_kernel
def test_components_of_a_chain_that_descends_are_the_same() -> None:
    members = np.stack([np.arange(1, 5000), np.arange(4999)])[:, ::-1]
    with_kernel, without = results(lambda: label_components(members[:, 9:], 5000))

    assert np.array_equal(with_kernel, without)
    assert with_kernel.max() == 9


@needs_kernel
@given(st.lists(st.tuples(*[st.floats(allow_nan=False) | st.integers(-3, 3).map(float)] * 3), max_size=20))
def test_keys_of_corners_are_the_same(corners: list[tuple[float, float, float]]) -> None:
    """Also of both zeros."""
    points = np.array([*corners, (0.0, -0.0, 1.0), (-0.0, 0.0, 1.0)])
    with_kernel, without = results(lambda: (corner_keys(points), coordinate_keys(*points.T)))

    assert same_arrays(with_kernel, without)
    assert with_kernel[0][-1] == with_kernel[0][-2]


@needs_kernel
def test_wrong_input_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, "required")
    kernel = load_kernel()
    assert kernel
    one, two = np.zeros(1, np.int32), np.zeros(2, np.int32)

    with pytest.raises(ValueError, match="coordinates do not match"):
        kernel.coordinate_keys(np.zeros(1), np.zeros(2), np.zeros(1))
    with pytest.raises(ValueError, match="64 bits"):
        kernel.weld_keys(b"1234567")
    with pytest.raises(ValueError, match="links do not match"):
        kernel.label_components(one, two, 3)
    with pytest.raises(ValueError, match="too many items"):
        kernel.label_components(one, one, -1)
    for wrong in (-1, 3):
        with pytest.raises(ValueError, match="does not exist"):
            kernel.label_components(one, np.full(1, wrong, np.int32), 3)
