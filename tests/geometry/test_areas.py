"""The ragged arrays: what they promise, and that they hold it."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer.arrays import (
    bounding_boxes,
    consecutive,
    next_in_ring,
    per_layer,
    polyline_lengths,
    previous_in_ring,
    run_starts,
)
from printer_slicer.geometry import Areas, Lines
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
    made = stack.copy_layers(np.array(source, np.int64))

    assert made.n_layers == len(source)
    for layer, k in enumerate(source):
        assert [ring.tolist() for ring in made.rings(layer)] == [ring.tolist() for ring in stack.rings(k)]


@given(areas(3), st.lists(st.integers(0, 2), max_size=6), st.data())
def test_equal_layers_are_found(stack: Areas, source: list[int], data: st.DataObject) -> None:
    made = stack.copy_layers(np.array(source, np.int64))
    heights = data.draw(st.lists(st.sampled_from([0.1, 0.2]), min_size=len(source), max_size=len(source)))
    alike = [([ring.tolist() for ring in made.rings(layer)], height) for layer, height in enumerate(heights)]

    assert made.find_first_equal_layers(np.array(heights)).tolist() == [alike.index(one) for one in alike]


def test_layers_of_the_same_points_in_other_rings_are_not_equal() -> None:
    eight = np.concatenate([box(0, 0, 4, 4), box(5, 0, 9, 4)])
    stack = Areas.from_rings([[eight[:4], eight[4:]], [eight[:5], eight[5:]], [eight[:4], eight[4:]]])

    assert stack.find_first_equal_layers().tolist() == [0, 1, 0]


@given(areas(3), st.lists(st.integers(0, 2), max_size=6))
def test_layers_are_chosen_by_a_mask_or_by_their_numbers(stack: Areas, numbers: list[int]) -> None:
    mask = np.array([layer in numbers for layer in range(3)])

    for chosen in (stack.of_layers(mask), stack.of_layers(np.array(numbers, np.int64))):
        assert chosen.area() == pytest.approx(np.where(mask, stack.area(), 0))
        assert chosen.length() == pytest.approx(np.where(mask, stack.length(), 0))
        assert chosen.used.tolist() == (mask & stack.used).tolist()


@given(areas(3))
def test_a_layer_is_used_if_it_has_rings_and_as_long_as_they_are_together(stack: Areas) -> None:
    rings = [list(stack.rings(layer)) for layer in range(3)]
    around = [sum(np.hypot(*(np.roll(ring, -1, axis=0) - ring).T).sum() for ring in layer) for layer in rings]

    assert stack.used.tolist() == [len(layer) > 0 for layer in rings]
    assert stack.length() == pytest.approx(np.array(around))


def test_former_names_of_methods_warn_and_work() -> None:
    stack = Areas.from_rings([[box(0, 0, 1, 1)], [box(2, 2, 3, 3)]])

    with pytest.warns(FutureWarning, match=r"Areas\.raised is now called Areas\.shift_layers"):
        assert stack.raised(1).xy.tolist() == stack.shift_layers(1).xy.tolist()
    with pytest.warns(FutureWarning, match=r"Areas\.for_each is now called Areas\.copy_layers"):
        assert stack.for_each(np.array([1])).xy.tolist() == stack.ring(1).tolist()
    with pytest.warns(FutureWarning, match=r"Areas\.following_on is now called Areas\.concatenate"):
        assert Areas.following_on([stack], 2).xy.tolist() == stack.xy.tolist()


def test_stacks_of_different_height_do_not_merge() -> None:
    with pytest.raises(ValueError, match="different numbers of layers: 2 and 3"):
        Areas.empty(2).merge(Areas.empty(3))


@given(st.lists(st.integers(0, 2)))
def test_runs_begin_where_a_value_differs_from_the_one_before(values: list[int]) -> None:
    begins = run_starts(np.array(values, np.int64))

    assert begins.tolist() == [i == 0 or value != values[i - 1] for i, value in enumerate(values)]


def test_consecutive_numbers_follow_from_first_and_count() -> None:
    assert consecutive(np.array([5, 0, 9]), np.array([2, 0, 3])).tolist() == [5, 6, 9, 10, 11]


def test_one_value_holds_for_all_layers() -> None:
    assert per_layer(0.5, 3).tolist() == [0.5, 0.5, 0.5]
    assert per_layer(np.array([1.0, 2.0]), 2).tolist() == [1, 2]


@pytest.mark.parametrize("value", [np.zeros(3), np.zeros((2, 1)), float("nan")])
def test_values_that_are_not_one_per_layer_are_refused(value: float | np.ndarray) -> None:
    with pytest.raises(ValueError, match="layer"):
        per_layer(value, 2)


@given(st.lists(st.tuples(st.integers(0, 5), st.booleans()), max_size=6))
def test_the_last_item_of_a_ring_is_followed_by_its_first_and_that_of_an_open_run_by_itself(
    runs: list[tuple[int, bool]],
) -> None:
    start = np.cumsum([0, *(size for size, _ in runs)])
    rings = [list(range(a, b)) for a, b in pairwise(start.tolist())]

    following = next_in_ring(start).tolist()
    opened = next_in_ring(start, np.array([closed for _, closed in runs], np.bool_)).tolist()

    assert following == [i for ring in rings for i in ring[1:] + ring[:1]]
    assert previous_in_ring(start)[following].tolist() == list(range(start[-1]))
    assert opened == [
        i
        for ring, (_, closed) in zip(rings, runs, strict=True)
        for i in ring[1:] + (ring[:1] if closed else ring[-1:])
    ]


@given(areas(3), st.data())
def test_rings_are_found_by_their_layers(stack: Areas, data: st.DataObject) -> None:
    flags = np.array(data.draw(st.lists(st.booleans(), min_size=stack.n_layers, max_size=stack.n_layers)))
    entries = data.draw(st.lists(st.integers(0, stack.n_layers - 1), max_size=6))

    some, each = stack.of_layers(flags), stack.copy_layers(np.array(entries, np.int64))

    nothing = np.zeros((0, 2))
    for k, wanted in enumerate(flags.tolist()):
        expected = np.concatenate([nothing, *stack.rings(k)]) if wanted else nothing
        assert np.array_equal(np.concatenate([nothing, *some.rings(k)]), expected)
    assert (some.n_layers, each.n_layers) == (stack.n_layers, len(entries))
    for entry, k in enumerate(entries):
        assert [ring.tolist() for ring in each.rings(entry)] == [ring.tolist() for ring in stack.rings(k)]


@given(areas(4), st.integers(-5, 5))
def test_raised_layers_have_the_area_of_those_below(stack: Areas, by: int) -> None:
    raised = stack.shift_layers(by)

    for k in range(stack.n_layers):
        below = stack.rings(k - by) if 0 <= k - by < stack.n_layers else []
        assert [ring.tolist() for ring in raised.rings(k)] == [ring.tolist() for ring in below]


def test_boxes_are_around_what_each_owns() -> None:
    points = np.array([[0, 5], [3, 1], [2, 2], [-4, 9], [7, 7]])

    low, high = bounding_boxes(points, np.array([0, 2, 3, 5]), np.array([0, 0, 2]), 4)

    inf = np.inf
    assert low.tolist() == [[0, 1], [inf, inf], [-4, 7], [inf, inf]]
    assert high.tolist() == [[3, 5], [-inf, -inf], [7, 9], [-inf, -inf]]


def test_lengths_are_of_open_and_of_closed_lines() -> None:
    xy = np.concatenate([box(0, 0, 4, 3), box(10, 10, 11, 11), [[7.0, 7.0]]])
    start = np.array([0, 4, 8, 9])

    assert polyline_lengths(xy, start).tolist() == [14, 4, 0]
    assert polyline_lengths(xy, start, closed=False).tolist() == [11, 3, 0]
    assert polyline_lengths(xy, start, np.array([False, True, True])).tolist() == [11, 4, 0]
    assert polyline_lengths(xy[:0], start[:1]).shape == (0,)


def test_points_know_their_rings_and_layers() -> None:
    stack = Areas.from_rings([[box(0, 0, 4, 3), box(1, 1, 2, 2)[1:]], [], [box(0, 0, 1, 1)]])

    assert stack.point_ring.tolist() == [0, 0, 0, 0, 1, 1, 1, 2, 2, 2, 2]
    assert stack.point_layer.tolist() == [0, 0, 0, 0, 0, 0, 0, 2, 2, 2, 2]


@given(areas(3), st.data())
def test_changed_layers_are_those_with_other_rings(stack: Areas, data: st.DataObject) -> None:
    moved = np.array(
        data.draw(st.lists(st.booleans(), min_size=stack.n_layers, max_size=stack.n_layers)), np.bool_
    )
    xy = stack.xy + 0.25 * moved[np.repeat(stack.ring_layer, np.diff(stack.ring_start))][:, None]
    other = Areas(xy, stack.ring_start, stack.ring_layer, stack.n_layers)

    assert (stack.find_changed_layers(other) == moved & stack.used).all()
    assert not stack.find_changed_layers(stack).any()
    assert (stack.find_changed_layers(Areas.empty(stack.n_layers)) == stack.used).all()
    assert (stack.find_changed_layers(stack.of_layers(~moved)) == moved & stack.used).all()
