"""Operations in the compiled kernel give the same rings, to the last bit and in the same order, as those in Python."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer.arrays import Float
from printer_slicer.geometry import (
    Areas,
    clipper,
    difference,
    intersection,
    normalize,
    offset,
    offset_open,
    outlines_within,
    stroke_lines,
    union,
    window_intersection,
)
from printer_slicer.geometry.engine import load_engine, using_engine
from printer_slicer.geometry.spikes import is_spike
from printer_slicer.kernel import VARIABLE, load_kernel
from tests.kernels import SAME_BITS, needs_kernel
from tests.strategies import areas, box, clean_areas, rectilinear_areas

pytestmark = [
    needs_kernel,
    pytest.mark.skipif(not SAME_BITS, reason="clipper2 may round otherwise on this processor"),
]


def results(work: Callable[[], Areas]) -> list[tuple[bytes, ...]]:
    """What is computed with the kernel and without it, as bytes."""
    made = []
    for kernel in ("required", "off"):
        with pytest.MonkeyPatch.context() as patched, using_engine("clipper"):
            patched.setenv(VARIABLE, kernel)
            done = work()
            made.append((done.xy.tobytes(), done.ring_start.tobytes(), done.ring_layer.tobytes()))
    return made


def is_same(work: Callable[[], Areas]) -> bool:
    compiled, twin = results(work)
    return compiled == twin


def lines_within(outlines: Areas, stack: Areas) -> list[tuple[bytes, ...]]:
    """What is clipped with the kernel and without it, as bytes."""
    made = []
    for kernel in ("required", "off"):
        with pytest.MonkeyPatch.context() as patched, using_engine("clipper"):
            patched.setenv(VARIABLE, kernel)
            made.append(tuple(part.tobytes() for part in outlines_within(outlines, stack)))
    return made


def crowd(seed: int, n_layers: int) -> Areas:
    """Many triangles per layer, some of which overlap or touch; some layers have few."""
    rng = np.random.default_rng(seed)
    size = [int(rng.integers(0, 60)) for _ in range(n_layers)]
    return normalize(
        Areas.from_rings(
            [list(rng.integers(0, 40, (n, 1, 2)) + rng.uniform(-1.5, 1.5, (n, 3, 2))) for n in size]
        )
    )


def flat(seed: int) -> Areas:
    """Rings with points a few grid steps apart: slivers, spikes, and points that are repeated."""
    rng = np.random.default_rng(seed)
    rings = [rng.integers(0, [40, 4], (int(rng.integers(3, 12)), 2)) / 100_000 for _ in range(12)]
    return Areas.from_rings([rings[:5], [], rings[5:]])


@pytest.fixture
def required(monkeypatch: pytest.MonkeyPatch) -> None:
    """Use the kernel, also in a run without it."""
    monkeypatch.setenv(VARIABLE, "required")


def test_the_engine_is_the_compiled_one_if_there_is_a_kernel(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, "required")

    assert getattr(load_engine("clipper"), "__name__", "").endswith("compiled_clipper")

    monkeypatch.setenv(VARIABLE, "off")

    assert getattr(load_engine("clipper"), "__name__", "").endswith("geometry.clipper")


def test_the_kernel_has_the_version_of_clipper2_that_is_used_without_it() -> None:
    """Otherwise results may differ: put the files of that version into kernel/clipper2."""
    kernel = load_kernel()

    assert kernel is None or kernel.CLIPPER2_VERSION == clipper.CLIPPER2_VERSION


@given(areas(2))
def test_any_rings_are_merged_alike(stack: Areas) -> None:
    assert is_same(lambda: normalize(stack))


@pytest.mark.parametrize("combine", [union, difference, intersection])
@given(clean_areas(2), clean_areas(2))
def test_areas_are_combined_alike(combine: Callable[..., Areas], a: Areas, b: Areas) -> None:
    assert is_same(lambda: combine(a, b))


@pytest.mark.parametrize("combine", [union, difference, intersection])
@given(rectilinear_areas(2), rectilinear_areas(2))
def test_areas_with_common_sides_are_combined_alike(
    combine: Callable[..., Areas], a: Areas, b: Areas
) -> None:
    assert is_same(lambda: combine(a, b))


@pytest.mark.parametrize("combine", [union, difference, intersection])
@pytest.mark.parametrize("seed", range(8))
def test_crowded_layers_are_combined_alike(combine: Callable[..., Areas], seed: int) -> None:
    """They are split into columns, which decide the order of the rings."""
    assert is_same(lambda: combine(crowd(seed, 5), crowd(seed + 100, 5)))


@given(clean_areas(3), st.lists(st.integers(-300, 300), min_size=3, max_size=3))
def test_outlines_are_moved_alike(stack: Areas, by: list[int]) -> None:
    assert is_same(lambda: offset(stack, np.array(by) / 100))


@given(clean_areas(2), st.floats(-2.0, 2.0))
def test_outlines_are_moved_alike_with_round_joins(stack: Areas, by: float) -> None:
    assert is_same(lambda: offset(stack, by, join="round"))


@given(st.integers(0, 2**32 - 1), st.integers(1, 9))
def test_lines_are_drawn_alike(seed: int, n_lines: int) -> None:
    """Also several widths on a layer, lines that cross or return, and layers in any order."""
    rng = np.random.default_rng(seed)
    size = rng.integers(2, 6, n_lines)
    xy, start = rng.integers(-9, 9, (int(size.sum()), 2)) / 2, np.append(0, np.cumsum(size))
    layer, radius = rng.integers(0, 3, n_lines), rng.choice([0.2, 0.35, 1.5], n_lines)

    assert is_same(lambda: stroke_lines(xy, start, layer, radius, 4))


def test_no_lines_are_drawn_alike() -> None:
    none = np.zeros(0, np.int64)

    assert is_same(lambda: stroke_lines(np.zeros((0, 2)), np.zeros(1, np.int64), none, np.zeros(0), 2))


@given(clean_areas(2), st.floats(0.0, 3.0), st.floats(1.0, 3.0))
def test_narrow_parts_are_removed_alike(stack: Areas, by: float, limit: float) -> None:
    assert is_same(lambda: offset_open(stack, by, limit))


@pytest.mark.parametrize("by", [0.0, 4e-6, 5e-6, 1e-5, 0.02, -0.3])
def test_small_distances_are_skipped_alike(by: float) -> None:
    assert is_same(lambda: offset(crowd(1, 4), by))


@pytest.mark.parametrize("seed", range(20))
def test_rings_of_a_few_grid_steps_are_treated_alike(seed: int) -> None:
    stack = flat(seed)

    assert is_same(lambda: normalize(stack))
    assert is_same(lambda: offset(stack, 1e-4))
    assert is_same(lambda: difference(stack, Areas.from_rings([[box(0, 0, 2e-4, 1e-5)], [], []])))


@given(clean_areas(6), st.integers(0, 3), st.integers(1, 4))
def test_windows_are_intersected_alike(stack: Areas, below: int, above: int) -> None:
    own = np.arange(6)

    assert is_same(lambda: window_intersection(stack, own - below, own + above))


@given(clean_areas(3), clean_areas(3))
def test_outlines_are_clipped_alike(outlines: Areas, stack: Areas) -> None:
    compiled, twin = lines_within(outlines, stack)

    assert compiled == twin


@pytest.mark.parametrize("seed", range(8))
def test_outlines_are_clipped_alike_to_crowded_layers(seed: int) -> None:
    compiled, twin = lines_within(crowd(seed, 5), crowd(seed + 100, 5))

    assert compiled == twin
    assert any(compiled)


@given(areas(2))
def test_outlines_that_cross_are_clipped_alike(outlines: Areas) -> None:
    compiled, twin = lines_within(outlines, Areas.from_rings([[box(-5, -6, 7, 5)], [box(0, 0, 3, 9)]]))

    assert compiled == twin


@pytest.mark.parametrize("seed", range(20))
def test_spikes_are_found_alike(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    stack = flat(seed)
    found = is_spike(stack)
    monkeypatch.setenv(VARIABLE, "off")

    assert found.any()
    assert found.tolist() == is_spike(stack).tolist()


def arrays(n: int = 4, start: tuple[int, ...] = (0, 4), layer: tuple[int, ...] = (0,)) -> tuple[Float, ...]:
    return np.zeros((n, 2)), np.array(start, np.int64), np.array(layer, np.int64)


@pytest.mark.parametrize(
    "broken",
    [
        arrays(n=3),
        arrays(start=(0, 3)),
        arrays(start=(1, 4)),
        arrays(start=(0, 4, 2, 4), layer=(0, 0, 0)),
        arrays(start=(0, -1, 4), layer=(0, 0)),
        arrays(start=(0,)),
        arrays(start=(0, 2, 4), layer=(1, 0)),
        (np.zeros(9, np.int8), *arrays()[1:]),
    ],
)
@pytest.mark.usefixtures("required")
def test_arrays_that_do_not_match_are_errors(broken: tuple[Float, ...]) -> None:
    kernel = load_kernel()
    assert kernel

    with pytest.raises(ValueError, match=r"match|ascend|points"):
        kernel.combine_areas(0, *arrays(), *broken)
    with pytest.raises(ValueError, match=r"match|ascend|points"):
        kernel.clip_outlines(*arrays(), *broken)
    with pytest.raises(ValueError, match=r"match|ascend|points"):
        kernel.miter_areas(*broken, np.zeros(len(broken[2])), 2.0)
    with pytest.raises(ValueError, match=r"match|ascend|points"):
        kernel.inflate_paths(*broken, np.zeros(len(broken[2])), True)
    with pytest.raises(ValueError, match=r"match|ascend|points"):
        kernel.find_spikes(*broken)


@pytest.mark.usefixtures("required")
def test_other_wrong_arguments_are_errors() -> None:
    kernel = load_kernel()
    assert kernel

    with pytest.raises(ValueError, match="unknown operation"):
        kernel.combine_areas(3, *arrays(), *arrays())
    with pytest.raises(ValueError, match="one distance per ring"):
        kernel.miter_areas(*arrays(), np.zeros(2), 2.0)
    with pytest.raises(ValueError, match="one distance per path"):
        kernel.inflate_paths(*arrays(), np.zeros(2), True)
    with pytest.raises(TypeError):
        kernel.find_spikes(None, None, None)
