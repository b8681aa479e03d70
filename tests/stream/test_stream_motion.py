"""Where the commands lead, and how long they may take."""

from __future__ import annotations

from math import hypot, inf, pi

import pytest
from conversation import LIMITS
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer.gcode.lexer import parse
from printer_slicer.gcode.state import MachineState, Move
from printer_slicer.motion.rules import MotionLimits
from printer_slicer.stream.ack_timer import ResponseTimeout


def follow(*commands: str) -> tuple[MachineState, list[Move | None]]:
    tracker = MachineState()
    return tracker, [tracker.follow(command.encode()) for command in commands]


def waits(*commands: str, limits: MotionLimits | None = LIMITS) -> list[float]:
    tracker, timeout = MachineState(), ResponseTimeout(limits)
    allowed = []
    for command in commands:
        word, values = parse(command.encode())
        allowed.append(timeout.estimate_timeout(word, values, tracker.apply(word, values)))
    return allowed


@pytest.mark.parametrize(
    ("commands", "position"),
    [
        ((), (None, None, None)),
        (("G1 X10 Y20.5 Z.3",), (10.0, 20.5, 0.3)),
        (("G01 X1", "G0Y2"), (1.0, 2.0, None)),
        (("G28", "G1 Z5"), (None, None, 5.0)),
        (("G1 X1 Y2 Z3", "G28"), (None, None, None)),
        (("G1 X1 Y2 Z3", "G91", "G1 X1 Z-1"), (2.0, 2.0, 2.0)),
        (("G91", "G1 X1"), (None, None, None)),
        (("G91", "G90", "G1 X1"), (1.0, None, None)),
        (("G92 X5 Y6", "M83", "G1 E1"), (5.0, 6.0, None)),
        (("G2 X10 Y0 I5 J0",), (10.0, 0.0, None)),
        (("G1 X1 Y2 Z3", "G20"), (1.0, 2.0, 3.0)),
        (("G1 X1 Y2 Z3", "hello", "M104 S200"), (1.0, 2.0, 3.0)),
    ],
)
def test_the_position_is_known_only_where_the_commands_say_it(
    commands: tuple[str, ...], position: tuple[float | None, ...]
) -> None:
    tracker, _ = follow(*commands)

    assert tracker.position == position


def test_moves_tell_their_travel_and_speed() -> None:
    _, moves = follow("G1 X10 F600", "M83", "G1 X13 Y4 E0.5", "M82", "G1 E2 F0", "G92 E0", "G1 E1")

    assert [move for move in moves if move] == [
        Move((10.0, 0.0, 0.0, 0.0), 10.0),
        Move((3.0, 4.0, 0.0, 0.5), 10.0),
        Move((0.0, 0.0, 0.0, 1.5), 10.0),
        Move((0.0, 0.0, 0.0, 1.0), 10.0),
    ]


def test_an_arc_counts_as_its_full_circle() -> None:
    _, moves = follow("G1 X0 Y0 F600", "G2 X10 Y0 I5 J0", "G3 X12 Y0 R-20 Z1 E1")

    assert moves[1:] == [
        Move((10 * pi, 0.0, 0.0, 0.0), 10.0),
        Move((40 * pi, 0.0, 1.0, 1.0), 10.0),
    ]


@pytest.mark.parametrize(("limits", "slack"), [(LIMITS, 0.85), (None, 30.0)])
def test_a_printer_may_be_silent_as_long_as_the_longest_planned_move(
    limits: MotionLimits | None, slack: float
) -> None:
    slow, *rest = waits("G1 X10 F6", *(f"G1 X{i} F6000" for i in range(70)), limits=limits)

    assert slow >= 2 * 100.0
    assert rest[0] == rest[62] == slow
    assert rest[-1] < slack + 10.0


@given(st.floats(0.1, 300.0), st.floats(1.0, 500.0))
def test_without_limits_the_wait_is_never_shorter_than_the_nominal_time(length: float, speed: float) -> None:
    (wait,) = waits(f"G1 X{length:.3f} F{60 * speed:.1f}", limits=None)

    assert wait >= 2 * length / speed


@given(st.floats(-200, 200), st.floats(-200, 200), st.floats(1.0, 500.0))
def test_with_limits_the_wait_covers_the_move_from_rest_to_rest(x: float, y: float, speed: float) -> None:
    (wait,) = waits(f"G1 X{x:.3f} Y{y:.3f} F{60 * speed:.1f}")

    length = hypot(round(x, 3), round(y, 3))
    assert wait >= length / speed


def test_z_is_held_back_by_its_limits() -> None:
    assert waits("G1 Z100 F6000")[0] >= 2 * 20.0
    assert waits("G1 Z100 F6000", limits=None)[0] >= 2 * 20.0


def test_a_move_to_where_it_is_takes_no_time() -> None:
    assert waits("G1 X0 F600") == [0.85]


def test_a_slowed_down_print_gets_longer() -> None:
    usual, _, _, slowed = waits("G1 X10 F60", "M220", "M220 S10", "G1 X20 F60")

    assert slowed - 0.85 == pytest.approx(10 * (usual - 0.85))


def test_commands_that_take_their_own_time_get_it() -> None:
    home, heat, dwell, short_dwell, user = waits("G28", "M109 S200", "G4 S90", "G4 P500", "M0")

    assert home > 300
    assert heat > 900
    assert dwell == 90.85
    assert short_dwell == 1.35
    assert user == inf


def test_what_waits_for_the_motion_waits_for_all_of_it_and_what_only_reads_for_none() -> None:
    allowed = waits("G1 X10 F60", "G1 X20", "M105", "M115", "M400", "M106 S255")

    assert allowed[2:4] == [3.0, 3.0]
    assert allowed[4] > 20.0 + 0.85
    assert allowed[5] == 0.85
