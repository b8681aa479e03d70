"""The search tree of the compiled kernel finds the same segments as that of shapely."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from printer_slicer.geometry.planar import SegmentTree
from printer_slicer.geometry.polyline_tree import PolylineTree
from printer_slicer.kernel import VARIABLE, load_kernel
from tests.kernels import needs_kernel

coarse = st.integers(-6, 6).map(float)  # boxes often touch at their edges and corners
fine = st.floats(-1e3, 1e3).map(lambda x: round(x, 9))  # shapely finds no distance from sides of 1e-300 mm


def points_of(shape: tuple[int, ...]) -> st.SearchStrategy[np.ndarray]:
    return st.one_of(arrays.arrays(np.float64, shape, elements=of) for of in (coarse, fine))


def pairs(found: tuple[np.ndarray, np.ndarray]) -> list[tuple[int, int]]:
    return sorted(zip(found[0].tolist(), found[1].tolist(), strict=True))


@needs_kernel
@given(st.data(), st.integers(1, 150), st.integers(0, 9))
def test_boxes_touch_the_same_segments(data: st.DataObject, n_segments: int, n_boxes: int) -> None:
    ends = data.draw(points_of((n_segments, 2, 2)))
    boxes = data.draw(points_of((n_boxes, 2, 2)))
    with pytest.MonkeyPatch.context() as patched:
        patched.setenv(VARIABLE, "required")
        found = PolylineTree(ends).query_boxes(boxes[:, 0], boxes[:, 1])

    assert pairs(found) == pairs(SegmentTree(ends).query_boxes(boxes[:, 0], boxes[:, 1]))
    assert pairs(found) == list(zip(found[0].tolist(), found[1].tolist(), strict=True))


@needs_kernel
@given(st.data(), st.integers(1, 150), st.integers(0, 20))
def test_the_nearest_segment_is_the_first_of_the_nearest(
    data: st.DataObject, n_segments: int, n_points: int
) -> None:
    ends, points = data.draw(points_of((n_segments, 2, 2))), data.draw(points_of((n_points, 2)))
    with pytest.MonkeyPatch.context() as patched:
        patched.setenv(VARIABLE, "required")
        found = PolylineTree(ends).nearest(points)

    assert found.tolist() == SegmentTree(ends).first_nearest(points).tolist()


@needs_kernel
def test_points_beside_corners_of_long_outlines_have_the_same_segment_in_both_trees() -> None:
    """The two sides of a corner are equally near."""
    rng = np.random.default_rng(11)
    for n_segments in (7, 8, 9, 600):
        line = np.round(np.cumsum(rng.normal(size=(n_segments + 1, 2)), axis=0), 5)
        ends = np.stack([line[:-1], line[1:]], axis=1)
        points = line[rng.integers(0, len(line), 300)] + rng.normal(scale=0.2, size=(300, 2))
        with pytest.MonkeyPatch.context() as patched:
            patched.setenv(VARIABLE, "required")
            found = PolylineTree(ends).nearest(points)

        assert found.tolist() == SegmentTree(ends).first_nearest(points).tolist()


@needs_kernel
def test_long_rows_of_segments_are_searched_completely() -> None:
    """Enough for several levels of boxes; the numbers of segments fill them or leave one over."""
    rng = np.random.default_rng(3)
    for n_segments in (511, 512, 513, 4096, 4097):
        line = np.cumsum(rng.normal(size=(n_segments + 1, 2)), axis=0)
        ends = np.stack([line[:-1], line[1:]], axis=1)
        low = rng.uniform(line.min(axis=0), line.max(axis=0), (50, 2))
        with pytest.MonkeyPatch.context() as patched:
            patched.setenv(VARIABLE, "required")
            found = pairs(PolylineTree(ends).query_boxes(low, low + 3.0))

        assert found == pairs(SegmentTree(ends).query_boxes(low, low + 3.0)) != []


@needs_kernel
def test_wrong_arrays_are_errors(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, "required")
    kernel = load_kernel()
    assert kernel
    ends, empty = np.zeros((9, 4)), np.zeros((0, 4))
    boxes = kernel.build_polyline_tree(ends.data)

    with pytest.raises(ValueError, match="four numbers"):
        kernel.build_polyline_tree(np.zeros(7).data)
    with pytest.raises(ValueError, match="four numbers"):
        kernel.query_polyline_tree(ends.data, boxes, np.zeros(3).data)
    with pytest.raises(ValueError, match="two numbers"):
        kernel.nearest_segments(ends.data, boxes, np.zeros(3).data)
    for wrong in (ends[:8], np.zeros((17, 4)), empty):
        with pytest.raises(ValueError, match="do not match"):
            kernel.query_polyline_tree(wrong.data, boxes, ends.data)
        with pytest.raises(ValueError, match="do not match"):
            kernel.nearest_segments(wrong.data, boxes, np.zeros(2).data)
    assert kernel.build_polyline_tree(empty.data) == b""
