"""Prints over a real device of the system: other processes steer them, cables come and go, hosts are killed."""

from __future__ import annotations

import json
import os
import re
import select
import socket
import subprocess
import sys
from pathlib import Path
from threading import Event as Flag
from threading import Thread

import pytest
from printed import tower

from tests.cli.command_line import Outcome, typed
from tests.effort import few_of
from tests.waiting import LAST_RESORT, until

if sys.platform == "win32":
    pytest.skip("there are no pseudo-terminals", allow_module_level=True)

import pty
import tty

from plugged import after, pluggable, served

from benchmarks.killing import of_job, one_job
from printer_slicer.errors import Cancelled, PortError, PrintError, UsageError
from printer_slicer.jobs import Job
from printer_slicer.printing import Controls, print_job, resume_print
from printer_slicer.printing import job_store as store
from printer_slicer.printing.control_socket import send_control_command
from printer_slicer.printing.journal import read_journal
from printer_slicer.profile import load_profile
from printer_slicer.slice_jobs import job_from
from printer_slicer.stream.events import Accepted, Event, Paused, StreamWarning
from printer_slicer.stream.serial_port import SerialPort

ROOT = Path(__file__).parents[2]
PROFILE = load_profile("marlin_220", "pla", "standard")
LINES = "G28\nG90\nM83\nG1 Z1 F600\n" + "".join(
    f"G1 X{10 + i % 60} Y{10 + i % 7} F6000\n" for i in range(600)
)


def job_in(folder: Path, text: str = LINES) -> Job:
    path = folder / "job.gcode"
    path.write_text(text, encoding="utf-8")
    return job_from(path, PROFILE)


class Background:
    """A print in a thread of its own."""

    def __init__(self, job: Job, port: Path, job_store: Path, *, reconnect: float = 0.0) -> None:
        self.controls = Controls()
        self.events: list[Event] = []
        self.error: Exception | None = None
        self.done = False

        def run() -> None:
            try:
                print_job(
                    job,
                    PROFILE,
                    str(port),
                    controls=self.controls,
                    job_store=job_store,
                    on_event=self.events.append,
                    reconnect=reconnect,
                )
                self.done = True
            except Exception as error:  # noqa: BLE001 - looked at by the test
                self.error = error

        self.thread = Thread(target=run)
        self.thread.start()

    @property
    def accepted(self) -> int:
        return max((event.acknowledged for event in self.events if isinstance(event, Accepted)), default=0)

    def ended(self) -> None:
        self.thread.join(LAST_RESORT)
        assert not self.thread.is_alive()


# From another thread, from another process


def test_another_thread_pauses_changes_and_goes_on(tmp_path: Path) -> None:
    executed = after(50)
    with served(tmp_path / "port", executed=executed):
        printing = Background(job_in(tmp_path), tmp_path / "port", tmp_path / "shelf")
        executed.reached()
        printing.controls.pause()
        executed.go_on()
        until(lambda: any(isinstance(event, Paused) for event in printing.events))
        printing.controls.speed(120)
        assert printing.controls.status()["state"] == "paused"
        printing.controls.resume()
        printing.ended()

    assert printing.done, printing.error
    assert of_job(executed)[-450:] == LINES.split("\n")[-451:-1]
    assert "M220 S120" in executed
    assert list((tmp_path / "shelf").iterdir()) == []


def control(folder: Path, *words: str) -> tuple[int, str, str]:
    """The command, in a process of its own."""
    env = {**os.environ, "PRINTER_SLICER_STATE": str(folder), "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-m", "printer_slicer", "control", *words]
    done = subprocess.run(command, env=env, capture_output=True, text=True, timeout=LAST_RESORT, check=False)
    return done.returncode, done.stdout, done.stderr


def test_another_process_sees_and_steers_the_print(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    long = LINES + "G4 P500\n" * 600
    with served(tmp_path / "port", speed=1.0) as executed:
        printing = Background(job_in(tmp_path, long), tmp_path / "port", tmp_path / "prints")
        until(lambda: printing.accepted > 20)
        code, out, err = control(tmp_path, "status", "--json")
        assert code == 0, err
        assert json.loads(out)["job"] == "job.gcode"
        monkeypatch.setenv("PRINTER_SLICER_STATE", str(tmp_path))
        assert typed("control", "say", "M117 hello").code == 0
        assert typed("control", "speed", "900").code == 2
        assert typed("control", "object", "7").code == 2
        assert typed("control", "pause", "--job", "other.gcode").code == 2
        until(lambda: "M117 hello" in executed)  # a cancel drops commands that are still queued
        code, out, err = control(tmp_path, "cancel")
        assert code == 0, err
        printing.ended()

    assert isinstance(printing.error, Cancelled)
    assert {"M117 hello", "M104 S0", "M140 S0", "M84"} <= set(executed)
    gone = typed("control", "status")
    assert gone.code == 2
    assert "no running print\n  Start a print with" in gone.err
    assert "no unfinished print\n  Start a print with" in typed("resume").err


def test_only_its_owner_can_open_the_door_and_a_stale_one_is_replaced(tmp_path: Path) -> None:
    executed = after(5)
    with served(tmp_path / "port", executed=executed):
        printing = Background(job_in(tmp_path), tmp_path / "port", tmp_path / "prints")
        executed.reached()
        (folder,) = (tmp_path / "prints").iterdir()
        where = Path(json.loads((folder / "control.json").read_text(encoding="utf-8"))["path"])
        assert where.stat().st_mode & 0o777 == 0o600
        assert (folder / "control.json").stat().st_mode & 0o777 == 0o600
        assert folder.stat().st_mode & 0o777 == 0o700
        # Somebody who connects and says nothing keeps nobody waiting.
        with socket.socket(socket.AF_UNIX) as silent:
            silent.connect(str(where))
            assert send_control_command(folder, "status")["ok"]
            assert not send_control_command(folder, "nonsense")["ok"]
        printing.controls.stop()
        executed.go_on()
        printing.ended()

    assert not where.exists()
    with pytest.raises(PortError, match="does not respond"):
        send_control_command(folder, "status")


def test_an_emergency_stop_waits_for_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The request comes from another thread while the host waits for the printer, here for as long as it takes."""
    master, slave = pty.openpty()
    tty.setraw(slave)
    answered = 0
    seen: list[bytes] = []
    waits, read = Flag(), SerialPort.read

    def patient(port: SerialPort, timeout: float) -> bytes:
        """Nothing but a byte or a call from outside ends this."""
        if answered < 61:
            return read(port, timeout)
        waits.set()
        return read(port, LAST_RESORT)

    def printer() -> None:
        nonlocal answered
        rest = b""
        while not seen and select.select([master], [], [], LAST_RESORT)[0]:
            data = os.read(master, 4096)
            if b"M112" in data:
                seen.append(data)
            *lines, rest = (rest + data).split(b"\n")
            for line in filter(None, lines):
                answered += 1
                if answered < 60:
                    heat = b" T:20 /0" if b"M105" in line else b""
                    os.write(
                        master, (b"FIRMWARE_NAME:x\n" if b"M115" in line else b"") + b"ok" + heat + b"\n"
                    )

    monkeypatch.setattr(SerialPort, "read", patient)
    thread = Thread(target=printer)
    thread.start()
    printing = Background(job_in(tmp_path), Path(os.ttyname(slave)), tmp_path / "prints")
    until(waits.is_set)
    printing.controls.stop()
    thread.join(LAST_RESORT)
    printing.ended()
    os.close(master)
    os.close(slave)

    assert seen


# A cable that is pulled


def test_a_cable_that_is_pulled_and_plugged_in_again_costs_nothing(tmp_path: Path) -> None:
    with pluggable(tmp_path / "port") as (executed, pull, plug):
        printing = Background(job_in(tmp_path), tmp_path / "port", tmp_path / "prints", reconnect=LAST_RESORT)
        executed.reached()
        pull()
        executed.go_on()
        until(
            lambda: any(
                isinstance(event, StreamWarning) and "waiting" in event.text for event in printing.events
            )
        )
        status = printing.controls.status_soon()
        plug()
        printing.ended()

    assert printing.done, printing.error
    assert status["waits_for"].startswith(f"the printer to reconnect: {tmp_path}/port: connection lost")
    assert status["done"] > 50
    assert any(
        isinstance(event, StreamWarning) and "kept its state" in event.text for event in printing.events
    )
    assert of_job(executed) == LINES.split("\n")[:-1]


def test_a_cable_that_stays_away_leaves_a_print_that_can_be_resumed(tmp_path: Path) -> None:
    with pluggable(tmp_path / "port") as (executed, pull, plug):
        job = job_in(tmp_path)
        printing = Background(job, tmp_path / "port", tmp_path / "prints", reconnect=0.2)
        executed.reached()
        pull()
        executed.go_on()
        printing.ended()
        assert isinstance(printing.error, PrintError)
        plug()

        with pytest.raises(UsageError, match="unfinished"):
            print_job(job, PROFILE, str(tmp_path / "port"), job_store=tmp_path / "prints")
        left = store.find_print(tmp_path / "prints", "", running=False)
        # The file may be gone meanwhile.
        (tmp_path / "job.gcode").unlink()
        done = resume_print(left, job)

    assert done.verified
    assert of_job(executed) == LINES.split("\n")[:-1]
    assert list((tmp_path / "prints").iterdir()) == []


def test_an_unfinished_print_is_forgotten_only_when_that_is_said(tmp_path: Path) -> None:
    with pluggable(tmp_path / "port") as (executed, pull, plug):
        job = job_in(tmp_path)
        printing = Background(job, tmp_path / "port", tmp_path / "prints")
        executed.reached()
        pull()
        executed.go_on()
        printing.ended()
        plug()
        print_job(job, PROFILE, str(tmp_path / "port"), job_store=tmp_path / "prints", discard=True)

    assert list((tmp_path / "prints").iterdir()) == []


def test_a_printer_that_was_reset_while_it_was_away_is_not_taken_up(tmp_path: Path) -> None:
    executed = after(60)
    with served(tmp_path / "port", executed=executed):
        printing = Background(job_in(tmp_path), tmp_path / "port", tmp_path / "prints", reconnect=LAST_RESORT)
        executed.reached()
    until(
        lambda: any(isinstance(event, StreamWarning) and "waiting" in event.text for event in printing.events)
    )
    with served(tmp_path / "port") as executed:
        printing.ended()

    assert isinstance(printing.error, PrintError)
    assert re.fullmatch(
        rf"job\.gcode: {tmp_path}/port: connection lost: [^;]+; reconnected, but the last accepted line is 0, not \d+"
        r" \(after \d+ of 604 commands\)\n  Check the printer, [^;]+; the part is not finished\."
        r" Run printer-slicer resume to continue",
        str(printing.error),
    )
    assert not any(line.startswith("G") for line in executed)


def test_a_print_that_runs_is_not_resumed_besides(tmp_path: Path) -> None:
    told = r"^job\.gcode is already running\n  Run printer-slicer control status$"
    executed = after(20)
    with served(tmp_path / "port", executed=executed):
        printing = Background(job_in(tmp_path), tmp_path / "port", tmp_path / "prints")
        executed.reached()
        with pytest.raises(UsageError, match=told):
            resume_print(store.find_print(tmp_path / "prints", "", running=True), job_in(tmp_path))
        printing.controls.cancel()
        executed.go_on()
        printing.ended()

    assert isinstance(printing.error, Cancelled)


def test_a_printer_that_was_reset_is_not_resumed_without_consent(tmp_path: Path) -> None:
    text = tower(40)
    with served(tmp_path / "port", speed=100.0, executed=(first := after(100))):
        printing = Background(job_in(tmp_path, text), tmp_path / "port", tmp_path / "prints")
        first.reached()
    printing.ended()
    left = store.find_print(tmp_path / "prints", "", running=False)
    asked: list[str] = []
    with served(tmp_path / "port") as executed, pytest.raises(PrintError) as caught:
        resume_print(left, job_in(tmp_path, text), recover=lambda why: bool(asked.append(why)))

    assert re.fullmatch(
        r"job\.gcode was not resumed: the last accepted line is 0, not \d+\n"
        r"  Use printer-slicer resume --recover to run the recovery steps above",
        str(caught.value),
    )
    assert "home x and y only" in asked[0]
    assert not any(line.startswith("G") for line in executed)
    assert not left.is_locked


def test_with_consent_a_printer_that_was_reset_is_brought_back_and_goes_on(tmp_path: Path) -> None:
    text = tower(40)
    with served(tmp_path / "port", speed=100.0, executed=(first := after(100))):
        printing = Background(job_in(tmp_path, text), tmp_path / "port", tmp_path / "prints")
        first.reached()
    printing.ended()
    left = store.find_print(tmp_path / "prints", "", running=False)
    asked: list[str] = []
    with served(tmp_path / "port", speed=0) as executed:
        done = resume_print(left, job_in(tmp_path, text), recover=lambda why: not asked.append(why))

    assert "home x and y only" in asked[0]
    assert "G28 X Y" in executed
    assert "G28" not in executed
    assert done.verified
    commands = text.replace(";LAYER_CHANGE\n", "").split("\n")[:-1]
    assert of_job(executed)[-80:] == commands[-80:]
    assert list((tmp_path / "prints").iterdir()) == []


# A disk that is full, a file that changes


def test_a_full_disk_does_not_stop_the_print(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if not Path("/dev/full").exists():
        pytest.skip("no full disk here")
    create_print = store.create_print

    def full(*arguments: object, **named: object) -> store.Print:
        made = create_print(*arguments, **named)  # type: ignore[arg-type]
        (made.folder / "journal").unlink()
        (made.folder / "journal").symlink_to("/dev/full")
        return made

    monkeypatch.setattr(store, "create_print", full)
    with served(tmp_path / "port", speed=0) as executed:
        printing = Background(job_in(tmp_path), tmp_path / "port", tmp_path / "prints")
        printing.ended()

    assert printing.done, printing.error
    assert of_job(executed) == LINES.split("\n")[:-1]
    assert any(
        isinstance(event, StreamWarning) and "cannot be resumed" in event.text for event in printing.events
    )


def test_a_file_that_is_changed_or_deleted_meanwhile_is_printed_as_it_was(tmp_path: Path) -> None:
    executed = after(50)
    with served(tmp_path / "port", executed=executed):
        printing = Background(job_in(tmp_path), tmp_path / "port", tmp_path / "prints")
        executed.reached()
        (tmp_path / "job.gcode").write_text("M112\n", encoding="utf-8")
        (tmp_path / "job.gcode").unlink()
        executed.go_on()
        printing.ended()

    assert printing.done, printing.error
    assert of_job(executed) == LINES.split("\n")[:-1]


def test_a_place_where_nothing_can_be_written_is_refused_before_the_first_byte(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("", encoding="utf-8")
    with served(tmp_path / "port") as executed, pytest.raises(Exception, match="cannot store the print"):
        print_job(job_in(tmp_path), PROFILE, str(tmp_path / "port"), job_store=tmp_path / "file" / "prints")

    assert executed == []


# A host that is killed


@pytest.mark.parametrize("seed", few_of([7, 8], 1))
def test_a_killed_host_is_taken_up_exactly(seed: int, tmp_path: Path) -> None:
    """More of this: benchmarks/killing.py."""
    outcome = one_job(seed, 3, tmp_path)

    assert outcome.exact, outcome.what
    assert all(0 <= ahead <= 3 for ahead in outcome.ahead)


def test_what_is_left_can_be_listed_and_forgotten(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with served(tmp_path / "port", executed=(executed := after(30))):
        printing = Background(job_in(tmp_path), tmp_path / "port", tmp_path / "prints")
        executed.reached()
    printing.ended()
    monkeypatch.setenv("PRINTER_SLICER_STATE", str(tmp_path))

    def resume(*words: str) -> Outcome:
        return typed("resume", *words)

    (row,) = json.loads(resume("--list", "--json").out)
    (folder,) = (tmp_path / "prints").iterdir()
    assert row["job"] == "job.gcode"
    assert row["accepted"] == read_journal(folder).entries
    assert resume("--discard").code == 0
    assert resume().code == 2
    assert "no unfinished prints" in resume("--list").out
