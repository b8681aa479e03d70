"""The state of a machine, command by command."""

from __future__ import annotations

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st
from programs import LINES, Line, program_of

from printer_slicer.gcode.lexer import find_letters, parse
from printer_slicer.gcode.state import MachineState

START = [b"G28", b"G90", b"G1 X10 Y20 Z30 F6000"]


@given(lines=st.lists(LINES.filter(lambda line: not line.code.startswith("G53")), max_size=25))
def test_the_place_is_known_as_long_as_the_program_says_it(lines: list[Line]) -> None:
    state = MachineState()
    for command in [*START, *program_of(lines)]:
        state.follow(command)

    assert state.modal.known
    assert None not in state.offset


def test_inches_are_millimetres_at_once() -> None:
    state = MachineState()
    for command in (b"G20", b"G1 X1 Y1 Z0.1 F10", b"G21"):
        state.follow(command)

    assert state.position == pytest.approx((25.4, 25.4, 2.54))
    assert state.speed == pytest.approx(254 / 60)


@pytest.mark.parametrize(
    ("flavour", "x"), [("marlin", None), ("klipper", None), ("reprapfirmware", 15.0), ("smoothie", 15.0)]
)
def test_machine_coordinates_count_where_the_firmware_has_them(flavour: str, x: float | None) -> None:
    state = MachineState(flavour)
    for command in (b"G28", b"G1 X10 Y10 Z5", b"G92 X20", b"G53 G1 X5"):
        state.follow(command)

    assert state.position == (x, 10.0, 5.0)


@pytest.mark.parametrize("command", [b"G54", b"M428", b"G10 L2 P1 X5", b"G53"])
def test_another_origin_makes_place_and_offset_unknown_until_the_file_says_a_place(command: bytes) -> None:
    state = MachineState("reprapfirmware")
    for one in (b"G28", b"G1 X1 Y2 Z3", command):
        state.follow(one)

    assert state.position == state.offset == (None, None, None)


def test_frames_end_where_places_can_no_longer_be_compared() -> None:
    state = MachineState()
    frames = []
    for command in (b"G1 Z3", b"G92 Z0", b"G28 Z", b"G92 Z0", b"G92 Z1", b"G28 Z"):
        state.follow(command)
        frames.append(state.frames[2])

    changed = [after > before for before, after in pairwise(frames)]
    assert changed == [False, False, True, False, True]


def test_a_line_is_read_alike_in_either_case() -> None:
    assert (
        parse(b"g01x1.5 y-.5e+3") == parse(b"G01X1.5 Y-.5E+3") == (b"G1", {b"X": 1.5, b"Y": -0.5, b"E": 3.0})
    )
    assert parse(b"hello") == (b"", {})
    assert parse(b"G1 X99999999999 Y1") == (b"G1", {b"Y": 1.0})
    assert find_letters(b"g28 x y0") == {b"X", b"Y"}


@pytest.mark.parametrize("arc", [b"G2 X5 Y5", b"G3 X5 R0", b"G2 X10 Y20 R3"])
def test_an_arc_that_firmware_refuses_moves_nothing(arc: bytes) -> None:
    state = MachineState()
    for command in START:
        state.follow(command)

    move = state.follow(arc)

    assert move is not None
    assert not any(move.delta)
    assert state.position == (10.0, 20.0, 30.0)


def test_r_is_a_target_only_where_the_command_waits() -> None:
    state = MachineState()
    for command in (b"M104 R200", b"M140 R60"):
        state.follow(command)
    assert (state.hotend, state.bed) == (0.0, 0.0)

    for command in (b"M109 R200", b"M190 R60"):
        state.follow(command)
    assert (state.hotend, state.bed) == (200.0, 60.0)


@pytest.mark.parametrize(
    ("flavour", "hotends"), [("reprapfirmware", {1: 210.0, 2: 190.0}), ("marlin", {}), ("klipper", {})]
)
def test_tool_temperatures_are_those_of_reprapfirmware(flavour: str, hotends: dict[int, float]) -> None:
    state = MachineState(flavour)
    for command in (b"G10 P1 S210 R140", b"M568 P2 S190"):
        state.follow(command)

    assert state.hotends == hotends


def test_smoothieware_has_its_home_offset_when_it_homes() -> None:
    state = MachineState("smoothie")
    for command in (b"G28", b"G20", b"M206 X5", b"G21", b"G1 X1 Y1 Z1"):
        state.follow(command)
    assert state.offset == (0.0, 0.0, 0.0)

    state.follow(b"G28 X")
    assert state.offset == (5.0, 0.0, 0.0)
