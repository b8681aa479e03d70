"""Heaters go off when the host dies and nobody comes back, and when a printer is given up."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Iterator
from itertools import count
from pathlib import Path
from threading import Event as Flag
from threading import Thread
from typing import Any

import pytest

from tests.waiting import LAST_RESORT

if sys.platform == "win32":
    pytest.skip("there are no pseudo-terminals", allow_module_level=True)

from benchmarks.killing import of_job, served, start
from printer_slicer.errors import PrintError
from printer_slicer.inspection.dry_run.machines import machine_of, simulated_firmware_for
from printer_slicer.printing import print_job
from printer_slicer.printing.heater_failsafe import switch_heaters_off_unless_resumed
from printer_slicer.printing.job_store import load_print
from printer_slicer.printing.journal import HEATERS_OFF, read_journal
from printer_slicer.profile import load_profile
from printer_slicer.sim.firmwares import KLIPPER
from printer_slicer.sim.printer import SimulatedPrinter
from printer_slicer.sim.pty_server import serve
from printer_slicer.slice_jobs import job_from
from printer_slicer.stream.serial_port import open_port
from tests.waiting import Halting, hosts, until

MOVES = [f"G1 X{10 + i % 90} Y{10 + i % 7} E0.01 F600" for i in range(300)]
JOB = ["G28", "G90", "M83", "M302 S0", "G1 Z0.3 F600", "M140 S60", "M104 S200", *MOVES]
OFF = ["M104 S0", "M140 S0", "M107"]
NEVER = "3600"
"""s until a guard acts that must not act in this test."""


@pytest.fixture
def begin(tmp_path: Path) -> Iterator[Callable[..., subprocess.Popen[bytes]]]:
    """Starts commands beside the job; they are ended and waited for after the test."""
    (tmp_path / "job.gcode").write_text("\n".join(JOB), encoding="utf-8")
    with hosts(tmp_path / "state") as started:

        def run(*arguments: str) -> subprocess.Popen[bytes]:
            usual = {"print": ("job.gcode", "--port", "port", "--allow", "cold")}.get(arguments[0], ())
            started.append(start(tmp_path, arguments[0], *usual, "--reconnect", "0", *arguments[1:]))
            return started[-1]

        yield run


def ran(host: subprocess.Popen[bytes]) -> int:
    return host.wait(LAST_RESORT)


def printing(executed: list[str], moves: int = 5) -> bool:
    return sum(line.startswith("G1") for line in executed) > moves


def kill(host: subprocess.Popen[bytes], executed: Halting) -> None:
    """End a host without a word while it prints; the printer stands still meanwhile, however long that takes."""
    executed.reached()
    host.kill()
    host.wait()
    executed.go_on()


def the_print(folder: Path) -> Path:
    (left,) = (folder / "state" / "prints").iterdir()
    return left


Begin = Callable[..., "subprocess.Popen[bytes]"]


def test_when_the_host_is_killed_and_nobody_comes_back_the_printer_is_made_cold(
    begin: Begin, tmp_path: Path
) -> None:
    executed = Halting(printing)
    with served(tmp_path / "port", 20.0, executed=executed):
        kill(begin("print", "--guard", "0.2"), executed)
        until(lambda: "M107" in executed)
        left = the_print(tmp_path)
        until(lambda: read_journal(left).states.get(HEATERS_OFF))
        until(lambda: (found := load_print(left)) and not found.is_locked)
        said = ran(begin("resume"))

    done = of_job(executed)
    assert done[: len(done) - done[::-1].index("M104 S200")] == JOB[:7]
    assert set(OFF) <= set(done)
    assert done.index("M104 S0") > done.index(MOVES[3])
    assert said == 5
    assert b"heaters were switched off" in (tmp_path / "said").read_bytes()


def test_a_host_that_comes_back_in_time_finds_the_printer_hot(begin: Begin, tmp_path: Path) -> None:
    executed = Halting(printing)
    with served(tmp_path / "port", 500.0, executed=executed):
        kill(begin("print", "--guard", NEVER), executed)
        assert ran(begin("resume")) == 0

    assert of_job(executed) == JOB


def test_a_resume_that_comes_to_nothing_leaves_the_guard_where_it_is(begin: Begin, tmp_path: Path) -> None:
    """This firmware does not say which line it took, so the print cannot just go on; nobody consents to more.

    The guard of the test waits by a clock that is told, so it acts behind the resume, however long that takes.
    """
    heated = ["M190 S60", "M109 S200", "G28", "G90", "M83", "G1 Z0.3 F600", *MOVES]
    (tmp_path / "job.gcode").write_text("\n".join(heated), encoding="utf-8")
    now, looks = [0.0], count()
    looked = [0]

    def clock() -> float:
        looked[0] = next(looks)
        return now[0]

    executed = Halting(printing)
    with served(tmp_path / "port", 50.0, KLIPPER, executed):
        kill(begin("print"), executed)
        left = the_print(tmp_path)
        guard = Thread(target=lambda: switch_heaters_off_unless_resumed(left, 10.0, clock))
        guard.start()
        try:
            until(lambda: looked[0])
            assert ran(begin("resume")) == 5
            assert b"does not check line numbers" in (tmp_path / "said").read_bytes()
            assert "M104 S0" not in executed
        finally:
            now[0] = 11.0
            guard.join(LAST_RESORT)
        until(lambda: "M104 S0" in executed)
        until(lambda: "M140 S0" in executed)


def test_heat_that_a_macro_asked_for_goes_off_too(begin: Begin, tmp_path: Path) -> None:
    """Nothing in the file tells of heaters, so nothing but switching them off anyway will do."""
    (tmp_path / "job.gcode").write_text("\n".join(["G28", "G90", "M83", "M302 S0", *MOVES]), encoding="utf-8")
    executed = Halting(printing)
    with served(tmp_path / "port", 20.0, executed=executed):
        kill(begin("print", "--guard", "0.2"), executed)
        until(lambda: set(OFF) <= set(executed))


def test_a_print_that_ends_well_needs_no_guard(begin: Begin, tmp_path: Path) -> None:
    with served(tmp_path / "port", 500.0) as executed:
        assert ran(begin("print", "--guard", "0.1")) == 0  # it waits for its guard

    assert of_job(executed) == JOB


def test_a_guard_cannot_be_asked_for_less_than_nothing(begin: Begin, tmp_path: Path) -> None:
    assert ran(begin("print", "--guard", "-1")) == 2
    assert b"--guard" in (tmp_path / "said").read_bytes()


class Complaining:
    """A printer that says once that something went wrong, and goes on listening."""

    def __init__(self, inner: SimulatedPrinter, executed: list[str]) -> None:
        self._inner, self._executed, self._left = inner, executed, True

    def send(self, now: float) -> bytes:
        said = self._inner.send(now)
        if self._left and printing(self._executed):
            self._left = False
            said += b"!! Move out of range\n"
        return said

    def __getattr__(self, name: str) -> Any:
        return getattr(self._inner, name)


@pytest.mark.parametrize(("guard", "cold"), [(None, True), (0.0, False)])
def test_a_printer_that_is_given_up_is_told_to_cool(guard: float | None, cold: bool, tmp_path: Path) -> None:
    (tmp_path / "job.gcode").write_text("\n".join(JOB), encoding="utf-8")
    profile = load_profile("marlin_220")
    executed: list[str] = []
    plain = SimulatedPrinter(
        machine_of(profile.printer),
        simulated_firmware_for(profile.printer),
        on_executed=executed.append,
        boots=False,
    )
    printer: Any = Complaining(plain, executed)
    ready, stop, link = Flag(), Flag(), tmp_path / "port"
    thread = Thread(
        target=lambda: serve(lambda: printer, link, speed=20.0, stop=stop.is_set, ready=lambda _: ready.set())
    )
    thread.start()
    try:
        assert ready.wait(LAST_RESORT)
        job = job_from(tmp_path / "job.gcode", profile).allowing(["cold"])
        with pytest.raises(PrintError, match="out of range"):
            print_job(job, profile, str(link), guard=guard)
        if cold:
            until(lambda: "M107" in executed)
        else:
            behind = open_port(str(link))
            behind.write(b"M117 behind\n")
            until(lambda: "M117 behind" in executed)
            behind.close()
    finally:
        stop.set()
        thread.join()
    assert ("M104 S0" in executed) == cold
