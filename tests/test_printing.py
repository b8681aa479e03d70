"""Printing over a port: to the end, or with a checkpoint that says how far it came."""

from __future__ import annotations

import errno
import json
import os
import re
import select
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Event as Flag
from threading import Thread

import pytest

from printer_slicer.errors import Cancelled, PortError, PrintError
from printer_slicer.inspection.dry_run.machines import machine_of, simulated_firmware_for
from printer_slicer.jobs import Job
from printer_slicer.printing import print_job
from printer_slicer.printing.print_session import write_checkpoint
from printer_slicer.profile import load_profile
from printer_slicer.sim.printer import SimulatedPrinter
from printer_slicer.sim.pty_server import serve
from printer_slicer.sim.statistics import Report
from printer_slicer.slice_jobs import job_from
from printer_slicer.stream.events import Accepted, Event, Finished, Identified
from tests.waiting import LAST_RESORT, until

if sys.platform == "win32":
    pytest.skip("there are no pseudo-terminals", allow_module_level=True)

import pty
import tty

PROFILE = load_profile("marlin_220", "pla", "standard")
PARTS = Path(__file__).parents[1] / "sample_parts"
DANCE = "".join(f";LAYER_CHANGE\nG1 X{10 + i % 7} Y{5 + i % 3} F6000\nG1 X{20 + i % 5}\n" for i in range(100))
HEATERS_OFF = {"M104 S0", "M140 S0"}


class Served:
    """A simulated printer behind a pseudo-terminal, and what it did."""

    def __init__(self) -> None:
        self.executed: list[str] = []
        self.reports: list[Report] = []
        self.stop = Flag()
        self.printer: SimulatedPrinter | None = None
        self.on_executed: Callable[[str], None] = self.executed.append

    def note(self, text: str) -> None:
        """One more command is executed; a test may look at it when the printer already runs."""
        self.on_executed(text)

    def make(self) -> SimulatedPrinter:
        """The printer; made by the thread that serves it."""
        printer = PROFILE.printer
        self.printer = SimulatedPrinter(
            machine_of(printer), simulated_firmware_for(printer), on_executed=self.note
        )
        return self.printer


@contextmanager
def served(link: Path) -> Iterator[Served]:
    """A printer under the name `link` for as long as the block runs; it never makes the host wait."""
    ready, state = Flag(), Served()

    def run() -> None:
        report = serve(state.make, link, speed=0, stop=state.stop.is_set, ready=lambda _: ready.set())
        state.reports.append(report)

    thread = Thread(target=run)
    thread.start()
    try:
        assert ready.wait(LAST_RESORT)
        yield state
    finally:
        state.stop.set()
        thread.join(LAST_RESORT)
    assert not thread.is_alive()


@contextmanager
def pretended(answer: Callable[[str], str | None]) -> Iterator[str]:
    """A port whose printer answers each line as it is told, without number and checksum; None pulls the plug."""
    master, slave = pty.openpty()
    tty.setraw(slave)
    stop = Flag()

    def run() -> None:
        rest = b""
        while not stop.is_set():
            if not select.select([master], [], [], 0.05)[0]:
                continue
            *lines, rest = (rest + os.read(master, 4096)).split(b"\n")
            for line in filter(None, lines):
                said = answer(re.sub(rb"^N\d+ |\*\d+$", b"", line).decode())
                if said is None:
                    os.close(master)
                    return
                os.write(master, said.encode())
        os.close(master)

    thread = Thread(target=run)
    thread.start()
    try:
        yield os.ttyname(slave)
    finally:
        stop.set()
        thread.join(LAST_RESORT)
        os.close(slave)


def polite(line: str, place: str = "X:0.00 Y:0.00 Z:0.00 E:0.00") -> str:
    """What a printer answers that does nothing at all."""
    said = {"M115": "FIRMWARE_NAME:Marlin pretended\n", "M114": f"{place} Count X:0 Y:0 Z:0\n"}
    return said.get(line.partition(" ")[0], "") + ("ok T:20.0 /0.0\n" if line.startswith("M105") else "ok\n")


def job_of(folder: Path, text: str) -> Job:
    path = folder / "job.gcode"
    path.write_text(text, encoding="utf-8")
    return job_from(path, PROFILE).allowing(["halt"])


def wishes(lines: list[str]) -> list[str]:
    """What was executed of the job: not what the host asks on its own account."""
    return [line for line in lines if not line.startswith(("M105", "M110", "M114", "M115", "M155", "M400"))]


# To the end


def test_a_part_is_executed_as_sliced_once_and_in_order(tmp_path: Path) -> None:
    job = job_from(PARTS / "box.stl", PROFILE)
    with served(tmp_path / "printer") as printer:
        done = print_job(job, PROFILE, str(tmp_path / "printer"), checkpoint=tmp_path / "box.json")

    assert wishes(printer.executed) == [command.decode() for command in job.commands]
    assert (done.commands, done.verified) == (len(job.commands), True)
    assert printer.reports[0].layers == job.heights
    assert printer.reports[0].violations == ()
    assert not (tmp_path / "box.json").exists()


def test_it_is_told_what_happens(tmp_path: Path) -> None:
    job = job_of(tmp_path, "G28\n" + DANCE)
    heard: list[Event] = []
    with served(tmp_path / "printer"):
        print_job(job, PROFILE, str(tmp_path / "printer"), on_event=heard.append)
    accepted = [event.acknowledged for event in heard if isinstance(event, Accepted)]

    assert sum(isinstance(event, Identified) for event in heard) == 1
    assert accepted == sorted(set(accepted))
    assert isinstance(heard[-1], Finished)
    assert heard[-1].acknowledged == len(job.commands)


def test_the_same_port_can_print_again(tmp_path: Path) -> None:
    job = job_of(tmp_path, "G28\nG1 X5 F3000\n")
    with served(tmp_path / "printer") as printer:
        for _ in range(2):
            assert print_job(job, PROFILE, str(tmp_path / "printer")).verified
    assert wishes(printer.executed) == ["G28", "G1 X5 F3000"] * 2


def test_a_printer_that_is_not_where_the_job_ends_is_noticed(tmp_path: Path) -> None:
    job = job_of(tmp_path, "G28\nG1 X5 Y6 Z7 F3000\n")
    with pretended(lambda line: polite(line, "X:5.00 Y:9.00 Z:7.00 E:0.00")) as port:
        assert print_job(job, PROFILE, port).verified is False


def test_a_printer_that_does_not_say_where_it_is_leaves_the_question_open(tmp_path: Path) -> None:
    job = job_of(tmp_path, "G28\nG1 X5 Y6 Z7 F3000\n")
    with pretended(lambda line: "ok\n" if line.startswith("M114") else polite(line)) as port:
        assert print_job(job, PROFILE, port).verified is None


# The port


@pytest.mark.parametrize("port", ["/dev/no_such_port", "", "nonsense://x", "socket://127.0.0.1:1"])
def test_a_port_that_cannot_be_opened_is_a_port_error_and_leaves_no_checkpoint(
    port: str, tmp_path: Path
) -> None:
    with pytest.raises(PortError) as caught:
        print_job(job_of(tmp_path, "G28\n"), PROFILE, port, checkpoint=tmp_path / "c.json")

    assert caught.value.exit_code == 4
    assert caught.value.remedy
    assert not (tmp_path / "c.json").exists()


# Not to the end


def stopped(
    folder: Path, error: type[PrintError | Cancelled], job: Job, port: str, on_event: object = None
) -> str:
    """The message of a print that is stopped; its checkpoint is `c.json`."""
    listen = on_event if callable(on_event) else lambda _: None
    with pytest.raises(error) as caught:
        print_job(job, PROFILE, port, on_event=listen, checkpoint=folder / "c.json")
    assert "job.gcode" in str(caught.value)
    assert "c.json" in str(caught.value)
    return str(caught.value)


def checkpoint_of(folder: Path, job: Job) -> int:
    """How far the print came; the whole checkpoint is looked at."""
    state = json.loads((folder / "c.json").read_text(encoding="utf-8"))
    done = state["acknowledged"]
    assert (state["job"], state["commands"]) == ("job.gcode", len(job.commands))
    assert state["layer"] == job.layer_of(done)
    assert state["reason"]
    assert state.get("next") == (job.commands[done].decode() if done < len(job.commands) else None)
    return int(done)


def test_a_printer_that_is_pulled_out_leaves_a_checkpoint(tmp_path: Path) -> None:
    job = job_of(tmp_path, "G28\n" + DANCE)
    heard = 0

    def answer(line: str) -> str | None:
        nonlocal heard
        heard += line.startswith("G1")
        return polite(line) if heard < 50 else None

    with pretended(answer) as port:
        message = stopped(tmp_path, PrintError, job, port)

    assert 40 <= checkpoint_of(tmp_path, job) <= 50
    assert port in message
    assert "cable" in message


def test_a_simulated_printer_that_goes_away_leaves_a_checkpoint_of_what_it_took(tmp_path: Path) -> None:
    job = job_of(tmp_path, "G28\n" + DANCE)
    with served(tmp_path / "printer") as printer:

        def count(text: str) -> None:
            printer.executed.append(text)
            if len(printer.executed) > 60:
                printer.stop.set()

        printer.on_executed = count
        stopped(tmp_path, PrintError, job, str(tmp_path / "printer"))
    done = checkpoint_of(tmp_path, job)

    assert 0 < done < len(job.commands)
    assert wishes(printer.executed)[:done] == [command.decode() for command in job.commands[:done]]


def test_a_printer_that_halts_is_a_failed_print_with_its_reason(tmp_path: Path) -> None:
    job = job_of(tmp_path, "G28\n" + DANCE + "M112\n" + DANCE)
    with served(tmp_path / "printer") as printer:
        message = stopped(tmp_path, PrintError, job, str(tmp_path / "printer"))

    assert "halted" in message
    assert printer.reports[0].killed
    assert 190 <= checkpoint_of(tmp_path, job) <= 202


def test_a_thermal_runaway_is_a_failed_print_with_its_reason(tmp_path: Path) -> None:
    job = job_of(tmp_path, "G28\n" + DANCE)
    runaway = "Error:Thermal Runaway, system stopped! Heater_ID: 0\nError:Printer halted. kill() called!\n"
    heard = 0

    def answer(line: str) -> str | None:
        nonlocal heard
        heard += line.startswith("G1")
        return polite(line) if heard < 50 else runaway if heard == 50 else ""

    with pretended(answer) as port:
        message = stopped(tmp_path, PrintError, job, port)

    assert "Thermal Runaway" in message
    assert 40 <= checkpoint_of(tmp_path, job) <= 50


def test_a_printer_that_was_reset_gets_nothing_more(tmp_path: Path) -> None:
    job = job_of(tmp_path, "G28\n" + DANCE)
    heard: list[str] = []

    def answer(line: str) -> str | None:
        heard.append(line)
        moves = sum(line.startswith("G1") for line in heard)
        return polite(line) if moves != 50 else "start\nMarlin 2.1\n"

    with pretended(answer) as port:
        message = stopped(tmp_path, PrintError, job, port)

    assert "reset" in message
    assert 40 <= checkpoint_of(tmp_path, job) <= 51
    assert sum(line.startswith("G1") for line in heard) <= 52


def test_a_checkpoint_that_cannot_be_written_does_not_hide_the_reason(tmp_path: Path) -> None:
    job = job_of(tmp_path, "G28\nM112\n" + DANCE)
    with served(tmp_path / "printer"), pytest.raises(PrintError) as caught:
        print_job(job, PROFILE, str(tmp_path / "printer"), checkpoint=tmp_path / "missing" / "c.json")

    assert "halted" in str(caught.value)
    assert "could not be written" in str(caught.value)


def test_the_message_names_the_folder_of_the_checkpoint(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)

    assert str(tmp_path / "c.json") in write_checkpoint(
        job_of(tmp_path, "G28\n"), 0, Path("c.json"), "cancelled"
    )


def test_a_print_without_a_checkpoint_still_says_where_it_stopped(tmp_path: Path) -> None:
    job = job_of(tmp_path, "G28\n" + DANCE + "M112\n")
    with (
        served(tmp_path / "printer"),
        pytest.raises(PrintError, match=r"of 202 commands, in layer 100") as caught,
    ):
        print_job(job, PROFILE, str(tmp_path / "printer"))

    assert caught.value.exit_code == 5
    assert sorted(path.name for path in tmp_path.iterdir()) == ["job.gcode"]


# Ctrl-C


def interrupts(*after: int) -> Callable[[Event], None]:
    """A listener that presses Ctrl-C when so many commands were accepted, once for each number."""
    left = list(after)

    def listen(event: Event) -> None:
        if left and isinstance(event, Accepted) and event.acknowledged >= left[0]:
            left.pop(0)
            raise KeyboardInterrupt

    return listen


def test_ctrl_c_turns_the_heaters_off_and_says_where_it_stopped(tmp_path: Path) -> None:
    job = job_of(tmp_path, "M104 S200\nM140 S60\nG28\n" + DANCE)
    with served(tmp_path / "printer") as printer:
        message = stopped(tmp_path, Cancelled, job, str(tmp_path / "printer"), interrupts(50))
    done = checkpoint_of(tmp_path, job)
    executed = wishes(printer.executed)
    assert printer.printer is not None

    assert 50 <= done < 60
    assert f"after {done} of {len(job.commands)} commands, in layer {job.layer_of(done)}" in message
    assert executed[:done] == [command.decode() for command in job.commands[:done]]
    assert set(executed[done:]) >= {*HEATERS_OFF, "M107"}
    assert not set(executed[done:]) & {command.decode() for command in job.commands[done:]}
    assert printer.printer._state.hotend.target == 0
    assert printer.printer._state.bed.target == 0


def test_ctrl_c_at_the_last_command_still_cancels_or_finishes(tmp_path: Path) -> None:
    job = job_of(tmp_path, "M104 S200\nG28\nG1 X5 F3000\n")
    with served(tmp_path / "printer") as printer:
        stopped(tmp_path, Cancelled, job, str(tmp_path / "printer"), interrupts(len(job.commands)))

    assert wishes(printer.executed)[: len(job.commands)] == [command.decode() for command in job.commands]
    assert set(printer.executed) >= HEATERS_OFF


def test_a_second_ctrl_c_halts_the_printer(tmp_path: Path) -> None:
    job = job_of(tmp_path, "M104 S200\nG28\n" + DANCE)
    presses = 0

    def listen(event: Event) -> None:
        nonlocal presses
        if isinstance(event, Accepted) and event.acknowledged >= 50 and presses < 2:
            presses += 1
            raise KeyboardInterrupt

    with served(tmp_path / "printer") as printer:
        stopped(tmp_path, Cancelled, job, str(tmp_path / "printer"), listen)
        until(lambda: printer.printer and printer.printer._state.killed)

    assert presses == 2
    assert checkpoint_of(tmp_path, job) >= 50


def fails_at(count: int, error: Exception) -> tuple[Callable[[Event], None], list[int]]:
    """A listener that fails once so many commands are accepted, and what it was told of until it did and afterwards."""
    told: list[int] = []

    def listen(event: Event) -> None:
        if isinstance(event, Accepted):
            told.append(event.acknowledged)
            if event.acknowledged >= count:
                raise error

    return listen, told


def test_a_listener_with_a_fault_does_not_leave_the_heaters_on(tmp_path: Path) -> None:
    """Whatever stops the host, it must not walk away from a hot printer."""
    job = job_of(tmp_path, "M104 S200\nM140 S60\nG28\n" + DANCE)
    listen, _ = fails_at(50, KeyError("no such layer"))
    with served(tmp_path / "printer") as printer, pytest.raises(PrintError, match="no such layer"):
        print_job(job, PROFILE, str(tmp_path / "printer"), on_event=listen)

    assert set(printer.executed) >= HEATERS_OFF


@pytest.mark.parametrize("number", [errno.EPIPE, errno.EIO, errno.ENOSPC, errno.EBADF])
def test_a_listener_that_dies_ends_no_print(number: int, tmp_path: Path) -> None:
    job = job_of(tmp_path, "G28\n" + DANCE)
    listen, told = fails_at(50, OSError(number, "it takes no more"))
    with served(tmp_path / "printer") as printer:
        print_job(job, PROFILE, str(tmp_path / "printer"), on_event=listen)

    assert wishes(printer.executed) == [command.decode() for command in job.commands]
    assert len([count for count in told if count >= 50]) == 1
