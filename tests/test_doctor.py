"""What keeps a printer from being printed to: the port, the printer on a virtual clock, the command."""

from __future__ import annotations

import json
import os
import pty
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from random import Random  # noqa: TID251 - seeded
from threading import Event, Thread

import pytest

from printer_slicer.doctor import PortCheck, PrinterDiagnosis, diagnose_printer, read_port_state
from printer_slicer.sim.firmwares import MARLIN_2_1, MARLIN_2_1_ADVANCED
from printer_slicer.sim.link import CableNoise, VirtualPort
from printer_slicer.sim.machine import Machine
from printer_slicer.sim.printer import SimulatedPrinter
from printer_slicer.sim.pty_server import serve
from tests.cli.command_line import is_message, typed
from tests.waiting import LAST_RESORT


def seen(
    *, baud: int = 115_200, latency: float = 0.001, advanced: bool = False, flip: float = 0.0
) -> PrinterDiagnosis:
    printer = SimulatedPrinter(Machine(), MARLIN_2_1_ADVANCED if advanced else MARLIN_2_1)
    damage = CableNoise(Random(3), flip=flip) if flip else None
    port = VirtualPort(printer, baud=baud, latency=latency, noise=damage)
    return diagnose_printer(port, port.now, baud=baud)


def by_name(found: PrinterDiagnosis) -> dict[str, PortCheck]:
    return {check.name: check for check in found.run_checks()}


# The printer


def test_a_good_printer_is_told_as_such() -> None:
    found = seen()
    checks = by_name(found)

    assert "Marlin" in found.firmware
    assert {check.state for check in checks.values()} == {"good"}
    assert checks["thermal protection"].what == "enabled"
    assert dict(found.temperatures) == {"T": 21.0, "B": 21.0}
    assert found.link.resends == 0


@pytest.mark.parametrize("baud", [57_600, 115_200, 250_000])
@pytest.mark.parametrize("latency", [0.0005, 0.002, 0.008])
def test_answers_and_rates_are_those_of_the_cable(baud: int, latency: float) -> None:
    found = seen(baud=baud, latency=latency)
    byte = 10 / baud
    line = 1 / found.wire
    there_and_back = line + 3 * byte + 2 * latency

    assert line == pytest.approx(38 * byte, rel=0.03)
    short = 2.5 * byte  # numbers begin with one digit
    assert found.answer == pytest.approx(there_and_back, abs=short)
    assert found.answer_95 == pytest.approx(there_and_back, abs=short)
    assert found.lines_per_second == pytest.approx(min(found.wire, 2 / there_and_back), rel=0.05)


def test_a_late_answer_has_a_remedy() -> None:
    checks = by_name(seen(baud=250_000, latency=0.008))

    assert checks["answers"].state == "warn"
    assert "latency timer" in checks["answers"].remedy
    assert checks["line rate"].state == "warn"
    assert "--set printer.link_lines_per_second=" in checks["line rate"].remedy
    assert "--link 250000 --latency 16" in checks["line rate"].remedy


def test_a_bad_cable_is_told() -> None:
    checks = by_name(seen(flip=4e-4))

    assert checks["errors"].state == "warn"
    assert "cable" in checks["errors"].remedy


def test_nothing_is_moved_or_heated() -> None:
    printer = SimulatedPrinter(Machine(), MARLIN_2_1)
    port = VirtualPort(printer, baud=115_200, latency=0.001)
    diagnose_printer(port, port.now, baud=115_200)
    report = printer.report()

    assert (report.motion_seconds, report.filament_fed, report.heating_seconds) == (0, 0, 0)
    assert report.peak_hotend == pytest.approx(21.0)
    assert report.n_violations == 0
    assert report.dwell_seconds == 0


class _Silent:
    """A port behind which nobody is."""

    def __init__(self) -> None:
        self.now = 0.0

    def write(self, data: bytes) -> None:
        assert data

    def read(self, timeout: float) -> bytes:
        self.now += timeout
        return b""

    def close(self) -> None:
        return


def test_nobody_behind_the_port() -> None:
    port = _Silent()
    checks = list(diagnose_printer(port, lambda: port.now, baud=115_200).run_checks())

    assert [(check.name, check.state) for check in checks] == [("printer", "bad")]
    assert "--baud" in checks[0].remedy
    assert port.now < 20


def test_firmware_without_thermal_protection_is_bad() -> None:
    found = replace(seen(), capabilities=(("THERMAL_PROTECTION", False), ("EMERGENCY_PARSER", True)))
    checks = by_name(found)

    assert checks["thermal protection"].state == "bad"
    assert "EMERGENCY_PARSER" in checks["capabilities"].what


# The port


def test_a_port_that_is_not_there(tmp_path: Path) -> None:
    (check,) = read_port_state(str(tmp_path / "none")).run_checks()

    assert (check.name, check.state) == ("port", "bad")


def test_a_file_is_no_port(tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.touch()
    (check,) = read_port_state(str(file)).run_checks()

    assert check.state == "bad"
    assert "not a serial port" in check.what


@pytest.fixture
def terminal() -> Iterator[str]:
    master, slave = pty.openpty()
    yield os.ttyname(slave)
    os.close(master)
    os.close(slave)


def test_a_link_is_followed_to_its_device(tmp_path: Path, terminal: str) -> None:
    link = tmp_path / "printer"
    link.symlink_to(terminal)
    state = read_port_state(str(link))

    assert (state.exists, state.is_port, state.device) == (True, True, terminal)
    assert state.group
    assert [check.state for check in state.run_checks()] == ["good"] * 3


@pytest.mark.parametrize(("timer", "judged"), [("1\n", "good"), ("16\n", "warn"), ("?\n", None)])
def test_the_latency_timer(tmp_path: Path, timer: str, judged: str | None) -> None:
    """The system's own files, in another place."""
    folder = tmp_path / "null" / "device"
    folder.mkdir(parents=True)
    (folder / "latency_timer").write_text(timer)
    checks = {check.name: check for check in read_port_state("/dev/null", ttys=tmp_path).run_checks()}

    assert checks["latency timer"].state == judged if judged else "latency timer" not in checks


def test_who_holds_it_is_named(tmp_path: Path) -> None:
    for pid, name, device in ((31, "ModemManager", "/dev/null"), (32, "other", "/dev/zero")):
        (tmp_path / str(pid) / "fd").mkdir(parents=True)
        (tmp_path / str(pid) / "fd" / "3").symlink_to(device)
        (tmp_path / str(pid) / "comm").write_text(f"{name}\n")
    state = read_port_state("/dev/null", proc=tmp_path)
    (held,) = [check for check in state.run_checks() if check.name == "in use"]

    assert state.holders == ((31, "ModemManager"),)
    assert held.state == "bad"
    assert "disable --now ModemManager" in held.remedy


def test_a_port_that_may_not_be_opened() -> None:
    state = replace(read_port_state("/dev/null"), may_open=False, group="dialout", in_group=False)
    (check,) = [check for check in state.run_checks() if check.name == "permission"]

    assert check.state == "bad"
    assert "usermod -aG dialout" in check.remedy
    again = replace(state, in_group=True)
    assert (
        "Log out and in again" in next(one for one in again.run_checks() if one.name == "permission").remedy
    )


# The command


@contextmanager
def served(link: Path) -> Iterator[None]:
    stop, ready = Event(), Event()
    thread = Thread(
        target=lambda: serve(
            lambda: SimulatedPrinter(Machine(), boots=False),
            link,
            stop=stop.is_set,
            ready=lambda _: ready.set(),
        )
    )
    thread.start()
    try:
        assert ready.wait(LAST_RESORT)
        yield
    finally:
        stop.set()
        thread.join(LAST_RESORT)


@pytest.mark.skipif(sys.platform == "win32", reason="there are no pseudo-terminals")
def test_a_printer_behind_a_real_terminal(tmp_path: Path) -> None:
    link = tmp_path / "printer"
    with served(link):
        told = typed("doctor", link)
        facts = json.loads(typed("doctor", link, "--json").out)

    assert (told.code, told.err) == (0, "")
    assert "Marlin" in told.out
    assert facts["ok"] is True
    assert facts["printer"]["lines_per_second"] > 50
    assert {"port", "permission", "in use", "printer", "line rate"} <= {
        one["name"] for one in facts["checks"]
    }


def test_what_is_in_the_way_is_said_with_its_remedy(tmp_path: Path) -> None:
    done = typed("doctor", tmp_path / "none")

    assert done.code == 4
    assert is_message(done, "not ready to print; failed: port", "listed above")
    assert "does not exist" in done.out
    assert "Check cable" in done.out
    assert json.loads(typed("doctor", tmp_path / "none", "--json").out)["ok"] is False


def test_without_a_port_all_are_looked_at_and_none_is_asked() -> None:
    facts = json.loads(typed("doctor", "--json").out)

    assert isinstance(facts["ports"], list)
    assert typed("doctor").code == 0
