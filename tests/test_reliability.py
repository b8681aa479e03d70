"""Every row of the reliability matrix on every firmware, and once over a device of the system.

Few seeds and short jobs: `python -m benchmarks.reliability` has the many and the long.
"""

from __future__ import annotations

import threading
import time
from contextlib import closing
from random import Random  # noqa: TID251 - seeded
from typing import TYPE_CHECKING

import pytest

from benchmarks.reliability import ROWS, main, suits, trial_of
from benchmarks.wire_lab import Setup, Trial, job_of
from printer_slicer.firmware import WIRE_DIALECTS
from printer_slicer.sim.firmwares import SIMULATED_FIRMWARES
from printer_slicer.sim.pty_server import serve
from printer_slicer.stream.events import Halted, Identified
from printer_slicer.stream.serial_port import open_port
from tests.effort import crossed
from tests.waiting import LAST_RESORT

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from printer_slicer.sim.printer import SimulatedPrinter
    from printer_slicer.stream.serial_port import SerialPort

SEEDS = 2
LINES = 150
CASES = [(row, firmware) for row in ROWS for firmware in suits(row)]
"""Each is tried with one of the seeds in check, with all of them in thorough."""


@pytest.mark.parametrize(("case", "seed"), crossed(CASES, range(SEEDS)))
def test_lines_are_executed_once_in_order_or_the_print_ends_with_a_reason(
    case: tuple[str, str], seed: int
) -> None:
    row, firmware = case
    _, verdict = trial_of(row, firmware, seed, LINES)

    assert not verdict.startswith("WRONG"), (case, verdict)


def test_every_dialect_of_the_host_is_spoken_by_a_simulated_firmware() -> None:
    spoken = set()
    for firmware in SIMULATED_FIRMWARES:
        trial, _ = trial_of("clean, 115200 baud", firmware, 0, 60)
        spoken |= {event.dialect for event in trial.events if isinstance(event, Identified)}

    assert spoken == set(WIRE_DIALECTS)


def test_the_command_prints_a_row_for_each_fault(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--seeds", "2", "--lines", "80", "--row", "oks lost", "--firmware", "klipper"]) == 0

    assert "| oks lost | 1 | 2 | 0 | 0 | 0 |" in capsys.readouterr().out


# Over a device of the system.

FASTER = 20.0
"""Seconds of host and printer in one of the clock on the wall."""


class Desk:
    """The host's end of a pseudo-terminal: a port with the faults of a row, and a clock that runs faster."""

    def __init__(self, port: SerialPort, trial: Trial) -> None:
        self._port = port
        self._fault = trial.setup.fault or (lambda data, _: data)
        self._began = time.monotonic()

    def now(self) -> float:
        return (time.monotonic() - self._began) * FASTER

    def write(self, data: bytes) -> None:
        self._port.write(self._fault(data, "to printer"))

    def read(self, timeout: float) -> bytes:
        data = self._port.read(timeout / FASTER)
        return self._fault(data, "to host") if data else b""


class Errands:
    """What the host's thread wants of the printer, done in the printer's own thread."""

    def __init__(self) -> None:
        self.ended = threading.Event()
        self._wanted: list[Callable[[SimulatedPrinter], None]] = []
        self._printer: list[SimulatedPrinter] = []

    def has(self, printer: SimulatedPrinter) -> SimulatedPrinter:
        self._printer.append(printer)
        return printer

    def stop(self) -> bool:
        while self._wanted:
            self._wanted.pop(0)(self._printer[0])
        return self.ended.is_set()

    def reset(self, _: float) -> None:
        self._wanted.append(lambda printer: printer.reset(printer._state.now))

    def hang(self, seconds: float, _: float) -> None:
        self._wanted.append(lambda printer: printer.hang(seconds, printer._state.now))


@pytest.mark.parametrize("row", ROWS, ids=lambda text: text.replace(" ", "-"))
def test_it_is_so_over_a_device_of_the_system(row: str, tmp_path: Path) -> None:
    names = suits(row)
    chance = Random(row)
    firmware = names[list(ROWS).index(row) % len(names)]
    setup = ROWS[row].make(
        chance, Setup(SIMULATED_FIRMWARES[firmware], job_of(chance, 120), assumed_baud=None)
    )
    trial, errands, ready = Trial(setup), Errands(), threading.Event()
    server = threading.Thread(
        target=serve,
        args=(lambda: errands.has(trial.printer), tmp_path / "printer"),
        kwargs={"speed": 0.0, "stop": errands.stop, "ready": lambda _: ready.set()},
    )
    server.start()
    assert ready.wait(LAST_RESORT)
    try:
        with closing(open_port(str(tmp_path / "printer"))) as port:
            trial.port = Desk(port, trial)  # type: ignore[assignment]
            real, trial.printer = trial.printer, errands  # type: ignore[assignment]
            trial.print_over_port(longest_wait=1.0)
    finally:
        errands.ended.set()
        server.join(LAST_RESORT)
    trial.printer = real

    verdict = trial.verdict()
    if isinstance(trial.end, Halted):
        assert any(part in verdict for part in ROWS[row].may_stop), verdict
    assert not verdict.startswith("WRONG"), verdict
