"""Rectangles that overlap or touch: every pair once, none across layers, against asking each for each."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer.geometry.boxes import Boxes

# On a small lattice many touch, begin together, or are points and lines.
ends = st.tuples(st.integers(0, 6), st.integers(0, 3))
rectangles = st.lists(st.tuples(ends, ends, st.integers(0, 2)), max_size=12)


def boxes_of(drawn: list[tuple[tuple[int, int], tuple[int, int], int]]) -> Boxes:
    """Lower ends and extents of both axes, and the layer."""
    x, y = (np.array([one[axis] for one in drawn], np.float64).reshape(-1, 2) for axis in (0, 1))
    low = np.column_stack([x[:, 0], y[:, 0]])
    return Boxes(
        low, low + np.column_stack([x[:, 1], y[:, 1]]), np.array([one[2] for one in drawn], np.int64)
    )


def meet(one: Boxes, i: int, other: Boxes, j: int) -> bool:
    apart = (one.low[i] > other.high[j]).any() or (other.low[j] > one.high[i]).any()
    return bool(one.layer[i] == other.layer[j] and not apart)


@given(rectangles, rectangles)
def test_each_pair_that_overlaps_is_found_once(
    first: list[tuple[tuple[int, int], tuple[int, int], int]],
    second: list[tuple[tuple[int, int], tuple[int, int], int]],
) -> None:
    one, other = boxes_of(first), boxes_of(second)
    pairs = [(i, j) for i in range(len(first)) for j in range(len(second)) if meet(one, i, other, j)]

    found = sorted(zip(*(part.tolist() for part in one.find_overlapping(other)), strict=True))
    assert found == pairs
    assert one.touches_any(other).tolist() == [i in {a for a, _ in pairs} for i in range(len(first))]


@given(rectangles)
def test_neighbours_are_pairs_of_different_ones_each_once(
    drawn: list[tuple[tuple[int, int], tuple[int, int], int]],
) -> None:
    boxes = boxes_of(drawn)
    pairs = [(i, j) for j in range(len(drawn)) for i in range(j) if meet(boxes, i, boxes, j)]

    found = zip(*(part.tolist() for part in boxes.find_neighbours()), strict=True)
    assert sorted((min(pair), max(pair)) for pair in found) == sorted(pairs)


@given(rectangles, rectangles, st.data())
def test_boxes_around_nothing_meet_nothing(
    first: list[tuple[tuple[int, int], tuple[int, int], int]],
    second: list[tuple[tuple[int, int], tuple[int, int], int]],
    data: st.DataObject,
) -> None:
    one, other = boxes_of(first), boxes_of(second)
    empty = np.array([data.draw(st.booleans()) for _ in first], bool)
    low, high = np.where(empty[:, None], np.inf, one.low), np.where(empty[:, None], -np.inf, one.high)

    with_empty = Boxes(low, high, one.layer)
    found = sorted(zip(*(part.tolist() for part in with_empty.find_overlapping(other)), strict=True))
    pairs = zip(*(part.tolist() for part in one.find_overlapping(other)), strict=True)
    assert found == sorted((i, j) for i, j in pairs if not empty[i])
