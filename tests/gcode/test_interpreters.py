"""One program, all interpreters: after each command they agree on place, origin, units, modes, tool and temperatures.

The machine's state (the model of all host code), the resend tracker and the tracker of a print (which follow it), the
reader of moves (line by line, and many lines at once), the lint, and the simulated printer, which is the judge.
"""

from __future__ import annotations

from dataclasses import replace

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from programs import LINES, MORE_LINES, SIMULATED_FIRMWARES, Executor, Line, program_of

from printer_slicer.firmware import FLAVOURS, WIRE_DIALECTS, get_flavour
from printer_slicer.gcode import read_moves
from printer_slicer.gcode.lexer import is_macro, parse, read_commands
from printer_slicer.gcode.move_actions import ReaderState
from printer_slicer.gcode.reader import MoveReader
from printer_slicer.gcode.state import MachineState, find_heater_target
from printer_slicer.inspection.lint.scan import scan
from printer_slicer.printing.objects import LiveJob
from printer_slicer.profile import load_profile
from printer_slicer.sim.firmware_state import FirmwareState
from printer_slicer.stream.send_queue import SendQueue
from tests.effort import examples

START = [b"G28", b"G90", b"G1 X10 Y20 Z30 F6000", b"G92 E0"]
DIALECT = {get_flavour(dialect): dialect for dialect in WIRE_DIALECTS.values()}
CEILING = {"nozzle": 80.0, "bed": 60.0}
_USUAL = load_profile()
PROFILE = msgspec.structs.replace(
    _USUAL,
    printer=msgspec.structs.replace(_USUAL.printer, max_nozzle_temperature=80.0, max_bed_temperature=60.0),
)
TOOLS = range(3)


def programs(flavour: str) -> st.SearchStrategy[list[Line]]:
    lines = st.lists(st.one_of(LINES, MORE_LINES), min_size=15, max_size=30)
    if flavour != "klipper":
        return lines
    # It refuses moves for the filament that they feed, and has tools and arcs only where its owner has set them up.
    return lines.map(
        lambda some: [
            replace(line, words=tuple(word for word in line.words if word[0] != "E"))
            for line in some
            if "T" not in line.code and line.code not in {"G2", "G3", "G02"}
        ]
    )


def assert_state_is_that_of(
    state: MachineState, read: ReaderState, board: FirmwareState, flavour: str
) -> None:
    """All that a command may change, in three models."""
    for axis, (place, offset) in enumerate(zip(state.position, state.offset, strict=True)):
        logical = read.position[axis] + read.offset[axis]
        assert logical == pytest.approx(board.position[axis] + board.offset[axis], abs=1e-6)
        if place is not None:
            assert place == pytest.approx(logical, abs=1e-6)
        if place is not None and offset is not None:
            assert offset == pytest.approx(read.offset[axis], abs=1e-6)
            assert offset == pytest.approx(board.offset[axis], abs=1e-6)
    modal = state.modal
    assert read.position[3] == pytest.approx(board.position[3], abs=1e-6)
    if state.place[3] is not None:
        assert modal.e == pytest.approx(read.position[3], abs=1e-6)
    assert modal.unit == read.unit == board.unit
    assert (modal.relative, modal.relative_e) == (read.relative, read.relative_e)
    assert (modal.relative, modal.relative_e) == (board.relative, board.relative_e)
    if modal.speed:
        assert modal.speed == pytest.approx(read.feed) == pytest.approx(board.feed)
    if flavour != "klipper":
        assert modal.retracted == read.retracted == board.retracted
    assert state.tool == read.tool == board.heaters.tool
    targets = [heater.target for heater in board.heaters.hotends]
    assert [state.hotends.get(tool, 0.0) for tool in TOOLS] == pytest.approx(targets)
    assert state.bed == board.bed.target


def assert_hosts_follow(state: MachineState, script: SendQueue, job: LiveJob) -> None:
    """What resends, pauses and left-out objects rest on."""
    print_state = job.print_state
    assert print_state.modal == state.modal
    assert print_state.machine.offset == state.offset
    assert (print_state.machine.hotends, print_state.machine.bed, print_state.machine.fan) == (
        state.hotends,
        state.bed,
        state.fan,
    )
    assert script._expected_position == ((None,) * 4 if state.inches else state.place)


def assert_lint_reads(command: bytes) -> None:
    """The same code and numbers, where nothing can be read in two ways."""
    word, values = parse(command)
    first, *further = read_commands(command)
    assert first.code.encode() == word
    if not further:
        assert {letter.encode(): some[-1] for letter, some in first.words.items() if some} == values


@pytest.mark.parametrize("flavour", SIMULATED_FIRMWARES)
@settings(max_examples=examples(4, 100))  # long ones: what a command does shows only in what comes behind it
@given(data=st.data())
def test_all_interpreters_agree_on_any_program(flavour: str, data: st.DataObject) -> None:
    commands = [*START, *program_of(data.draw(programs(flavour)))]
    executor, state, reader = Executor(flavour), MachineState(flavour), MoveReader(dialect=FLAVOURS[flavour])
    job, script = LiveJob(commands, flavour=flavour), SendQueue([], None)
    script.set_dialect(DIALECT[flavour])
    too_hot, names_heat = set(), set()
    for index, command in enumerate(commands, 1):
        board = executor.do(command)
        state.follow(command)
        reader.feed([command])
        job.follow(index)
        script.track_command(command)

        assert_state_is_that_of(state, reader._state, board, flavour)
        assert_hosts_follow(state, script, job)
        assert_lint_reads(command)
        assert not is_macro(command)
        target = find_heater_target(*parse(command))
        if target is not None and target.celsius > CEILING[target.heater]:
            too_hot.add(command.decode().upper())
        if {b"S", b"R"} & parse(command)[1].keys():
            names_heat.add(command.decode().upper())

    moves, again = reader.take_moves(), read_moves(commands, dialect=FLAVOURS[flavour])
    for name in ("end", "delta", "speed", "line", "tool", "stop"):
        np.testing.assert_array_equal(getattr(again, name), getattr(moves, name))
    told = scan([command.upper() for command in commands], PROFILE)
    refused = {one.command for one in told if one.code == "temperature"}
    assert too_hot <= refused <= names_heat  # of S and R, the lint takes what is worse
