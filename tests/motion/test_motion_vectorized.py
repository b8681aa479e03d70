"""The time of whole programs agrees with the planner that goes move by move."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from math import sqrt

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from printer_slicer.motion.durations import (
    RequestedMoves,
    Stopwatch,
    compute_durations,
    compute_durations_of_batches,
)
from printer_slicer.motion.rules import MotionLimits, compute_block_times, compute_ramp_time, make_block
from printer_slicer.motion.vectorized import plan_speeds

MARLIN = MotionLimits(
    max_speed=(300.0, 300.0, 12.0, 50.0),
    max_acceleration=(3000.0, 2500.0, 100.0, 5000.0),
    acceleration=1000.0,
    travel_acceleration=1500.0,
    retract_acceleration=2000.0,
    corner="junction_deviation",
    junction_deviation=0.02,
    jerk=(10.0, 8.0, 0.4, 5.0),
    square_corner_velocity=5.0,
)
MACHINES = [
    replace(MARLIN, corner=corner, minimum_cruise_ratio=ratio)
    for corner in ("junction_deviation", "jerk", "square_corner")
    for ratio in (0.0, 0.5)
]
MACHINES.append(replace(MARLIN, min_segment_seconds=0.02))


def one_by_one(delta: np.ndarray, speed: np.ndarray, limits: MotionLimits) -> np.ndarray:
    blocks = [make_block(limits, tuple(d), v) for d, v in zip(delta.tolist(), speed.tolist(), strict=True)]
    seconds = np.zeros(len(delta))
    seconds[[b is not None for b in blocks]] = compute_block_times(
        [b for b in blocks if b is not None], limits
    )
    return seconds


def print_like(n_moves: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Curves of short pieces, long lines, travel, retractions, lifts and moves that go nowhere."""
    rng = np.random.default_rng(seed)
    heading = np.cumsum(rng.normal(0, 0.4, n_moves))
    length = rng.exponential(2.0, n_moves) * rng.choice([0.02, 1.0, 20.0], n_moves)
    delta = np.stack([length * np.cos(heading), length * np.sin(heading), 0 * length, length * 0.03], axis=1)
    kind = rng.random(n_moves)
    delta[kind < 0.1, 3] = 0.0
    delta[kind < 0.04, :2] = 0.0
    delta[kind < 0.02, 3] = rng.choice([-0.8, 0.8])
    delta[(kind > 0.02) & (kind < 0.03), 2] = 0.2
    return delta, rng.choice([0.0, 20.0, 60.0, 150.0], n_moves)


@pytest.mark.parametrize(
    "limits", MACHINES, ids=lambda m: f"{m.corner}-{m.minimum_cruise_ratio}-{m.min_segment_seconds}"
)
def test_a_print_takes_as_long_as_its_moves_one_by_one(limits: MotionLimits) -> None:
    delta, speed = print_like(6_000, seed=7)

    np.testing.assert_allclose(
        compute_durations(delta, speed, limits), one_by_one(delta, speed, limits), rtol=1e-9, atol=0
    )


def test_no_segment_is_shorter_than_the_machine_allows() -> None:
    delta, speed = print_like(5_000, seed=3)
    moves = np.abs(delta).max(axis=1) > 0.01  # shorter ones would crawl

    usual = compute_durations(delta, speed, MARLIN)
    slow = compute_durations(delta, speed, replace(MARLIN, min_segment_seconds=0.02))

    assert usual[moves].min() < 0.01
    assert slow[moves].min() >= 0.02 - 1e-9
    assert slow.sum() > usual.sum()


coordinates = st.one_of(st.just(0.0), st.floats(-40, 40), st.floats(-0.2, 0.2), st.sampled_from([-1.0, 1.0]))
moves = st.lists(
    st.tuples(coordinates, coordinates, coordinates, coordinates, st.floats(0.1, 300)), max_size=40
)


@given(moves, st.sampled_from(MACHINES))
@settings(deadline=None)
def test_any_moves_take_as_long_as_one_by_one(
    rows: list[tuple[float, float, float, float, float]], limits: MotionLimits
) -> None:
    columns = np.array(rows, dtype=np.float64).reshape(-1, 5)
    delta, speed = columns[:, :4], columns[:, 4]

    np.testing.assert_allclose(
        compute_durations(delta, speed, limits), one_by_one(delta, speed, limits), rtol=1e-9, atol=0
    )


@pytest.mark.parametrize(
    "limits", MACHINES[:-1], ids=lambda m: f"{m.corner}-{m.minimum_cruise_ratio}-{m.min_segment_seconds}"
)
def test_a_million_pieces_of_a_line_take_as_long_as_the_line(limits: MotionLimits) -> None:
    # A travel of 40 m: a sum of what the pieces gain would have grown to 1e8 (mm/s)² and lost eight digits.
    delta = np.tile([0.024, 0.032, 0.0, 0.0], (1_000_000, 1))

    seconds = compute_durations(delta, np.full(len(delta), 200.0), limits)

    assert seconds.sum() == pytest.approx(compute_ramp_time(40_000.0, 0.0, 200.0, 0.0, 1500.0), rel=1e-9)
    # The last piece brakes from what 0.04 mm allow: a slow corner a million moves away keeps its digits.
    assert seconds[-1] == pytest.approx(sqrt(2 * 0.04 / 1500.0), rel=1e-9)


@pytest.mark.parametrize(
    "limits", MACHINES, ids=lambda m: f"{m.corner}-{m.minimum_cruise_ratio}-{m.min_segment_seconds}"
)
def test_a_stop_parts_the_plan(limits: MotionLimits) -> None:
    delta, speed = print_like(300, seed=3)
    delta[120] = 0.0  # a stop after a move that goes nowhere is a stop all the same
    stops = np.zeros(300, dtype=bool)
    stops[[50, 120, 299]] = True

    seconds = compute_durations(delta, speed, limits, stop_after=stops)

    parts = [slice(0, 51), slice(51, 121), slice(121, 300)]
    expected = np.concatenate([one_by_one(delta[part], speed[part], limits) for part in parts])
    np.testing.assert_allclose(seconds, expected, rtol=1e-9, atol=0)


@pytest.mark.parametrize(
    "limits", MACHINES, ids=lambda m: f"{m.corner}-{m.minimum_cruise_ratio}-{m.min_segment_seconds}"
)
def test_acceleration_of_each_move_replaces_that_of_the_machine(limits: MotionLimits) -> None:
    delta, speed = print_like(200, seed=5)
    delta[99:101] = 0.0
    wanted = np.repeat([400.0, 2400.0], 100)
    stops = np.arange(200) == 99

    seconds = compute_durations(delta, speed, limits, stop_after=stops, acceleration=wanted)

    expected = [
        one_by_one(
            delta[part],
            speed[part],
            replace(limits, acceleration=a, travel_acceleration=a, retract_acceleration=a),
        )
        for part, a in ((slice(0, 100), 400.0), (slice(100, 200), 2400.0))
    ]
    np.testing.assert_allclose(seconds, np.concatenate(expected), rtol=1e-9, atol=0)


def test_no_moves_take_no_time() -> None:
    assert compute_durations(np.zeros((0, 4)), np.zeros(0), MARLIN).shape == (0,)
    assert compute_durations(np.zeros((3, 4)), np.ones(3), MARLIN).tolist() == [0.0, 0.0, 0.0]


def test_arguments_are_left_as_they_were() -> None:
    delta, speed = print_like(100, seed=1)
    kept = delta.copy(), speed.copy()
    delta.flags.writeable = speed.flags.writeable = False

    compute_durations(delta, speed, MARLIN)

    assert np.array_equal(delta, kept[0])
    assert np.array_equal(speed, kept[1])


def test_faster_is_never_slower() -> None:
    delta, speed = print_like(500, seed=2)

    slow, fast = compute_durations(delta, speed, MARLIN), compute_durations(delta, 2 * speed, MARLIN)

    assert fast.sum() < slow.sum()


# In pieces


def in_pieces(wanted: RequestedMoves, limits: MotionLimits, cuts: list[int]) -> float:
    watch = Stopwatch(limits)
    for first, last in pairwise([0, *cuts, len(wanted.speed)]):
        watch.add(wanted.take_slice(slice(first, last)))
    return watch.stop_and_sum()


def at_once(wanted: RequestedMoves, limits: MotionLimits) -> float:
    return float(
        compute_durations(
            wanted.delta, wanted.speed, limits, stop_after=wanted.stop, acceleration=wanted.acceleration
        ).sum()
    )


@pytest.mark.parametrize(
    "limits", MACHINES, ids=lambda m: f"{m.corner}-{m.minimum_cruise_ratio}-{m.min_segment_seconds}"
)
@pytest.mark.parametrize("stops", [0.0, 0.01])
def test_a_print_takes_as_long_in_pieces(limits: MotionLimits, stops: float) -> None:
    delta, speed = print_like(5000, seed=11)
    rng = np.random.default_rng(3)
    wanted = RequestedMoves(delta, speed, rng.choice([400.0, 2500.0], 5000), rng.random(5000) < stops)
    cuts = sorted(rng.integers(0, 5000, 300).tolist())

    assert in_pieces(wanted, limits, cuts) == pytest.approx(at_once(wanted, limits), rel=1e-12)


@pytest.mark.parametrize("limits", MACHINES, ids=lambda m: f"{m.corner}-{m.minimum_cruise_ratio}")
def test_each_move_takes_as_long_in_batches(limits: MotionLimits) -> None:
    delta, speed = print_like(5000, seed=12)
    delta[::97] = 0.0
    wanted = RequestedMoves(delta, speed, None, None)
    batches = [wanted.take_slice(slice(first, first + 700)) for first in range(0, 5000, 700)]
    planned = plan_speeds(delta, speed, limits)

    np.testing.assert_allclose(
        compute_durations_of_batches(batches, 5000, limits),
        planned.move_times(5000, len(planned.moving)),
        rtol=1e-12,
        atol=0,
    )


@given(moves, st.sampled_from(MACHINES), st.lists(st.integers(0, 40)), st.data())
@settings(deadline=None)
def test_any_moves_take_as_long_in_any_pieces(
    rows: list[tuple[float, float, float, float, float]],
    limits: MotionLimits,
    cuts: list[int],
    data: st.DataObject,
) -> None:
    columns = np.array(rows, dtype=np.float64).reshape(-1, 5)
    stop = np.array(data.draw(st.lists(st.booleans(), min_size=len(rows), max_size=len(rows))), np.bool_)
    wanted = RequestedMoves(columns[:, :4], columns[:, 4], np.full(len(rows), 900.0), stop)
    inside = sorted(min(cut, len(rows)) for cut in cuts)

    assert in_pieces(wanted, limits, inside) == pytest.approx(at_once(wanted, limits), rel=1e-9)


def test_a_machine_that_rests_between_begins_anew() -> None:
    limits = MACHINES[0]
    delta, speed = print_like(200, seed=5)
    half = RequestedMoves(delta, speed, np.full(200, 900.0), np.zeros(200, np.bool_))
    watch = Stopwatch(limits)
    watch.add(half)
    once = watch.stop_and_sum()
    watch.add(half)

    assert once == pytest.approx(at_once(half, limits), rel=1e-12)
    assert watch.stop_and_sum() == pytest.approx(2 * once, rel=1e-12)


def test_what_is_certain_is_forgotten() -> None:
    """A vase without one stop: what waits stays small."""
    turn = np.linspace(0, 400 * np.pi, 100_000)
    points = np.column_stack([40 * np.cos(turn), 40 * np.sin(turn), turn / 100, turn * 2])
    delta = np.diff(points, axis=0)
    watch = Stopwatch(MACHINES[0])
    for at in range(0, len(delta), 1000):
        some = delta[at : at + 1000]
        n = len(some)
        watch.add(RequestedMoves(some, np.full(n, 60.0), np.full(n, 1000.0), np.zeros(n, np.bool_)))
        assert watch.n_waiting < 500
