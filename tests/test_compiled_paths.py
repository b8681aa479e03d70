"""Functions of the kernel for boxes, paths and the medial axis: the same results as without it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer.geometry import Areas
from printer_slicer.geometry.boxes import Boxes
from printer_slicer.geometry.medial_axis import medial_axis
from printer_slicer.kernel import VARIABLE, load_kernel
from printer_slicer.perimeters.graph import AxisGraph
from printer_slicer.perimeters.simplification import points_to_keep
from tests.kernels import needs_kernel
from tests.strategies import rectilinear_areas

steps = st.tuples(st.integers(0, 4), st.integers(-1, 1), st.sampled_from([0.4, 0.401, 0.45]))
paths = st.lists(st.tuples(st.lists(steps, min_size=1, max_size=12), st.booleans()), max_size=4)


edge = st.tuples(st.sampled_from([0.0, 0.5, 1.0, 1.25, 7.0]), st.sampled_from([0.0, 0.25, 0.5]))
boxes = st.lists(st.tuples(edge, edge, st.integers(0, 2), st.booleans()), max_size=25)


def make_boxes(rows: list[tuple[tuple[float, float], tuple[float, float], int, bool]]) -> Boxes:
    """Boxes; some have no points, so their corners are infinite."""
    low = np.array([(np.inf, np.inf) if empty else (x[0], y[0]) for x, y, _, empty in rows]).reshape(-1, 2)
    high = np.array([(-np.inf,) * 2 if empty else (sum(x), sum(y)) for x, y, _, empty in rows])
    return Boxes(low, high.reshape(-1, 2), np.array([layer for _, _, layer, _ in rows], np.int64))


@needs_kernel
@given(boxes, boxes)
def test_overlapping_boxes_are_the_same_in_the_same_order(one: list, other: list) -> None:
    found = []
    for kernel in ("off", "required"):
        with pytest.MonkeyPatch.context() as patched:
            patched.setenv(VARIABLE, kernel)
            pairs = [*make_boxes(one).find_overlapping(make_boxes(other)), *make_boxes(one).find_neighbours()]
            found.append([index.tolist() for index in pairs])

    assert found[0] == found[1]


@needs_kernel
@pytest.mark.parametrize(("corners", "layers"), [(3, 2), (2, 3)])
def test_boxes_that_do_not_match_are_an_error(
    corners: int, layers: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(VARIABLE, "required")
    kernel = load_kernel()
    assert kernel
    arrays = np.zeros((corners, 2)), np.zeros((2, 2)), np.zeros(layers, np.int64)

    with pytest.raises(ValueError, match="do not match"):
        kernel.neighbouring_boxes(*arrays)
    with pytest.raises(ValueError, match="do not match"):
        kernel.overlapping_boxes(*arrays, *arrays)


@needs_kernel
@given(paths, st.sampled_from([0.002, 0.01]))
def test_points_to_keep_are_the_same(
    given_paths: list[tuple[list[tuple[int, int, float]], bool]], tolerance: float
) -> None:
    """Also of points that deviate equally, and of points that coincide."""
    rows = np.array([step for path, _ in given_paths for step in path]).reshape(-1, 3)
    size = np.array([len(path) for path, _ in given_paths], np.int64)
    closed = np.array([is_closed for _, is_closed in given_paths], np.bool_)
    xy = np.column_stack([np.cumsum(rows[:, 0]), rows[:, 1] * 0.003])
    kept = []
    for kernel in ("off", "required"):
        with pytest.MonkeyPatch.context() as patched:
            patched.setenv(VARIABLE, kernel)
            kept.append(points_to_keep(xy, rows[:, 2], size, closed, tolerance).tolist())

    assert kept[0] == kept[1]


@needs_kernel
def test_points_of_a_fine_circle_are_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    angle = np.sort(np.random.default_rng(1).uniform(0, 2 * np.pi, 700))
    xy, width = 5 * np.column_stack([np.cos(angle), np.sin(angle)]), 0.4 + 0.05 * np.sin(3 * angle)
    size, closed = np.array([400, 300]), np.array([False, True])
    monkeypatch.setenv(VARIABLE, "required")
    kept = points_to_keep(xy, width, size, closed, 0.004)
    monkeypatch.setenv(VARIABLE, "off")

    assert 20 < kept.sum() < 500
    np.testing.assert_array_equal(points_to_keep(xy, width, size, closed, 0.004), kept)


@needs_kernel
@pytest.mark.parametrize("sizes", [[2], [2, 2], [3, 0], [4, -1]])
def test_wrong_sizes_of_paths_are_an_error(sizes: list[int], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, "required")
    kernel = load_kernel()
    assert kernel

    with pytest.raises(ValueError, match="do not match"):
        kernel.points_to_keep(np.zeros(9).data, np.array(sizes).data, np.ones(len(sizes), np.int64).data, 0.1)


@needs_kernel
@given(rectilinear_areas(2), st.integers(0, 2**32 - 1), st.integers(0, 40))
def test_divided_pieces_are_the_same(areas: Areas, seed: int, n_cuts: int) -> None:
    graph, rng = AxisGraph.of(medial_axis(areas, 4.0)), np.random.default_rng(seed)
    n_pieces = len(graph.steepness)
    piece = rng.integers(0, max(n_pieces, 1), n_cuts if n_pieces else 0)
    share = rng.choice([0.25, 0.5, *rng.random(8)], len(piece))
    divided = []
    for kernel in ("off", "required"):
        with pytest.MonkeyPatch.context() as patched:
            patched.setenv(VARIABLE, kernel)
            divided.append(graph.divide_pieces(piece, share))

    for name in AxisGraph.__annotations__:
        one, other = (getattr(parts, name) for parts in divided)
        assert (name, one.dtype, one.shape, one.tobytes()) == (
            name,
            other.dtype,
            other.shape,
            other.tobytes(),
        )


@needs_kernel
@pytest.mark.parametrize(
    ("following", "piece", "message"),
    [
        ([1, 0], [0], "do not match"),
        ([1, 0, 2, 4], [0], "does not exist"),
        ([1, 0, 2, 3], [2], "order of pieces"),
        ([1, 0, 2, 3], [-1], "order of pieces"),
        ([1, 0, 2, 3], [0, 1], "do not match"),
    ],
)
def test_pieces_that_do_not_match_are_an_error(
    following: list[int], piece: list[int], message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(VARIABLE, "required")
    kernel = load_kernel()
    assert kernel
    start, cut = np.arange(4), np.array([0.5])

    with pytest.raises(ValueError, match=message):
        kernel.divide_pieces(
            4, start.data, np.zeros(16).data, np.array(following).data, np.array(piece).data, cut.data
        )
