"""Serve the simulated printer on a pseudo-terminal at the speed of a real cable, with faults at given lines.

    python -m benchmarks.faulty_printer LINK JOB.gcode REPORT.json [--baud N] [--latency MS] [--fault NAME]

It runs until SIGTERM. Then it writes a report: how many lines of the job were executed, whether in order, and how fast.
"""

from __future__ import annotations

import argparse
import json
import signal
import sys
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from random import Random  # noqa: TID251 - seeded
from time import monotonic
from typing import Final

from printer_slicer.commands import split_gcode
from printer_slicer.motion.rules import MotionLimits
from printer_slicer.sim.firmwares import MARLIN_2_1
from printer_slicer.sim.link import Cable
from printer_slicer.sim.machine import Machine
from printer_slicer.sim.printer import SimulatedPrinter
from printer_slicer.sim.pty_server import serve
from printer_slicer.sim.statistics import Report

__all__ = ["FAULTS", "MACHINES", "PREPARED", "FaultyPrinter"]

QUICK: Final = MotionLimits(
    max_speed=(1000.0, 1000.0, 50.0, 500.0),
    max_acceleration=(1e5, 1e5, 1e4, 1e5),
    acceleration=1e5,
    travel_acceleration=1e5,
    retract_acceleration=1e5,
    corner="junction_deviation",
    junction_deviation=0.1,
    jerk=(10.0, 10.0, 0.4, 5.0),
    square_corner_velocity=5.0,
)
"""A machine so fast that only the cable limits the rate of lines."""

PART: Final = replace(
    QUICK,
    max_acceleration=(3000.0, 3000.0, 100.0, 5000.0),
    acceleration=3000.0,
    travel_acceleration=3000.0,
    retract_acceleration=3000.0,
    corner="jerk",
    jerk=(20.0, 20.0, 0.4, 5.0),
)
MACHINES: Final[dict[str, MotionLimits]] = {"quick": QUICK, "part": PART}

FAULTS: Final = ("none", "lost ok", "flipped bytes", "reset", "resend without ok", "garbage")
_AT: Final = (500, 800, 1100)  # numbers of answers, or of executed lines, at which a fault occurs
PREPARED: Final = 5  # commands before the chords: homing, modes, the move to the start
_FLIP: Final = 3e-4  # per byte to the printer
_NOISE: Final = b"\xff\xfe\x80\x00\xc3\x28~~\x1b[0m\n"


class FaultyPrinter:
    """A printer on a link that loses, changes and adds bytes, or that suffers a brown-out.

    Args:
        fault: one of `FAULTS`.
        machine: limits of the axes.
        job: commands that the printer should execute.
    """

    def __init__(self, fault: str, machine: MotionLimits, job: Sequence[bytes]) -> None:
        firmware = replace(MARLIN_2_1, ok_after_resend=fault != "resend without ok")
        self._fault = fault
        self._inner = SimulatedPrinter(
            Machine(limits=machine, coldest_extrusion=0.0), firmware, on_executed=self._note, boots=False
        )
        self._chance = Random(1)
        self._job = [command.decode("latin-1") for command in job]
        self._answers = 0
        self.in_order = self.strays = self.after_reset = 0
        self.first = self.last = 0.0
        self._reset = False

    def _note(self, text: str) -> None:
        if text.startswith(("M105", "M110", "M115", "M155", "M114", "M400", "M20", "M21", "M27", "M113")):
            return
        if self._reset:
            self.after_reset += 1
        elif self.in_order < len(self._job) and text == self._job[self.in_order]:
            self.last = monotonic()
            self.in_order += 1
            if self.in_order == PREPARED + 1:
                self.first = self.last
        else:
            self.strays += 1

    @property
    def unread_bytes(self) -> int:
        """Number of received bytes that the printer has not read."""
        return self._inner.unread_bytes

    def receive(self, data: bytes, now: float) -> None:
        """Take bytes from the host."""
        if self._fault in {"flipped bytes", "resend without ok"} and self.in_order > 1:
            data = bytes(
                byte ^ 1 << self._chance.randrange(8) if self._chance.random() < _FLIP else byte
                for byte in data
            )
        self._inner.receive(data, now)
        if self._fault == "reset" and not self._reset and self.in_order >= _AT[0]:
            self._reset = True
            self._inner.reset(now)

    def send(self, now: float) -> bytes:
        """Return bytes for the host."""
        said = self._inner.send(now)
        if b"ok" not in said or self._fault not in {"lost ok", "garbage"}:
            return said
        out = []
        for line in said.splitlines(keepends=True):
            self._answers += line.startswith(b"ok")
            hit = line.startswith(b"ok") and self._answers in _AT
            if hit and self._fault == "garbage":
                out.append(_NOISE)
            if not (hit and self._fault == "lost ok"):
                out.append(line)
        return b"".join(out)

    def wakeup(self) -> float | None:
        """Return when to call again."""
        return self._inner.wakeup()

    @property
    def has_unanswered_command(self) -> bool:
        """Return whether the printer executes commands."""
        return self._inner.has_unanswered_command

    def report(self) -> Report:
        """Return the printer's report."""
        return self._inner.report()


def main() -> int:
    """Serve until SIGTERM."""
    parser = argparse.ArgumentParser()
    parser.add_argument("link", type=Path)
    parser.add_argument("job", type=Path)
    parser.add_argument("report", type=Path)
    parser.add_argument("--baud", type=int, default=115_200)
    parser.add_argument("--latency", type=float, default=1.0, help="round-trip time, ms")
    parser.add_argument("--fault", choices=FAULTS, default="none")
    parser.add_argument("--machine", choices=sorted(MACHINES), default="quick")
    options = parser.parse_args()
    stopped: list[int] = []
    signal.signal(signal.SIGTERM, lambda number, _frame: stopped.append(number))
    commands = split_gcode(options.job.read_bytes()).commands
    printer = FaultyPrinter(options.fault, MACHINES[options.machine], commands)
    serve(
        lambda: printer,  # type: ignore[arg-type, return-value]
        options.link,
        connect=partial(Cable, baud=options.baud, latency=options.latency / 2000),
        stop=lambda: bool(stopped),
        ready=lambda name: print(name, flush=True),
    )
    machine_report = printer.report()
    facts = {
        "commands": len(commands),
        "in_order": printer.in_order,
        "strays": printer.strays,
        "after_reset": printer.after_reset,
        "seconds": printer.last - printer.first,
        "underruns": machine_report.underruns,
        "underrun_seconds": machine_report.underrun_seconds,
        "motion_seconds": machine_report.motion_seconds,
        "line_errors": machine_report.line_errors,
    }
    options.report.write_text(json.dumps(facts))
    return 0


if __name__ == "__main__":
    sys.exit(main())
