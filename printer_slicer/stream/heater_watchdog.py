"""Heaters that are on while nobody hears the printer: when to raise the alarm, and what the host says when it goes.

The firmware guards its heaters (thermal protection); the host can only say that it hears nothing any more, and switch
off what it switched on. Both ends of the cable may fail, so both are thought of: a printer that falls silent, and a
host that ends, by its own will or by a signal. Where the host was killed, a second process says it. Over a cut cable
nothing can be said: then the firmware is alone, which is why one without thermal protection is worth a warning.

No clock, no port: moments come in, events and bytes come out.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import inf
from typing import TYPE_CHECKING, Final

from printer_slicer.gcode.lexer import parse
from printer_slicer.gcode.state import heater_target
from printer_slicer.stream.events import (
    Accepted,
    Action,
    Busy,
    Identified,
    Message,
    ResendAsked,
    Temperature,
)
from printer_slicer.stream.framing import frame

if TYPE_CHECKING:
    from collections.abc import Iterable

    from printer_slicer.stream.events import Event

__all__ = ["HeaterAlarm", "HeaterWatchdog", "NoThermalProtection"]

_SILENCE: Final = 10.0
"""s without an answer or a report while heaters are on; firmware that is busy says so every 2 s."""

_REPORTED: Final = {"nozzle": "T", "bed": "B", "chamber": "C"}
"""Heater to its name in reports."""

_FROM_PRINTER: Final = (Accepted, Action, Busy, Identified, Message, ResendAsked, Temperature)
"""Events that show that the printer lives; all others are the host's own."""

_MAY_HEAT: Final = (b"M", b"m", b"T", b"t", b"G10", b"g10")  # nearly all commands are moves
_OFF: Final = {"T": b"M104%s S0", "B": b"M140 S0", "C": b"M141 S0"}


@dataclass(frozen=True, slots=True)
class HeaterAlarm:
    """The printer was silent for `seconds` while these heaters were on: name and °C as they were wanted."""

    seconds: float
    heaters: tuple[tuple[str, float], ...]

    def __str__(self) -> str:
        warm = ", ".join(f"{name} {target:g} °C" for name, target in self.heaters)
        return f"no answer and no report for {self.seconds:.0f} s while heaters are on ({warm}): look at the printer"


@dataclass(frozen=True, slots=True)
class NoThermalProtection:
    """The firmware says that it does not guard its heaters."""

    firmware: str

    def __str__(self) -> str:
        name = self.firmware or "the firmware"
        return f"{name} has no thermal protection: a heater that runs away is stopped by nobody; stay with the printer"


@dataclass(slots=True)
class HeaterWatchdog:
    """Watches over one connection.

    Call `sent` with each command that goes out, `heard` with each event (or `alive` for an answer that makes none), and
    `check` when `due` has come. `shutdown_lines` is what to write when the host ends early.

    Attributes:
        silence: s after which the alarm is raised, once for each silence.
        targets: heater as commands and reports name it -> °C wanted, of those that are on.
    """

    silence: float = _SILENCE
    targets: dict[str, float] = field(default_factory=dict)
    _heard: float = -inf
    _raised: bool = False
    _used: set[str] = field(default_factory=set)
    _tool: str = ""

    def sent(self, command: bytes, now: float) -> None:
        """A command goes to the printer, without number and checksum."""
        word, values = parse(command)
        if word.startswith(b"T") and word[1:].isdigit():
            self._tool = word[1:].decode()
            return
        target = heater_target(word, values)
        if target is None:
            return
        heater = _REPORTED[target.heater]
        if heater == "T":
            heater += self._tool if target.tool is None else f"{target.tool}"
        if not self.targets:
            self._heard = max(self._heard, now)  # a printer that was cold may have been silent for long
        self._want(heater, target.celsius)

    def heard(self, event: Event, now: float) -> NoThermalProtection | None:
        """Something happened; a warning if it gives reason for one."""
        if isinstance(event, _FROM_PRINTER):
            self.alive(now)
        if isinstance(event, Temperature):
            for reading in event.readings:
                if reading.target is not None:
                    self._want(self._known(reading.name), reading.target)
        if isinstance(event, Identified) and ("THERMAL_PROTECTION", False) in event.capabilities:
            return NoThermalProtection(event.firmware)
        return None

    def alive(self, now: float) -> None:
        """The printer answered."""
        self._heard = now
        self._raised = False

    @property
    def due(self) -> float:
        """When to call `check`, s; infinite while nothing is on, and after the alarm."""
        return self._heard + self.silence if self.targets and not self._raised else inf

    def check(self, now: float) -> HeaterAlarm | None:
        """The alarm, if it is time for it."""
        if now < self.due:
            return None
        self._raised = True
        return HeaterAlarm(now - self._heard, tuple(sorted(self.targets.items())))

    def shutdown_lines(self, commands: Iterable[bytes] = (), *, anyway: bool = False) -> bytes:
        """What to write when the host ends before the print, empty if nothing was ever switched on.

        What was switched off again is named too: that line may be one of those that got lost.

        Args:
            commands: that were sent besides those told by `sent`.
            anyway: nozzle and bed are named whatever was sent: a macro of the printer may have switched them on.

        Returns:
            Lines without numbers, which most firmware takes at any time, and the same once more behind a new count, for
            firmware that takes no others; twice does no harm. A wait for heat is broken off first (M108), or the
            printer would not read the rest before it is warm.
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

    def _known(self, name: str) -> str:
        """A report says T for the tool in use; where tools were named, T is one of them."""
        return "T" + self._tool if name == "T" else name

    def _want(self, heater: str, target: float) -> None:
        if target > 0:
            self.targets[heater] = target
            self._used.add(heater)
        else:
            self.targets.pop(heater, None)
