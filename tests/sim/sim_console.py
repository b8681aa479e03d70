"""A terminal connected to the simulated printer: it sends lines and records the replies with their times."""

from __future__ import annotations

from dataclasses import replace
from functools import reduce
from operator import xor

from printer_slicer.sim.firmwares import MARLIN_2_1, SimulatedFirmware
from printer_slicer.sim.machine import Machine
from printer_slicer.sim.printer import SimulatedPrinter

NIMBLE = replace(Machine(), first_move_delay=0.0)
"""A machine that starts to move at once, so that times are those of the moves."""

COLD_OK = replace(Machine(), coldest_extrusion=0.0)
"""A machine whose hotend is always warm enough."""


def numbered(number: int, command: str) -> str:
    """The line as a host sends it, with number and checksum."""
    body = f"N{number} {command}"
    return f"{body}*{reduce(xor, body.encode())}"


class Console:
    """Says lines to a printer under a clock of its own."""

    def __init__(
        self,
        firmware: SimulatedFirmware = MARLIN_2_1,
        machine: Machine | None = None,
        *,
        bytewise: bool = False,
    ) -> None:
        self.executed: list[str] = []
        self.printer = SimulatedPrinter(
            machine or Machine(), firmware, on_executed=self.executed.append, boots=False
        )
        self.now = 0.0
        self.bytewise = bytewise

    def say(self, *lines: str) -> list[str]:
        """Send lines all at once; what is answered before any time passes."""
        data = "".join(f"{line}\n" for line in lines).encode("latin-1")
        for piece in [bytes([byte]) for byte in data] if self.bytewise else [data]:
            self.printer.receive(piece, self.now)
        return self.heard()

    def wait(self, seconds: float) -> list[tuple[float, str]]:
        """What is said in the next seconds, each line with the seconds that had passed."""
        began, heard = self.now, []
        while (due := self.printer.wakeup()) is not None and due <= began + seconds:
            self.now = due
            heard += [(due - began, line) for line in self.heard()]
        self.now = began + seconds
        return heard + [(seconds, line) for line in self.heard()]

    def do(self, *lines: str, limit: float = 10_000.0) -> list[str]:
        """Send lines one after the other, each when the one before was answered with ok; all answers."""
        answers = []
        for line in lines:
            heard = self.say(line)
            end = self.now + limit
            while not any(answer.startswith("ok") for answer in heard):
                due = self.printer.wakeup()
                assert due is not None, f"{line!r} is never answered"
                assert due <= end, f"{line!r} is not answered in time"
                self.now = due
                heard += self.heard()
            answers += heard
        return answers

    def heard(self) -> list[str]:
        """What was said up to now and not heard yet."""
        return self.printer.send(self.now).decode("latin-1").splitlines()
