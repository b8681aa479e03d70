"""Heaters go off when the host dies and nobody comes back, and when a printer is given up."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from threading import Event as Flag
from threading import Thread
from time import monotonic
from typing import Any

import pytest

if sys.platform == "win32":
    pytest.skip("there are no pseudo-terminals", allow_module_level=True)

from benchmarks.killing import of_job, served, start
from printer_slicer.errors import PrintError
from printer_slicer.jobs import job_from
from printer_slicer.printing import print_job
from printer_slicer.printing.journal import HEATERS_OFF, read_story
from printer_slicer.profile import load_profile
from printer_slicer.sim.front_end import KLIPPER
from printer_slicer.sim.printer import SimulatedPrinter
from printer_slicer.sim.pty_server import serve
from printer_slicer.verdict import front_end_of, machine_of

MOVES = [f"G1 X{10 + i % 90} Y{10 + i % 7} E0.01 F600" for i in range(4000)]
JOB = ["G28", "G90", "M83", "M302 S0", "G1 Z0.3 F600", "M140 S60", "M104 S200", *MOVES]
OFF = ["M104 S0", "M140 S0", "M107"]
PATIENCE = 30.0


def until(what: Callable[[], object]) -> None:
    never, give_up = Flag(), monotonic() + PATIENCE
    while not what():
        assert monotonic() < give_up, "it never happened"
        never.wait(0.01)


def begin(folder: Path, *flags: str) -> subprocess.Popen[bytes]:
    (folder / "job.gcode").write_text("\n".join(JOB), encoding="utf-8")
    return start(
        folder, "print", "job.gcode", "--port", "port", "--reconnect", "0", "--allow", "cold", *flags
    )


def resumed(folder: Path, *flags: str) -> subprocess.Popen[bytes]:
    return start(folder, "resume", "--reconnect", "0", *flags)


def ran(host: subprocess.Popen[bytes]) -> int:
    return host.wait(PATIENCE)


def printing(executed: list[str], moves: int = 5) -> bool:
    return sum(line.startswith("G1") for line in executed) > moves


def test_when_the_host_is_killed_and_nobody_comes_back_the_printer_is_made_cold(tmp_path: Path) -> None:
    with served(tmp_path / "port", 20.0) as executed:
        host = begin(tmp_path, "--guard", "1")
        until(lambda: printing(executed))
        host.kill()
        host.wait()
        until(lambda: "M107" in executed)
        (left,) = (tmp_path / "state" / "prints").iterdir()
        until(lambda: read_story(left).states.get(HEATERS_OFF))
        said = ran(resumed(tmp_path))

    done = of_job(executed)
    assert done[: len(done) - done[::-1].index("M104 S200")] == JOB[:7]
    assert set(OFF) <= set(done)
    assert done.index("M104 S0") > done.index(MOVES[3])
    assert said == 5
    assert b"heaters were switched off" in (tmp_path / "said").read_bytes()


def test_a_host_that_comes_back_in_time_finds_the_printer_hot(tmp_path: Path) -> None:
    with served(tmp_path / "port", 500.0) as executed:
        host = begin(tmp_path, "--guard", "20")
        until(lambda: printing(executed))
        host.kill()
        host.wait()
        assert ran(resumed(tmp_path)) == 0

    assert of_job(executed) == JOB


def test_a_resume_that_comes_to_nothing_leaves_the_guard_where_it_is(tmp_path: Path) -> None:
    """This firmware does not say which line it took, so the print cannot just go on; nobody consents to more."""
    heated = ["M190 S60", "M109 S200", "G28", "G90", "M83", "G1 Z0.3 F600", *MOVES]
    (tmp_path / "job.gcode").write_text("\n".join(heated), encoding="utf-8")
    with served(tmp_path / "port", 50.0, KLIPPER) as executed:
        host = start(tmp_path, *("print", "job.gcode", "--port", "port", "--reconnect", "0", "--guard", "10"))
        until(lambda: printing(executed))
        host.kill()
        host.wait()
        assert ran(resumed(tmp_path)) == 5
        assert b"does not count lines" in (tmp_path / "said").read_bytes()
        assert "M104 S0" not in executed
        until(lambda: "M104 S0" in executed)
        until(lambda: "M140 S0" in executed)


def test_heat_that_a_macro_asked_for_goes_off_too(tmp_path: Path) -> None:
    """Nothing in the file tells of heaters, so nothing but switching them off anyway will do."""
    (tmp_path / "job.gcode").write_text("\n".join(["G28", "G90", "M83", "M302 S0", *MOVES]), encoding="utf-8")
    with served(tmp_path / "port", 20.0) as executed:
        host = start(
            tmp_path,
            *("print", "job.gcode", "--port", "port", "--reconnect", "0", "--guard", "1"),
            *("--allow", "cold"),
        )
        until(lambda: printing(executed))
        host.kill()
        host.wait()
        until(lambda: set(OFF) <= set(executed))


def test_a_print_that_ends_well_needs_no_guard(tmp_path: Path) -> None:
    with served(tmp_path / "port", 500.0) as executed:
        assert ran(begin(tmp_path, "--guard", "0.1")) == 0
        Flag().wait(0.5)

    assert of_job(executed) == JOB


def test_a_guard_cannot_be_asked_for_less_than_nothing(tmp_path: Path) -> None:
    assert ran(begin(tmp_path, "--guard", "-1")) == 2
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
        machine_of(profile.printer), front_end_of(profile.printer), on_executed=executed.append, boots=False
    )
    printer: Any = Complaining(plain, executed)
    ready, stop, link = Flag(), Flag(), tmp_path / "port"
    thread = Thread(
        target=lambda: serve(lambda: printer, link, speed=20.0, stop=stop.is_set, ready=lambda _: ready.set())
    )
    thread.start()
    try:
        assert ready.wait(10.0)
        job = job_from(tmp_path / "job.gcode", profile).allowing(["cold"])
        with pytest.raises(PrintError, match="out of range"):
            print_job(job, profile, str(link), guard=guard)
        if cold:
            until(lambda: "M107" in executed)
        else:
            Flag().wait(0.3)
    finally:
        stop.set()
        thread.join()
    assert ("M104 S0" in executed) == cold
