"""The printer behind a pseudo-terminal, spoken to through pyserial as any host would."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from math import inf
from pathlib import Path
from threading import Event, Thread

import pytest
import serial

from printer_slicer.errors import PortError
from printer_slicer.sim.link import Cable
from printer_slicer.sim.machine import Machine
from printer_slicer.sim.printer import SimulatedPrinter
from printer_slicer.sim.pty_server import serve
from printer_slicer.sim.statistics import Report
from tests.waiting import LAST_RESORT

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="there are no pseudo-terminals")


@contextmanager
def served(link: Path, *, speed: float = 1.0, baud: int | None = None) -> Iterator[list[Report]]:
    """A printer under the name `link` for as long as the block runs; the report is in the list afterwards."""
    stop, ready = Event(), Event()
    reports: list[Report] = []

    def run() -> None:
        machine = replace(Machine(), coldest_extrusion=0.0)
        report = serve(
            lambda: SimulatedPrinter(machine, boots=False),
            link,
            speed=speed,
            connect=partial(Cable, baud=baud),
            stop=stop.is_set,
            ready=lambda _: ready.set(),
        )
        reports.append(report)

    thread = Thread(target=run)
    thread.start()
    try:
        assert ready.wait(LAST_RESORT)
        yield reports
    finally:
        stop.set()
        thread.join(LAST_RESORT)
    assert not thread.is_alive()


def ask(port: serial.Serial, line: str) -> list[str]:
    """Send a line; the answers up to the ok."""
    port.write(f"{line}\n".encode())
    answers: list[str] = []
    while not (answers and answers[-1].startswith("ok")):
        answer = port.readline().decode()
        assert answer, f"no answer to {line!r}"
        answers.append(answer.strip())
    return answers


def test_a_host_talks_to_the_printer_through_the_link(tmp_path: Path) -> None:
    link = tmp_path / "printer"
    with served(link) as reports, serial.Serial(str(link), 115_200, timeout=LAST_RESORT) as port:
        assert ask(port, "M118 hello") == ["hello", "ok"]
        assert ask(port, "M105") == ["ok T:21.00 /0.00 B:21.00 /0.00 @:0 B@:0"]

    assert reports[0].lines == 2
    assert not link.is_symlink()


def test_the_host_may_close_the_port_and_open_it_again(tmp_path: Path) -> None:
    link = tmp_path / "printer"
    with served(link) as reports:
        for name in ("one", "two", "three"):
            with serial.Serial(str(link), 115_200, timeout=LAST_RESORT) as port:
                assert ask(port, f"M118 {name}") == [name, "ok"]

    assert reports[0].lines == 3


@pytest.mark.parametrize("speed", [0.0, inf])
def test_waiting_is_skipped_on_request(tmp_path: Path, speed: float) -> None:
    link = tmp_path / "printer"
    with served(link, speed=speed) as reports, serial.Serial(str(link), 115_200, timeout=LAST_RESORT) as port:
        ask(port, "G28")
        ask(port, "M109 S200")
        for n in range(60):
            ask(port, f"G1 X{n} F60")
        ask(port, "M400")
        assert ask(port, "G4 S3600")[-1] == "ok"

    assert reports[0].motion_seconds == pytest.approx(59.0, rel=0.01)
    assert reports[0].dwell_seconds == pytest.approx(3600.0, rel=0.01)
    assert reports[0].heating_seconds > 60.0


def test_simulated_time_can_run_faster_and_bytes_at_their_pace(tmp_path: Path) -> None:
    link = tmp_path / "printer"
    with (
        served(link, speed=200.0, baud=9600) as reports,
        serial.Serial(str(link), timeout=LAST_RESORT) as port,
    ):
        assert ask(port, "G4 S10")[-1] == "ok"

    assert reports[0].dwell_seconds == pytest.approx(10.0)


def test_an_old_link_is_replaced_but_no_file(tmp_path: Path) -> None:
    old, file = tmp_path / "old", tmp_path / "file"
    old.symlink_to("/nowhere")
    file.write_text("precious")

    with served(old):
        assert str(old.readlink()).startswith("/dev/")
    with pytest.raises(PortError, match="is not a symbolic link"):
        serve(lambda: SimulatedPrinter(Machine()), file)
    with pytest.raises(PortError, match="cannot create the link"):
        serve(lambda: SimulatedPrinter(Machine()), tmp_path / "no folder" / "link")

    assert file.read_text() == "precious"


def test_a_link_that_somebody_else_took_over_is_left_alone(tmp_path: Path) -> None:
    link = tmp_path / "printer"
    with served(link):
        link.unlink()
        link.symlink_to("/dev/null")

    assert str(link.readlink()) == "/dev/null"
