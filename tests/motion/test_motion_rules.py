"""Limits, corners, ramps and the planner queue, move by move."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from math import cos, hypot, pi, radians, sin, sqrt

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from printer_slicer.motion.rules import (
    Block,
    Lookahead,
    MotionLimits,
    compute_block_times,
    compute_corner_speed,
    compute_ramp_time,
    make_block,
)

MARLIN = MotionLimits(
    max_speed=(300.0, 300.0, 12.0, 50.0),
    max_acceleration=(3000.0, 3000.0, 100.0, 5000.0),
    acceleration=1000.0,
    travel_acceleration=1500.0,
    retract_acceleration=2000.0,
    corner="junction_deviation",
    junction_deviation=0.02,
    jerk=(10.0, 8.0, 0.4, 5.0),
    square_corner_velocity=5.0,
)
JERK = replace(MARLIN, corner="jerk")
KLIPPER = replace(MARLIN, corner="square_corner", jerk=(0.0, 0.0, 0.0, 1.0))
FIRMWARES = (MARLIN, JERK, KLIPPER)
ENDLESS = 10**9


def block(limits: MotionLimits, *delta: float, speed: float = 100.0) -> Block:
    made = make_block(limits, (*delta, *[0.0] * (4 - len(delta))), speed)  # type: ignore[arg-type]
    assert made is not None
    return made


def turn(limits: MotionLimits, degrees: float, length: float = 50.0) -> float:
    before = block(limits, length)
    after = block(limits, length * cos(radians(degrees)), length * sin(radians(degrees)))
    return compute_corner_speed(limits, before, after)


def run(blocks: list[Block], limits: MotionLimits) -> list[float]:
    """Seconds of each block through a queue that is kept full."""
    lookahead, seconds = Lookahead(limits), []
    for item in blocks:
        if lookahead.is_full:
            seconds.append(lookahead.pop())
        lookahead.push(item)
    return seconds + [lookahead.pop() for _ in range(len(lookahead))]


sizes = st.one_of(st.just(0.0), st.floats(-40, 40), st.floats(-0.3, 0.3))
moves = st.tuples(sizes, sizes, st.one_of(st.just(0.0), st.floats(-0.4, 0.4)), st.floats(-1, 1))
limits_of = st.builds(
    replace,
    st.sampled_from(FIRMWARES),
    acceleration=st.floats(200, 8000),
    junction_deviation=st.floats(0.005, 0.2),
    square_corner_velocity=st.floats(1, 20),
    planner_blocks=st.integers(1, 20),
)


@st.composite
def paths(draw: st.DrawFn) -> tuple[MotionLimits, list[Block]]:
    limits = draw(limits_of)
    wanted = draw(st.lists(st.tuples(moves, st.floats(1, 300)), min_size=1, max_size=40))
    made = [make_block(limits, delta, speed) for delta, speed in wanted]
    return limits, [item for item in made if item is not None]


# One block


def test_a_move_that_goes_nowhere_is_no_block() -> None:
    assert make_block(MARLIN, (0.0, 0.0, 0.0, 0.0), 50.0) is None
    assert make_block(MARLIN, (1e-9, 0.0, 0.0, -1e-9), 50.0) is None


def test_length_counts_x_y_z_and_the_extruder_only_where_it_is_alone() -> None:
    assert block(MARLIN, 3.0, 4.0, 0.0, 9.0).length == 5.0
    assert block(MARLIN, 0.0, 0.0, 0.0, -0.8).length == 0.8
    assert block(MARLIN, 0.0, 0.0, 0.0, -0.8).unit == (0.0, 0.0, 0.0, -1.0)


def test_each_kind_of_move_has_its_own_acceleration() -> None:
    assert block(MARLIN, 10.0, 0.0, 0.0, 0.4).acceleration == 1000.0
    assert block(MARLIN, 10.0).acceleration == 1500.0
    assert block(MARLIN, 0.0, 0.0, 0.0, -1.0).acceleration == 2000.0


def test_the_slowest_axis_slows_the_whole_move_in_proportion() -> None:
    lifting = block(MARLIN, 3.0, 0.0, 4.0, speed=100.0)

    assert lifting.speed == pytest.approx(12.0 / 0.8)
    assert lifting.acceleration == pytest.approx(100.0 / 0.8)
    assert lifting.share == pytest.approx(100.0 / 0.8 / 1500.0)


def test_a_feed_rate_of_zero_still_arrives() -> None:
    assert 0.0 < block(MARLIN, 10.0, speed=0.0).speed < 1.0


@given(limits_of, moves, st.floats(0.01, 500))
def test_no_axis_is_ever_above_its_limits(
    limits: MotionLimits, delta: tuple[float, ...], speed: float
) -> None:
    made = make_block(limits, delta, speed)  # type: ignore[arg-type]
    if made is None:
        return

    for part, top_speed, top_acceleration in zip(
        made.unit, limits.max_speed, limits.max_acceleration, strict=True
    ):
        assert abs(part) * made.speed <= top_speed * (1 + 1e-12)
        assert abs(part) * made.acceleration <= top_acceleration * (1 + 1e-12)


# Corners


@pytest.mark.parametrize("limits", FIRMWARES)
def test_straight_on_needs_no_slowing_down(limits: MotionLimits) -> None:
    assert turn(limits, 0.0) == 100.0


@pytest.mark.parametrize("limits", FIRMWARES)
def test_the_slower_of_two_moves_bounds_the_corner(limits: MotionLimits) -> None:
    fast, slow = block(limits, 50.0, speed=200.0), block(limits, 50.0, speed=3.0)

    assert compute_corner_speed(limits, fast, slow) == pytest.approx(3.0)
    assert compute_corner_speed(limits, slow, fast) == pytest.approx(3.0)


def test_square_corner_velocity_is_the_speed_of_a_square_corner() -> None:
    assert turn(KLIPPER, 90.0) == pytest.approx(5.0, rel=1e-12)
    assert turn(replace(KLIPPER, travel_acceleration=300.0), 90.0) == pytest.approx(5.0, rel=1e-12)


def test_junction_deviation_at_90_and_at_60_degrees() -> None:
    # v² = a·δ·sin(θ/2)/(1 - sin(θ/2)): θ = 90° for a square turn, 120° for a turn of 60°.
    assert turn(MARLIN, 90.0) ** 2 == pytest.approx(1500 * 0.02 * (sqrt(0.5) / (1 - sqrt(0.5))))
    assert turn(MARLIN, 60.0) ** 2 == pytest.approx(1500 * 0.02 * (sqrt(0.75) / (1 - sqrt(0.75))))


def test_junction_deviation_stays_within_the_acceleration_of_every_axis() -> None:
    weak_y = replace(MARLIN, max_acceleration=(3000.0, 200.0, 100.0, 5000.0))

    # The bisector of this corner points along y, so only y has to turn the head.
    before, after = block(weak_y, 50.0, 1e-3), block(weak_y, 50.0, -50.0)
    slower = compute_corner_speed(weak_y, before, after)

    assert slower < compute_corner_speed(MARLIN, block(MARLIN, 50.0, 1e-3), block(MARLIN, 50.0, -50.0))


@pytest.mark.parametrize("limits", [MARLIN, KLIPPER])
def test_turning_back_means_stopping(limits: MotionLimits) -> None:
    assert turn(limits, 180.0) == pytest.approx(0.0, abs=1e-6)


def test_a_circle_of_short_pieces_is_run_at_the_centripetal_limit() -> None:
    radius, n_pieces = 10.0, 400
    points = [(radius * cos(2 * pi * i / n_pieces), radius * sin(2 * pi * i / n_pieces)) for i in range(3)]
    pieces = [block(MARLIN, bx - ax, by - ay, speed=300.0) for (ax, ay), (bx, by) in pairwise(points)]

    assert compute_corner_speed(MARLIN, *pieces) ** 2 == pytest.approx(1500.0 * radius, rel=1e-3)


def test_jerk_bounds_the_jump_of_each_axis() -> None:
    # Square turn at v: x falls from v to 0 (limit 10), y rises from 0 to v (limit 8).
    assert turn(JERK, 90.0) == pytest.approx(8.0)
    # Turning back: x stops from v and starts to v; the larger jump counts, not the sum.
    assert turn(JERK, 180.0) == pytest.approx(10.0)


def test_jerk_of_the_extruder_bounds_a_change_of_flow() -> None:
    thin, thick = block(JERK, 50.0, 0.0, 0.0, 1.0), block(JERK, 50.0, 0.0, 0.0, 11.0)

    assert compute_corner_speed(JERK, thin, thick) == pytest.approx(5.0 / 0.2)


def test_a_change_of_flow_slows_klipper_only_when_a_limit_is_given() -> None:
    thin, thick = block(KLIPPER, 50.0, 0.0, 0.0, 1.0), block(KLIPPER, 50.0, 0.0, 0.0, 6.0)

    assert compute_corner_speed(KLIPPER, thin, thick) == pytest.approx(1.0 / 0.1)
    assert compute_corner_speed(replace(KLIPPER, jerk=(0.0,) * 4), thin, thick) == 100.0


def test_klipper_stops_around_moves_of_the_extruder_alone_and_marlin_does_not() -> None:
    for limits, stops in ((KLIPPER, True), (MARLIN, False), (JERK, False)):
        retract, travel = block(limits, 0.0, 0.0, 0.0, -1.0, speed=40.0), block(limits, 50.0)

        assert (compute_corner_speed(limits, retract, travel) == 0.0) is stops
        assert (compute_corner_speed(limits, travel, retract) == 0.0) is stops


def test_klipper_leaves_room_for_the_arc_on_short_moves() -> None:
    length = 0.1

    # Turn of 20°: radius at most tan(80°)·d/2.
    assert (
        turn(KLIPPER, 20.0, length) ** 2 <= 1500.0 * sin(radians(80)) / cos(radians(80)) * length / 2 + 1e-9
    )
    assert turn(KLIPPER, 20.0, length) < turn(KLIPPER, 20.0, 50.0)


@given(st.sampled_from(FIRMWARES), st.floats(1, 178), st.floats(0.01, 80))
def test_a_sharper_corner_is_never_faster(limits: MotionLimits, degrees: float, length: float) -> None:
    if limits.corner != "jerk":  # jerk per axis depends on the direction, not only on the angle
        assert turn(limits, degrees + 1, length) <= turn(limits, degrees, length) * (1 + 1e-9)
    assert turn(limits, degrees, length) <= 100.0


# Ramps


def test_a_long_move_is_a_trapezoid() -> None:
    # 0.1 s and 5 mm for each ramp, 90 mm of cruise.
    assert compute_ramp_time(100.0, 0.0, 100.0, 0.0, 1000.0) == pytest.approx(0.1 + 0.9 + 0.1)


def test_a_short_move_is_a_triangle() -> None:
    assert compute_ramp_time(1.0, 0.0, 100.0, 0.0, 1000.0) == pytest.approx(2 * sqrt(1.0 / 1000.0))


def test_a_move_between_its_own_speeds_never_ramps() -> None:
    assert compute_ramp_time(30.0, 60.0, 60.0, 60.0, 500.0) == pytest.approx(0.5)


@given(
    st.floats(1e-4, 200),
    st.floats(0, 1),
    st.floats(0, 1),
    st.floats(1, 300),
    st.floats(50, 20000),
    st.floats(0, 1),
)
def test_cutting_a_ramp_anywhere_leaves_its_time(
    length: float, low: float, high: float, cruise: float, acceleration: float, at: float
) -> None:
    entry = low * cruise
    exit_ = min(high * cruise, sqrt(entry * entry + 2 * acceleration * length))
    exit_ = max(exit_, sqrt(max(0.0, entry * entry - 2 * acceleration * length)))
    cut = at * length
    middle = min(
        cruise, sqrt(entry**2 + 2 * acceleration * cut), sqrt(exit_**2 + 2 * acceleration * (length - cut))
    )

    whole = compute_ramp_time(length, entry, cruise, exit_, acceleration)
    parts = [(cut, entry, middle), (length - cut, middle, exit_)]
    total = sum(compute_ramp_time(d, a, cruise, b, acceleration) for d, a, b in parts if d > 0)
    assert total == pytest.approx(whole, rel=1e-6, abs=1e-9)


# The planner


def test_an_empty_queue_takes_no_time() -> None:
    lookahead = Lookahead(MARLIN)

    assert len(lookahead) == 0
    assert lookahead.pop() == 0.0
    assert lookahead.exit_speed == 0.0
    assert compute_block_times([], MARLIN) == []


def test_a_queue_is_full_at_the_planners_size() -> None:
    lookahead = Lookahead(replace(MARLIN, planner_blocks=2))
    lookahead.push(block(MARLIN, 1.0))
    assert not lookahead.is_full

    lookahead.push(block(MARLIN, 1.0))

    assert lookahead.is_full
    assert len(lookahead) == 2


def test_the_last_block_in_the_queue_ends_at_rest() -> None:
    lookahead = Lookahead(MARLIN)
    lookahead.push(block(MARLIN, 20.0))

    assert lookahead.pop() == pytest.approx(compute_ramp_time(20.0, 0.0, 100.0, 0.0, 1500.0))
    assert lookahead.exit_speed == 0.0


def test_a_starved_planner_stops_at_every_corner() -> None:
    starved, lookahead = [], Lookahead(MARLIN)
    for _ in range(10):
        lookahead.push(block(MARLIN, 5.0))
        starved.append(lookahead.pop())

    assert starved == pytest.approx([compute_ramp_time(5.0, 0.0, 100.0, 0.0, 1500.0)] * 10)


def test_after_a_stop_the_next_block_starts_at_rest() -> None:
    lookahead = Lookahead(MARLIN)
    lookahead.push(block(MARLIN, 20.0))
    lookahead.stop()
    lookahead.push(block(MARLIN, 20.0))

    first, second = lookahead.pop(), lookahead.pop()

    assert first == pytest.approx(compute_ramp_time(20.0, 0.0, 100.0, 0.0, 1500.0))
    assert second == pytest.approx(first)


def test_limits_given_later_hold_for_the_corners_that_follow() -> None:
    lookahead = Lookahead(MARLIN)
    lookahead.push(block(MARLIN, 20.0))
    lookahead.limits = replace(MARLIN, junction_deviation=0.0)
    lookahead.push(block(MARLIN, 0.0, 20.0))
    lookahead.pop()

    assert lookahead.exit_speed == 0.0


@given(paths())
@settings(deadline=None)
def test_every_speed_is_within_reach_and_within_the_corner(path: tuple[MotionLimits, list[Block]]) -> None:
    limits, blocks = path
    lookahead, entry = Lookahead(limits), 0.0
    for item in blocks:
        lookahead.push(item)
    corners = [compute_corner_speed(limits, a, b) for a, b in pairwise(blocks)] + [0.0] * bool(blocks)

    for item, corner in zip(blocks, corners, strict=True):
        seconds = lookahead.pop()

        exit_ = lookahead.exit_speed
        assert exit_ <= min(corner, item.speed) * (1 + 1e-9)
        assert abs(exit_**2 - entry**2) <= 2 * item.acceleration * item.length * (1 + 1e-9) + 1e-9
        assert seconds >= item.length / item.speed * (1 - 1e-9)
        entry = exit_
    assert entry == 0.0


@given(paths(), st.sampled_from([0.0, 0.5, 0.9]))
@settings(deadline=None)
def test_a_queue_without_end_is_the_plan(path: tuple[MotionLimits, list[Block]], ratio: float) -> None:
    blocks = path[1]
    limits = replace(path[0], planner_blocks=ENDLESS, minimum_cruise_ratio=ratio)

    assert run(blocks, limits) == pytest.approx(compute_block_times(blocks, limits), rel=1e-9, abs=0)


@given(paths(), st.integers(1, 10))
@settings(deadline=None)
def test_looking_further_ahead_is_never_slower(path: tuple[MotionLimits, list[Block]], more: int) -> None:
    limits, blocks = path
    further = replace(limits, planner_blocks=limits.planner_blocks + more)

    short, long, endless = (
        sum(run(blocks, limits)),
        sum(run(blocks, further)),
        sum(compute_block_times(blocks, limits)),
    )
    assert endless * (1 - 1e-12) <= long <= short * (1 + 1e-12)


def test_a_short_queue_is_slow_on_short_moves() -> None:
    few, many = replace(MARLIN, planner_blocks=4), replace(MARLIN, planner_blocks=ENDLESS)
    pieces = [block(MARLIN, 0.1, speed=200.0)] * 2000

    assert sum(run(pieces, few)) > 2 * sum(run(pieces, many))


# Minimum cruise ratio


@pytest.mark.parametrize("ratio", [0.2, 0.5, 0.8])
def test_the_minimum_cruise_ratio_is_the_share_of_the_way_at_cruise_speed(ratio: float) -> None:
    limits = replace(KLIPPER, minimum_cruise_ratio=ratio)
    length, acceleration = 2.0, 1500.0

    # Two ramps share what is not cruise: v²/2a each.
    top = sqrt(acceleration * length * (1 - ratio))
    expected = 2 * top / acceleration + ratio * length / top
    assert compute_block_times([block(limits, length)], limits) == pytest.approx([expected])


def test_moves_that_reach_their_speed_do_not_feel_the_minimum_cruise_ratio() -> None:
    blocks = [block(KLIPPER, 80.0), block(KLIPPER, 0.0, 80.0)]

    assert compute_block_times(blocks, replace(KLIPPER, minimum_cruise_ratio=0.5)) == pytest.approx(
        compute_block_times(blocks, KLIPPER)
    )


@given(
    st.sampled_from(FIRMWARES),
    st.sampled_from([0.0, 0.5]),
    st.lists(st.floats(0.01, 10), min_size=1, max_size=20),
)
def test_a_line_cut_into_pieces_takes_as_long_as_the_line(
    firmware: MotionLimits, ratio: float, pieces: list[float]
) -> None:
    limits = replace(firmware, minimum_cruise_ratio=ratio)
    whole = compute_block_times([block(limits, 3 * sum(pieces), 4 * sum(pieces))], limits)

    cut = compute_block_times([block(limits, 3 * piece, 4 * piece) for piece in pieces], limits)

    assert sum(cut) == pytest.approx(sum(whole), rel=1e-6)


def test_a_zigzag_is_smoothed_corner_by_corner() -> None:
    zigzag = [block(KLIPPER, 1.0, sign * 1.0) for sign in [1.0, -1.0] * 20]
    smoothed = replace(KLIPPER, minimum_cruise_ratio=0.5)
    corner = compute_corner_speed(KLIPPER, *zigzag[:2])

    inner = compute_block_times(zigzag, smoothed)[20]

    length, acceleration = hypot(1, 1), 1500.0
    top = sqrt(corner**2 + 0.5 * acceleration * length)
    assert inner == pytest.approx(compute_ramp_time(length, corner, top, corner, acceleration))
    assert inner > compute_block_times(zigzag, KLIPPER)[20]
