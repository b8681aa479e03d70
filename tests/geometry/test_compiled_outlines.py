"""Spikes are removed and areas computed by the compiled kernel as by the Python code, to the last bit."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer.geometry import Areas
from printer_slicer.geometry.polygons import STEPS_PER_MM
from printer_slicer.geometry.spikes import remove_spikes
from printer_slicer.healing.soundness import _match_edges
from printer_slicer.kernel import VARIABLE, Kernel, load_kernel
from tests.kernels import needs_kernel

T = TypeVar("T")
SEEDS = st.integers(0, 2**32 - 1)


def with_and_without(compute: Callable[[], T]) -> tuple[T, T]:
    """Results with the kernel and without it."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setenv(VARIABLE, "required")
        one = compute()
        patched.setenv(VARIABLE, "off")
        return one, compute()


def rings_with_spikes(seed: int) -> Areas:
    """Rings of all sizes on the grid, most of which run back along themselves somewhere."""
    rng = np.random.default_rng(seed)
    rings = []
    for _ in range(rng.integers(1, 12)):
        n = int(rng.integers(3, 400 if rng.random() < 0.2 else 12))
        ring = rng.integers(-4, 5, (n, 2)) * rng.choice([1, 2, 30, 1000])
        for at in rng.integers(0, n, rng.integers(0, 4)).tolist():  # there and back, up to a step beside
            ring = np.insert(ring, at, ring[at - 2] + rng.integers(-1, 2, 2), axis=0)
        rings.append(ring / STEPS_PER_MM)
    start = np.cumsum([0, *map(len, rings)])
    layer = np.sort(rng.integers(0, 3, len(rings)))
    return Areas(np.concatenate(rings), start, layer, 3)


@needs_kernel
@given(SEEDS)
def test_spikes_are_removed_as_in_python(seed: int) -> None:
    one, other = with_and_without(lambda: remove_spikes(rings_with_spikes(seed)))
    assert one.xy.tobytes() == other.xy.tobytes()
    assert one.ring_start.tolist() == other.ring_start.tolist()
    assert one.ring_layer.tolist() == other.ring_layer.tolist()


@needs_kernel
@given(SEEDS)
def test_areas_of_rings_are_the_same_to_the_last_bit(seed: int) -> None:
    rng = np.random.default_rng(seed)
    sizes = rng.integers(3, 2000, rng.integers(1, 8))
    rings = rng.normal(100, 30, (sizes.sum(), 2))
    areas = Areas(rings, np.append(0, np.cumsum(sizes)), np.zeros(len(sizes), np.int64), 1)
    one, other = with_and_without(areas.ring_area)
    assert one.tobytes() == other.tobytes()


@needs_kernel
@given(SEEDS)
def test_edges_of_facets_are_matched_as_in_python(seed: int) -> None:
    rng = np.random.default_rng(seed)
    corners = rng.integers(0, rng.integers(2, 9), (3, 3 * int(rng.integers(1, 80)))).astype(np.float64)
    one, other = with_and_without(lambda: _match_edges(*corners))
    for found, expected in zip(one, other, strict=True):
        assert np.asarray(found).tolist() == np.asarray(expected).tolist()


def _require_kernel(monkeypatch: pytest.MonkeyPatch) -> Kernel:
    """The kernel, even if the environment switches it off."""
    monkeypatch.setenv(VARIABLE, "required")
    kernel = load_kernel()
    assert kernel
    return kernel


@needs_kernel
@pytest.mark.parametrize("start", [[], [1], [0, 3], [0, 2, 1]])
def test_offsets_that_do_not_match_are_an_error(start: list[int], monkeypatch: pytest.MonkeyPatch) -> None:
    kernel = _require_kernel(monkeypatch)
    with pytest.raises(ValueError, match=r"offsets|rings"):
        kernel.ring_areas(np.zeros((2, 2)), np.array(start, np.int64))


@needs_kernel
def test_coordinates_that_do_not_match_are_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    kernel = _require_kernel(monkeypatch)
    with pytest.raises(ValueError, match="do not match"):
        kernel.match_edges(np.zeros(3), np.zeros(3), np.zeros(6))
    with pytest.raises(ValueError, match="do not match"):
        kernel.match_edges(np.zeros(4), np.zeros(4), np.zeros(4))
    with pytest.raises(TypeError):
        kernel.match_edges(None, None, None)
