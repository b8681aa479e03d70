"""A host that is gone from one moment to the next, and another one that goes on where the printer kept its state."""

from __future__ import annotations

from pathlib import Path
from random import Random  # noqa: TID251 - seeded

import pytest
from printed import scribble, tower
from rig import SETUP, Rig, assert_same_beads

from printer_slicer.printing import commands
from printer_slicer.printing.journal import read_journal
from printer_slicer.printing.objects import find_object_spans
from printer_slicer.printing.print_controller import PrintPhase
from printer_slicer.printing.reattach import PrinterStateLost, ResumePlan, find_resume_plan, query_printer
from printer_slicer.sim.firmwares import MARLIN_2_0_AVR, MARLIN_2_1, MARLIN_2_1_ADVANCED
from printer_slicer.stream.events import Event, Finished
from tests.effort import crossed, few_of

SIMULATED_FIRMWARES = {"2.1": MARLIN_2_1, "2.0 AVR": MARLIN_2_0_AVR, "2.1 advanced": MARLIN_2_1_ADVANCED}


class Killed(Exception):  # noqa: N818
    """The host is gone."""


def kill_after(rig: Rig, turns: int) -> None:
    """Run, and end the host at some turn of the pump, or right before some bytes are written."""
    left = [turns]
    write = rig.port.write

    def count(_: object) -> None:
        left[0] -= 1
        if left[0] <= 0:
            raise Killed

    def write_or_die(data: bytes) -> None:
        count(None)
        write(data)

    rig.port.write = write_or_die  # type: ignore[method-assign]
    try:
        rig.run(count)
    finally:
        rig.port.write = write  # type: ignore[method-assign]


def found_by_next_host(rig: Rig) -> ResumePlan:
    """What another host finds; some of what the printer says meanwhile goes nowhere."""
    assert rig.folder is not None
    rig.port.read(0.05)
    journal_data = read_journal(rig.folder)
    resync = query_printer(rig.port, rig.port.now, journal_data, rig.journal)
    found = find_resume_plan(journal_data, resync, rig.commands, find_object_spans(rig.text.encode()), SETUP)
    assert rig.journal
    rig.journal.record_accepted(resync.queries()[-1][0], found.entries, rig.port.now())
    return found


@pytest.mark.parametrize(("seed", "name"), crossed(range(12), SIMULATED_FIRMWARES))
def test_nothing_is_sent_twice_and_nothing_left_out(seed: int, name: str, tmp_path: Path) -> None:
    chance = Random(seed)
    text = scribble(seed, 120, relative=bool(seed % 2))
    rig = Rig(text, SIMULATED_FIRMWARES[name], folder=tmp_path, baud=115_200)
    rig.connect()
    kills = 0
    while True:
        try:
            kill_after(rig, chance.randrange(5, 120))
            break
        except Killed:
            kills += 1
            rig.connect(found_by_next_host(rig) if rig.streamer.acknowledged or kills > 1 else None)

    assert kills >= 2
    assert isinstance(rig.events[-1], Finished)
    assert rig.events[-1].verified is not False
    assert rig.of_job() == text.split("\n")[:-1]


def test_the_journal_never_names_more_than_the_printer_took(tmp_path: Path) -> None:
    text = scribble(1, 100, relative=True)
    rig = Rig(text, folder=tmp_path)
    rig.connect()
    behind: list[int] = []

    def look(_: float) -> None:
        if rig.streamer.acknowledged:
            behind.append(len(rig.of_job()) - read_journal(tmp_path).entries)

    rig.run(look)

    assert min(behind) >= 0
    assert max(behind) <= 3


@pytest.mark.parametrize("seed", few_of(range(25), 8))
def test_a_host_killed_around_a_pause_leaves_no_trace_in_the_part(seed: int, tmp_path: Path) -> None:
    chance = Random(seed)
    text = scribble(seed, 60, relative=bool(seed % 2))
    whole = Rig(text)
    whole.connect()
    whole.run()
    rig = Rig(text, folder=tmp_path)
    rig.connect()
    begun: list[float] = []

    def meddle(event: Event) -> None:
        if rig.streamer.acknowledged >= 30 and rig.controller.phase is PrintPhase.RUNNING and not begun:
            begun.append(rig.port.now())
            rig.submit(commands.Pause())
        elif rig.controller.phase is PrintPhase.PAUSED:
            rig.submit(commands.Resume())

    rig.on_event = meddle
    kills = 0
    while True:
        try:
            kill_after(rig, chance.randrange(60, 160))
            break
        except Killed:
            kills += 1
            rig.connect(found_by_next_host(rig) if rig.streamer.acknowledged or kills > 1 else None)

    assert begun
    assert isinstance(rig.events[-1], Finished)
    assert_same_beads(rig.beads, whole.beads)
    assert rig.printer._state.filament == pytest.approx(whole.printer._state.filament, abs=1e-3)


def test_a_printer_that_was_reset_has_lost_its_state(tmp_path: Path) -> None:
    rig = Rig(tower(4), folder=tmp_path)
    rig.connect()
    with pytest.raises(Killed):
        kill_after(rig, 150)
    rig.printer.reset(rig.port.now())

    with pytest.raises(PrinterStateLost, match=r"reset|last accepted line"):
        found_by_next_host(rig)


def test_a_printer_that_is_somewhere_else_has_lost_its_state(tmp_path: Path) -> None:
    rig = Rig(tower(4), folder=tmp_path)
    rig.connect()

    def killed_at(event: Event) -> None:
        if rig.streamer.acknowledged >= 40:
            raise Killed

    rig.on_event = killed_at
    with pytest.raises(Killed):
        rig.run()
    # Somebody else drove it: without numbers, so the count of lines does not tell.
    rig.port.write(b"\nG1 X7 Y7\n")
    rig.port.read(5.0)

    with pytest.raises(PrinterStateLost, match="x of the nozzle is 7"):
        found_by_next_host(rig)


def test_a_printer_that_never_answers_is_given_up(tmp_path: Path) -> None:
    rig = Rig(tower(2), folder=tmp_path)
    rig.connect()
    with pytest.raises(Killed):
        kill_after(rig, 100)
    rig.port.write = lambda _: None  # type: ignore[method-assign]

    with pytest.raises(PrinterStateLost, match="does not answer"):
        found_by_next_host(rig)
