"""The ragged arrays: what they promise, and that they hold it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer.geometry import Areas, Lines
from printer_slicer.geometry.areas import consecutive, per_layer
from tests.strategies import areas, box


def test_a_hole_is_taken_off_the_area_of_its_layer() -> None:
    stack = Areas.from_rings([[box(0, 0, 4, 3), box(1, 1, 2, 2)[::-1]], [], [box(0, 0, 1, 1)]])

    assert stack.area().tolist() == [11, 0, 1]
    assert stack.ring_area().tolist() == [12, -1, 1]
    assert stack.ring_length().tolist() == [14, 4, 4]


def test_areas_far_from_the_origin_keep_their_digits() -> None:
    stack = Areas.from_rings([[box(0, 0, 0.001, 0.001) + 1e6]])

    assert stack.area()[0] == pytest.approx(1e-6, rel=1e-4)


def test_an_empty_stack_keeps_its_layers() -> None:
    stack = Areas.empty(3)

    assert stack.area().tolist() == [0, 0, 0]
    assert stack.layer_start.tolist() == [0, 0, 0, 0]
    assert stack.ring_area().shape == stack.ring_length().shape == stack.following.shape == (0,)


def test_the_arrays_cannot_be_written() -> None:
    stack = Areas.from_rings([[box(0, 0, 1, 1)]])

    with pytest.raises(ValueError, match="read-only"):
        stack.xy[0] = 5


@pytest.mark.parametrize("layers", [[0, 3], [-1, 0]])
def test_rings_of_layers_that_do_not_exist_are_refused(layers: list[int]) -> None:
    with pytest.raises(ValueError, match="layers"):
        Areas(np.zeros((6, 2)), np.array([0, 3, 6]), np.array(layers), 3)


def test_arrays_that_do_not_fit_each_other_are_refused() -> None:
    with pytest.raises(ValueError, match="one entry more"):
        Areas(np.zeros((3, 2)), np.array([0, 3]), np.array([0, 1]), 2)
    with pytest.raises(ValueError, match="shape"):
        Lines(
            np.zeros((2, 2, 2)),
            np.zeros(1, np.int64),
            np.zeros(2, np.int64),
            np.zeros((2, 2)),
            np.zeros((2, 2)),
        )


def test_rings_under_three_points_are_dropped() -> None:
    stack = Areas.from_rings([[box(0, 0, 1, 1)[:2]], [box(0, 0, 1, 1)]])

    assert stack.ring_layer.tolist() == [1]


def test_the_rings_of_a_layer_are_those_that_were_put_in() -> None:
    first, second = box(0, 0, 1, 1), box(5, 5, 6, 7)
    stack = Areas.from_rings([[], [first, second], []])

    assert [ring.tolist() for ring in stack.rings(1)] == [first.tolist(), second.tolist()]
    assert stack.ring(1).tolist() == second.tolist()
    assert [*stack.rings(0), *stack.rings(2)] == []


@given(areas(3))
def test_the_point_after_the_last_of_a_ring_is_its_first(stack: Areas) -> None:
    for i in range(stack.n_rings):
        ring = slice(stack.ring_start[i], stack.ring_start[i + 1])
        assert np.array_equal(stack.xy[stack.following[ring]], np.roll(stack.ring(i), -1, axis=0))


@given(areas(3), st.data())
def test_selected_and_rejected_rings_merge_to_the_whole(stack: Areas, data: st.DataObject) -> None:
    keep = np.array(data.draw(st.lists(st.booleans(), min_size=stack.n_rings, max_size=stack.n_rings)), bool)
    merged = stack.select(keep).merge(stack.select(~keep))

    assert merged.area() == pytest.approx(stack.area())
    assert np.array_equal(merged.ring_layer, stack.ring_layer)
    for layer in range(3):
        assert {r.tobytes() for r in merged.rings(layer)} == {r.tobytes() for r in stack.rings(layer)}


@given(areas(3), st.lists(st.integers(0, 2), max_size=6))
def test_layers_are_taken_as_often_as_they_are_named(stack: Areas, source: list[int]) -> None:
    made = stack.at(np.array(source, np.int64))

    assert made.n_layers == len(source)
    for layer, k in enumerate(source):
        assert [ring.tolist() for ring in made.rings(layer)] == [ring.tolist() for ring in stack.rings(k)]


def test_stacks_of_different_height_do_not_merge() -> None:
    with pytest.raises(ValueError, match="2 and 3 layers"):
        Areas.empty(2).merge(Areas.empty(3))


def test_consecutive_numbers_follow_from_first_and_count() -> None:
    assert consecutive(np.array([5, 0, 9]), np.array([2, 0, 3])).tolist() == [5, 6, 9, 10, 11]


def test_one_value_holds_for_all_layers() -> None:
    assert per_layer(0.5, 3).tolist() == [0.5, 0.5, 0.5]
    assert per_layer(np.array([1.0, 2.0]), 2).tolist() == [1, 2]


@pytest.mark.parametrize("value", [np.zeros(3), np.zeros((2, 1)), float("nan")])
def test_values_that_are_not_one_per_layer_are_refused(value: float | np.ndarray) -> None:
    with pytest.raises(ValueError, match="layer"):
        per_layer(value, 2)
