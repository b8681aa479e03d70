"""Pausing and leaving out things in programs that count in inches, from moved origins, in lower case."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from printed import HEAT
from programs import LARGE, LINES, Executor, Line, program_of
from rig import SETUP, Rig, assert_same_beads

from printer_slicer.printing import commands
from printer_slicer.printing.machine_state import PrintState
from printer_slicer.printing.objects import LiveJob, Span
from printer_slicer.printing.parking import (
    build_parking_script,
    build_return_script,
    make_parked_state,
    sum_extrusion,
)
from printer_slicer.printing.print_controller import PrintPhase
from printer_slicer.sim.firmware_state import FirmwareState
from printer_slicer.sim.firmwares import MARLIN_2_1
from printer_slicer.stream.events import Finished

START = [b"M104 S200", b"G28", b"G90", b"G1 X100 Y100 Z5 F6000"]


def state_of(state: FirmwareState) -> list[object]:
    """All that a program counts on: place, origin, units, modes, speed."""
    return [
        *(round(value, 3) for value in (*state.position, *state.offset, *state.home_offset, state.feed)),
        *(state.unit, state.relative, state.relative_e, state.positioning, state.retracted),
    ]


@pytest.mark.parametrize(
    "flavour", ["marlin", "marlin_legacy", "prusa", "reprapfirmware", "smoothie", "repetier"]
)
@given(lines=st.lists(LINES, max_size=20), cold=st.booleans())
def test_leaving_never_goes_down_and_coming_back_leads_to_the_same_place(
    flavour: str, lines: list[Line], cold: bool
) -> None:
    setup = replace(SETUP, flavour=flavour)
    executor, print_state = Executor(flavour), PrintState(flavour)
    for index, command in enumerate([*START, *program_of(lines)]):
        state = executor.do(command)
        print_state.follow(command, index)
    before, z = state_of(state), state.position[2]

    parked = make_parked_state(print_state.modal, print_state, setup, commands.Pause(cold=cold), 0)
    script = build_parking_script(parked, print_state, setup)
    for command in script:
        state = executor.do(command)
        assert state.position[2] >= z - 1e-6
    if parked.park and z < SETUP.top - 1e-3:
        assert state.position[2] > z
    for command in build_return_script(parked, setup, sum_extrusion(script)):
        state = executor.do(command)

    if print_state.modal.speed:  # a speed that no command has named cannot be said again
        assert state_of(state) == before


@pytest.mark.parametrize(
    "flavour", ["marlin", "marlin_legacy", "prusa", "reprapfirmware", "smoothie", "repetier"]
)
@given(
    lead=st.lists(LINES, max_size=8),
    lines=st.lists(LINES, min_size=1, max_size=15),
)
def test_behind_a_thing_that_is_left_out_all_is_as_if_it_had_been_printed(
    flavour: str, lead: list[Line], lines: list[Line]
) -> None:
    # Moves whose places are those that the last commands of the thing stand in for.
    inside = [*program_of([line for line in lines if not line.code.startswith("G53")]), *[b"G1 F600"] * 14]
    whole = [*START, *program_of([line for line in lead if not line.code.startswith("G53")]), *inside]
    job = LiveJob(whole, [Span("thing", len(whole) - len(inside), len(whole))], flavour=flavour)
    job.cancel_object("thing", 0)

    printed, skipped = Executor(flavour), Executor(flavour)
    for command in whole:
        expected = printed.do(command)
    laid = None
    for index in range(len(job)):
        command = job[index]
        at = skipped.printer.state.filament
        state = skipped.do(command) if command else skipped.printer.state
        if index >= len(whole) - len(inside) and state.filament > at + 1e-6:
            laid = command

    assert state_of(state) == state_of(expected)
    assert laid is None or b"X" not in laid


def rig_of(text: str) -> Rig:
    """A print on a machine that reads either case."""
    rig = Rig(text, replace(MARLIN_2_1, any_case=True), machine=LARGE)
    rig.connect()
    return rig


@pytest.mark.parametrize("now", [False, True], ids=["behind the plan", "now"])
def test_a_part_in_inches_is_the_same_after_a_pause(now: bool) -> None:
    places = [(2 + index % 5 * 0.7, 2 + index % 3 * 0.9) for index in range(60)]
    moves = "".join(f"g1 x{x:.3f} y{y:.3f} e0.04 f{40 + x}\n" for x, y in places)
    text = HEAT + "G28\nG90\nM83\nG20\ng1 x1 y1 z0.1 f100\n" + moves
    whole = rig_of(text)
    whole.run()
    rig, wished = rig_of(text), [0.0]
    parked: list[float] = []

    def turn(at: float) -> None:
        if rig.streamer.acknowledged >= 30 and not wished[0]:
            wished[0] = at
            rig.submit(commands.Pause(now=now))
        elif rig.controller.phase is PrintPhase.PAUSED and at > wished[0] + 10.0:
            assert rig.controller.parked is not None
            parked.append(rig.controller.parked.stand.place[2])
            rig.submit(commands.Resume())
            wished[0] = 1e9

    rig.run(turn)

    assert isinstance(rig.events[-1], Finished)
    assert parked[0] == pytest.approx(2.54)
    heights = [end[2] for _, end in rig.made]
    assert min(heights[heights.index(2.54) :]) >= 2.54 - 1e-6
    assert max(heights) >= 2.54 + 5.0
    if not now:
        assert_same_beads(rig.beads, whole.beads)
    assert rig.printer._state.filament == pytest.approx(whole.printer._state.filament, abs=0.02)


def test_what_is_said_between_inches_and_millimetres_does_not_reach_the_saved_place() -> None:
    print_state = PrintState()
    for command in (b"G28", b"G20", b"G1 X1 Y1 Z0.1", b"G21"):
        print_state.follow(command)

    parked = make_parked_state(print_state.modal, print_state, SETUP, commands.Pause(), 4)

    assert parked.stand.place == pytest.approx((25.4, 25.4, 2.54))
    assert parked.safe >= 2.54 + SETUP.lift
