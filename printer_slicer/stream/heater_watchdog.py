"""Watch heaters while the printer is silent, and build the commands that switch them off when the host ends.

The thermal protection of the firmware guards the heaters. The host can only warn about a silent printer, and switch off
heaters that it switched on. This covers a printer that stops answering, and a host that ends by itself or by a signal.
If the host is killed, a second process sends the commands. Nothing reaches the printer over a broken cable. Therefore
firmware without thermal protection causes a warning.

There is no clock or port here: times come in, events and bytes come out.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import inf
from typing import TYPE_CHECKING, Final

from printer_slicer.gcode.lexer import parse
from printer_slicer.gcode.state import find_heater_target
from printer_slicer.stream.events import (
    Accepted,
    Action,
    Busy,
    Identified,
    Message,
    ResendRequested,
    Temperature,
)
from printer_slicer.stream.framing import frame

if TYPE_CHECKING:
    from collections.abc import Iterable

    from printer_slicer.stream.events import Event

__all__ = ["HeaterAlarm", "HeaterWatchdog", "NoThermalProtection"]

_SILENCE: Final = 10.0
"""s without an answer or a report while heaters are on; busy firmware reports every 2 s."""

_REPORTED: Final = {"nozzle": "T", "bed": "B", "chamber": "C"}
"""Name of each heater in reports."""

_FROM_PRINTER: Final = (Accepted, Action, Busy, Identified, Message, ResendRequested, Temperature)
"""Events that come from the printer; all others come from the host."""

_MAY_HEAT: Final = (b"M", b"m", b"T", b"t", b"G10", b"g10")  # nearly all commands are moves
_OFF: Final = {"T": b"M104%s S0", "B": b"M140 S0", "C": b"M141 S0"}


@dataclass(frozen=True, slots=True)
class HeaterAlarm:
    """The printer was silent for `seconds` while heaters were on.

    Attributes:
        seconds: s of silence.
        heaters: name and target temperature, °C, of each heater that is on.
    """

    seconds: float
    heaters: tuple[tuple[str, float], ...]

    def __str__(self) -> str:
        warm = ", ".join(f"{name} {target:g} °C" for name, target in self.heaters)
        return f"no answer from the printer for {self.seconds:.0f} s while heaters are on ({warm}): check the printer"


@dataclass(frozen=True, slots=True)
class NoThermalProtection:
    """The firmware reports that it has no thermal protection."""

    firmware: str

    def __str__(self) -> str:
        name = self.firmware or "the firmware"
        return f"{name} has no thermal protection: nothing stops a heater fault; do not leave it unattended"


@dataclass(slots=True)
class HeaterWatchdog:
    """Heater watchdog of one connection.

    Call `sent` with each sent command, `heard` with each event (or `alive` for an answer without an event), and `check`
    once `due` has passed. `shutdown_lines` returns what to write when the host ends early.

    Attributes:
        silence: s of silence after which the alarm is raised, once per silence.
        targets: target temperature, °C, of each heater that is on, by its name in commands and reports.
    """

    silence: float = _SILENCE
    targets: dict[str, float] = field(default_factory=dict)
    _heard: float = -inf
    _raised: bool = False
    _used: set[str] = field(default_factory=set)
    _tool: str = ""

    def sent(self, command: bytes, now: float) -> None:
        """Record a command sent to the printer, without number and checksum."""
        word, values = parse(command)
        if word.startswith(b"T") and word[1:].isdigit():
            self._tool = word[1:].decode()
            return
        target = find_heater_target(word, values)
        if target is None:
            return
        heater = _REPORTED[target.heater]
        if heater == "T":
            heater += self._tool if target.tool is None else f"{target.tool}"
        if not self.targets:
            self._heard = max(self._heard, now)  # a cold printer may have been silent for long
        self._set_target(heater, target.celsius)

    def heard(self, event: Event, now: float) -> NoThermalProtection | None:
        """Process an event; return a warning if the firmware has no thermal protection."""
        if isinstance(event, _FROM_PRINTER):
            self.alive(now)
        if isinstance(event, Temperature):
            for reading in event.readings:
                if reading.target is not None:
                    self._set_target(self._heater_of_report(reading.name), reading.target)
        if isinstance(event, Identified) and ("THERMAL_PROTECTION", False) in event.capabilities:
            return NoThermalProtection(event.firmware)
        return None

    def alive(self, now: float) -> None:
        """Record that the printer answered."""
        self._heard = now
        self._raised = False

    @property
    def due(self) -> float:
        """Return when to call `check`, s; infinite while no heater is on, and after the alarm."""
        return self._heard + self.silence if self.targets and not self._raised else inf

    def check(self, now: float) -> HeaterAlarm | None:
        """Return the alarm if it is due."""
        if now < self.due:
            return None
        self._raised = True
        return HeaterAlarm(now - self._heard, tuple(sorted(self.targets.items())))

    def shutdown_lines(self, commands: Iterable[bytes] = (), *, anyway: bool = False) -> bytes:
        """Return the lines that switch the heaters off; empty if none was ever switched on.

        Heaters that were switched off before are included, because that line may have been lost.

        Args:
            commands: sent commands that were not passed to `sent`.
            anyway: include nozzle and bed in any case, because a macro of the printer may have switched them on.

        Returns:
            Lines without numbers, which most firmware accepts at any time, then the same lines with new numbers, for
            firmware that accepts no others. M108 comes first, because the printer reads nothing else while it waits
            for a heater.
        """
        for command in commands:
            if command.startswith(_MAY_HEAT):
                self.sent(command, self._heard)
        self._used |= {"T", "B"} if anyway else set()
        if not self._used:
            return b""
        lines = [b"M108"]
        for name in sorted(self._used):
            tool = b" T" + name[1:].encode() if name[1:] else b""
            lines.append(_OFF[name[0]] % tool if name[0] == "T" else _OFF.get(name[0], b"M104 S0"))
        lines.append(b"M107")
        counted = [frame(number, line) for number, line in enumerate([b"M110 N0", *lines])]
        return b"\n" + b"\n".join([*lines, *counted]) + b"\n"

    def _heater_of_report(self, name: str) -> str:
        """Return the heater that a report means: T is the active tool."""
        return "T" + self._tool if name == "T" else name

    def _set_target(self, heater: str, target: float) -> None:
        if target > 0:
            self.targets[heater] = target
            self._used.add(heater)
        else:
            self.targets.pop(heater, None)
