"""One program, three interpreters: the state that the host keeps, the reader, and the simulated printer."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st
from programs import FRONT_ENDS, LINES, Line, program_of, simulated

from printer_slicer.gcode import FLAVOURS
from printer_slicer.gcode.lexer import letters, parse
from printer_slicer.gcode.reader import Reader
from printer_slicer.gcode.state import MachineState

START = [b"G28", b"G90", b"G1 X10 Y20 Z30 F6000"]


@pytest.mark.parametrize("flavour", FRONT_ENDS)
@given(lines=st.lists(LINES, max_size=25))
def test_state_reader_and_simulator_agree_on_any_program(flavour: str, lines: list[Line]) -> None:
    if flavour == "klipper":  # it refuses moves for the filament that they feed
        lines = [replace(line, words=tuple(word for word in line.words if word[0] != "E")) for line in lines]
    commands = [*START, *program_of(lines)]
    state = MachineState(flavour)
    for command in commands:
        state.follow(command)
    reader = Reader(dialect=FLAVOURS[flavour])
    reader.feed(commands)
    read, board = reader._state, simulated(commands, flavour)
    modal = state.modal

    for axis, (place, offset) in enumerate(zip(state.position, state.offset, strict=True)):
        logical = read.position[axis] + read.offset[axis]
        assert logical == pytest.approx(board.position[axis] + board.offset[axis], abs=1e-6)
        if place is not None:
            assert place == pytest.approx(logical, abs=1e-6)
        if place is not None and offset is not None:
            assert offset == pytest.approx(read.offset[axis], abs=1e-6)
            assert offset == pytest.approx(board.offset[axis], abs=1e-6)
    assert modal.e == pytest.approx(read.position[3], abs=1e-6) == pytest.approx(board.position[3], abs=1e-6)
    assert modal.unit == read.unit == board.unit
    assert (modal.relative, modal.relative_e) == (read.relative, read.relative_e)
    assert (modal.relative, modal.relative_e) == (board.relative, board.relative_e)
    assert modal.speed == pytest.approx(read.feed) == pytest.approx(board.feed)
    if flavour != "klipper":
        # Klipper has tools and G10 only where its owner has set them up.
        assert modal.retracted == read.retracted == board.retracted
        assert state.tool == read.tool == board.heaters.tool
        hotends = [heater.target for heater in board.heaters.hotends]
        assert [state.hotends.get(tool, 0.0) for tool in range(3)] == pytest.approx(hotends)
        assert state.bed == board.bed.target


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
    assert letters(b"g28 x y0") == {b"X", b"Y"}
