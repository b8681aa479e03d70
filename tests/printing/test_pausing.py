"""Pausing and going on: the part comes out as if nobody had ever paused."""

from __future__ import annotations

from dataclasses import replace
from random import Random  # noqa: TID251 - seeded
from typing import Any

import pytest
from printed import HEAT, scribble, tower
from rig import SETUP, Rig, assert_same_beads, off_path, way

from printer_slicer.printing import commands
from printer_slicer.printing.print_controller import PrintPhase
from printer_slicer.sim.firmwares import (
    KLIPPER,
    MARLIN_1_1,
    MARLIN_2_1,
    PRUSA_MK3,
    REPETIER,
    REPRAPFIRMWARE,
    SMOOTHIE,
    SimulatedFirmware,
)
from printer_slicer.stream.events import Finished, Paused, Resumed
from printer_slicer.stream.states import State
from tests.effort import crossed


def printed(text: str) -> Rig:
    """A print that nobody disturbs."""
    rig = Rig(text)
    rig.connect()
    rig.run()
    return rig


def paused_at(text: str, entries: list[int], pause: commands.Pause, **given: Any) -> Rig:
    """A print that is paused when so many commands were accepted, and goes on 3 s after it is parked."""
    rig = Rig(text, **given)
    rig.connect()
    left, since = list(entries), [0.0]

    def turn(now: float) -> None:
        phase = rig.controller.phase
        if phase is PrintPhase.RUNNING and left and rig.streamer.acknowledged >= left[0]:
            left.pop(0)
            rig.submit(pause)
            since[0] = now
        elif phase is PrintPhase.PAUSED and now > since[0] + 3.0:
            rig.submit(commands.Resume())
            since[0] = now + 1e9

    rig.run(turn)
    assert not left
    return rig


@pytest.mark.parametrize(
    ("run", "now", "relative"), crossed([(0, 10), (1, 10), (2, 50)], [False, True], [True, False], laps=2)
)
def test_the_part_is_the_same_after_all_pauses(run: tuple[int, int], now: bool, relative: bool) -> None:
    seed, pauses = run
    text = scribble(seed, 200, relative=relative)
    whole = printed(text)
    chance = Random(seed)
    entries = sorted(chance.sample(range(12, 230), pauses))

    rig = paused_at(text, entries, commands.Pause(now=now))

    assert isinstance(rig.events[-1], Finished)
    assert rig.events[-1].verified
    assert sum(isinstance(event, Paused) for event in rig.events) == pauses
    assert sum(isinstance(event, Resumed) for event in rig.events) == pauses
    if now:
        # M114 tells two decimals, so each stop may be off by half of the last one; of fifty, two fall into one move.
        assert off_path(rig.beads, whole.beads) < (0.0075 if pauses < 50 else 0.015)
        # Where the way comes back to the same hundredth, a loop of some hundredths is left out.
        assert off_path(whole.beads, rig.beads) < 0.1
        assert way(rig.beads) == pytest.approx(way(whole.beads), abs=0.03 * pauses)
    else:
        assert_same_beads(rig.beads, whole.beads)
    assert rig.printer._state.filament == pytest.approx(
        whole.printer._state.filament, abs=0.011 * pauses if now else 1e-3
    )


def test_a_parked_nozzle_is_off_the_part_and_above_it() -> None:
    rig = paused_at(tower(8), [150], commands.Pause())
    parked = [end for _, end in rig.made if end[1] > 200]

    assert parked
    assert all(z >= 0.2 * 5 + 5 for _, _, z, _ in parked)


def test_now_is_sooner_than_behind_the_plan() -> None:
    text = "G28\nG90\nM83\nG1 Z1\n" + "".join(f"G1 X{10 + 80 * (i % 2)} Y{i} F1200\n" for i in range(100))

    def seconds(now: bool) -> float:
        rig = Rig(text)
        rig.connect()
        requested, waiting = [0.0], [0.0]

        def turn(at: float) -> None:
            if rig.streamer.acknowledged >= 30 and not requested[0]:
                requested[0] = at
                rig.submit(commands.Pause(now=now, park=False))
            if rig.controller.phase is PrintPhase.PAUSED:
                waiting[0] = waiting[0] or at
                board = rig.printer._state
                board.motion_queue.advance(at)
                if not board.motion_queue.is_busy:
                    rig.submit(commands.Abort())

        rig.run(turn)
        return rig.port.now() - requested[0]

    assert seconds(now=True) < 12.0 < 40.0 < seconds(now=False)


def test_a_cold_pause_heats_up_again_before_it_goes_back() -> None:
    rig = paused_at(tower(6), [120], commands.Pause(cold=True))
    lines = rig.of_job()
    cold = lines.index("M104 S0")
    hot = lines.index("M109 S200", cold)

    assert cold < hot
    assert not any(line.startswith("G1 X115") for line in lines[cold:hot])
    assert_same_beads(rig.beads, printed(tower(6)).beads)


def test_a_nozzle_temperature_set_in_a_cold_pause_holds_when_the_print_goes_on() -> None:
    rig = Rig(tower(6))
    rig.connect()
    requested = [False]

    def turn(_now: float) -> None:
        phase = rig.controller.phase
        if phase is PrintPhase.RUNNING and not requested[0] and rig.streamer.acknowledged >= 120:
            rig.submit(commands.Pause(cold=True))
        elif phase is PrintPhase.PAUSED and not requested[0]:
            requested[0] = True
            rig.submit(commands.SetTemperature("nozzle", 190.0))
            rig.submit(commands.Resume())

    rig.run(turn)
    lines = rig.of_job()
    behind = lines[lines.index("M104 S0") :]
    assert "M109 S190" in behind
    assert "M109 S200" not in behind


def test_a_pause_here_moves_nothing() -> None:
    text = tower(5)
    rig = paused_at(text, [100], commands.Pause(park=False))

    assert [line for line in rig.of_job() if line.startswith("G1 X")] == [
        line for line in printed(text).of_job() if line.startswith("G1 X")
    ]


def test_a_cold_machine_does_not_pull_filament() -> None:
    text = "G28\nG90\nM83\n" + "".join(f"G1 X{10 + i % 50} F3000\n" for i in range(300))
    rig = paused_at(text, [100], commands.Pause())

    assert not any("E" in line for line in rig.of_job() if line.startswith("G1"))
    assert rig.printer.report().n_violations == 0


MODES = """G28
G90
M83
G91
G1 Z5 F600
G90
G1 X100 Y100 Z0.2 F3000
"""


@pytest.mark.parametrize(
    ("firmware", "flavour", "counts"),
    [
        (MARLIN_2_1, "marlin", False),
        (MARLIN_1_1, "marlin_legacy", True),
        (PRUSA_MK3, "prusa", True),
        (KLIPPER, "klipper", True),
        (REPRAPFIRMWARE, "reprapfirmware", True),
        (REPETIER, "repetier", True),
        (SMOOTHIE, "smoothie", False),
    ],
    ids=lambda one: one if isinstance(one, str) else "",
)
def test_what_g90_does_to_relative_extrusion_is_the_firmwares_business(
    firmware: SimulatedFirmware, flavour: str, counts: bool
) -> None:
    """A lift under G91 is in many macros; whether E counts from where it is afterwards, firmwares see differently."""
    moves = [f"G1 X{100 + i % 7} Y{100 + i % 5} E0.05" for i in range(1, 121)]
    text = HEAT + MODES + "\n".join(moves) + "\n"
    setup = replace(SETUP, flavour=flavour)
    whole = Rig(text, firmware, setup)
    whole.connect()
    whole.run()
    rig = paused_at(text, [60], commands.Pause(), firmware=firmware, setup=setup)

    laid = 120 * 0.05 if counts else 0.05
    assert whole.printer._state.filament == pytest.approx(laid, abs=1e-6)
    assert isinstance(rig.events[-1], Finished)
    assert rig.printer._state.filament == pytest.approx(laid, abs=1e-3)
    assert_same_beads(rig.beads, whole.beads)


def test_the_way_to_the_parking_place_is_within_the_bed_wherever_the_program_counts_from() -> None:
    text = HEAT + "G28\nG90\nM83\nG1 X110 Y110 Z0.2 F3000\nG92 X0 Y0\n"
    text += "".join(f"G1 X{i % 9} Y{i % 7} E0.05\n" for i in range(120))
    rig = paused_at(text, [60], commands.Pause())
    reached = [end for _, end in rig.made]

    assert isinstance(rig.events[-1], Finished)
    assert all(0 <= x <= 220 and 0 <= y <= 220 for x, y, *_ in reached)
    assert any(min(x, 220 - x) == min(y, 220 - y) == pytest.approx(5) for x, y, *_ in reached)  # a corner


def test_a_pause_of_the_printer_s_own_ends_when_a_person_resumes() -> None:
    rig = Rig(tower(4))
    rig.connect()
    begun: list[int] = []

    def meddle(_: object) -> None:
        if rig.streamer.acknowledged >= 30 and not begun:
            begun.append(rig.streamer.acknowledged)
            rig.printer._state.send_line("//action:paused")
        elif begun and rig.streamer.state is State.PAUSED and len(begun) == 1:
            begun.append(0)
            rig.submit(commands.Resume())

    rig.on_event = meddle
    rig.run()

    assert len(begun) == 2
    assert rig.answers == ["resumed the printer"]
    assert "M108" in rig.executed
    assert isinstance(rig.events[-1], Finished)
