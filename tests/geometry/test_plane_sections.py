"""The compiled kernel cuts meshes by planes, and finds cycles, as the Python code does, to the last bit."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer.arrays import Float, Int
from printer_slicer.geometry.connectivity import find_cycles
from printer_slicer.geometry.plane_sections import intersect_with_planes
from printer_slicer.kernel import VARIABLE, load_kernel
from tests.kernels import needs_kernel
from tests.parts import case_study

PART = case_study().triangles


def crossings_with(kernel: str, triangles: Float, planes: Float) -> list[tuple[bytes, ...]]:
    with pytest.MonkeyPatch.context() as patched:
        patched.setenv(VARIABLE, kernel)
        return [
            (*(one.tobytes() for one in (part.xy, part.plane, part.tail, part.head)), bytes(part.unpaired))
            for part in intersect_with_planes(triangles, planes)
        ]


def cycles_with(kernel: str, following: Int) -> list[list[int]]:
    with pytest.MonkeyPatch.context() as patched:
        patched.setenv(VARIABLE, kernel)
        return [one.tolist() for one in find_cycles(following)]


@needs_kernel
@given(st.integers(0, 2**32), st.integers(0, 40), st.booleans())
def test_the_kernel_cuts_at_the_same_points(seed: int, n_planes: int, is_open: bool) -> None:
    rng = np.random.default_rng(seed)
    heights = PART[..., 2].ravel()
    planes = np.concatenate([rng.uniform(heights.min(), heights.max(), n_planes), rng.choice(heights, 2)])
    triangles = PART[rng.random(len(PART)) < 0.9] if is_open else PART

    found = crossings_with("required", triangles, np.unique(planes))

    assert found == crossings_with("off", triangles, np.unique(planes))


@needs_kernel
@given(st.lists(st.integers(0, 2**32), min_size=1, max_size=60))
def test_the_kernel_finds_the_same_cycles(keys: list[int]) -> None:
    following = np.argsort(keys, kind="stable")

    assert cycles_with("required", following) == cycles_with("off", following)


@needs_kernel
def test_what_is_no_permutation_is_left_to_python(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, "required")
    kernel = load_kernel()
    assert kernel

    assert kernel.find_cycles(np.array([1, 2, 1]).data) is None
    with pytest.raises(ValueError, match="outside"):
        kernel.find_cycles(np.array([0, 2]).data)


@needs_kernel
def test_wrong_arrays_are_errors(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, "required")
    kernel = load_kernel()
    assert kernel
    corners, level, ends = (
        np.arange(6.0).data,
        np.array([0, 1]).data,
        (np.array([0]).data, np.array([1]).data),
    )
    planes = np.array([4.5]).data

    assert np.frombuffer(kernel.cut_edges(corners, level, *ends, planes)[0]).tolist() == [0.5, 2.5]
    for wrong in ((corners[:5], level, *ends, planes), (corners, level, ends[0], level, planes)):
        with pytest.raises(ValueError, match="do not match"):
            kernel.cut_edges(*wrong)
    for wrong in ((corners, level, ends[0], np.array([2]).data, planes), (corners, level, *ends, planes[:0])):
        with pytest.raises(ValueError, match="outside"):
            kernel.cut_edges(*wrong)
    edge = np.array([0, 0, 1, 5])
    assert np.frombuffer(kernel.number_cuts(level, edge.data, ends[0]), np.int64).tolist() == [5]
    with pytest.raises(ValueError, match="do not match"):
        kernel.number_cuts(level, edge[:3].data, ends[0])
    with pytest.raises(ValueError, match="outside"):
        kernel.number_cuts(level, edge.data, np.array([1]).data)
