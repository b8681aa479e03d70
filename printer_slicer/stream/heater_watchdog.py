"""Watch heaters while the printer is silent, and build the commands that switch them off when the host ends.

The thermal protection of the firmware guards the heaters. The host can only warn about a silent printer, and switch off
heaters that it switched on. This covers a printer that stops answering, and a host that ends by itself or by a signal.
If the host is killed, a second process sends the commands. Nothing reaches the printer over a broken cable. Therefore
firmware without thermal protection causes a warning.

There is no clock or port here: times come in, events and bytes come out.
"""

from __future__ import annotations

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
from printer_slicer.values import Struct, field

if TYPE_CHECKING:
    from collections.abc import Iterable

    from printer_slicer.stream.events import Event

__all__ = ["HeaterAlarm", "HeaterWatchdog", "NoThermalProtection"]

_MAX_SILENCE: Final = 10.0
"""Time without an answer or a report while heaters are on, s; busy firmware reports every 2 s."""

_REPORT_NAMES: Final = {"nozzle": "T", "bed": "B", "chamber": "C"}
"""Name of each heater in reports."""

_PRINTER_EVENTS: Final = (Accepted, Action, Busy, Identified, Message, ResendRequested, Temperature)
"""Events that come from the printer; all other events come from the host."""

_HEATING_PREFIXES: Final = (b"M", b"m", b"T", b"t", b"G10", b"g10")  # nearly all commands are moves
_OFF_COMMANDS: Final = {"T": b"M104%s S0", "B": b"M140 S0", "C": b"M141 S0"}


class HeaterAlarm(Struct, frozen=True):
    """Alarm: the printer was silent for `seconds` while heaters were on.

    Attributes:
        seconds: s of silence.
        heaters: name and target temperature, °C, of each heater that is on.
    """

    seconds: float
    heaters: tuple[tuple[str, float], ...]

    def __str__(self) -> str:
        heated = ", ".join(f"{name} {target:g} °C" for name, target in self.heaters)
        return f"no answer from the printer for {self.seconds:.0f} s while heaters are on ({heated}): check the printer"


class NoThermalProtection(Struct, frozen=True):
    """Warning: the firmware reports that it has no thermal protection."""

    firmware: str

    def __str__(self) -> str:
        name = self.firmware or "the firmware"
        return f"{name} has no thermal protection against heater faults: do not leave the printer unattended"


class HeaterWatchdog(Struct):
    """Raises an alarm if the printer stays silent while heaters are on.

    Call `on_sent` with each sent command, `on_event` with each event (or `on_answer` for an answer without an
    event), and `check_silence` once `alarm_at` has passed. `build_shutdown_lines` returns what to write when the
    host ends early.

    Attributes:
        silence: s of silence after which the alarm is raised; it is raised again only after an answer.
        targets: target temperature, °C, of each heater that is on, by its name in commands and reports.
    """

    silence: float = _MAX_SILENCE
    targets: dict[str, float] = field(default_factory=dict)
    _last_answer_at: float = -inf
    _has_alarmed: bool = False
    _heated: set[str] = field(default_factory=set)
    _active_tool: str = ""

    def on_sent(self, command: bytes, now: float) -> None:
        """Record a command that was sent to the printer; `command` has no line number and no checksum."""
        word, values = parse(command)
        if word.startswith(b"T") and word[1:].isdigit():
            self._active_tool = word[1:].decode()
            return
        target = find_heater_target(word, values)
        if target is None:
            return
        heater = _REPORT_NAMES[target.heater]
        if heater == "T":
            heater += self._active_tool if target.tool is None else f"{target.tool}"
        if not self.targets:
            self._last_answer_at = max(
                self._last_answer_at, now
            )  # a cold printer may have been silent for long
        self._set_target(heater, target.celsius)

    def on_event(self, event: Event, now: float) -> NoThermalProtection | None:
        """Process an event of the streamer; return a warning if the firmware has no thermal protection."""
        if isinstance(event, _PRINTER_EVENTS):
            self.on_answer(now)
        if isinstance(event, Temperature):
            for reading in event.readings:
                if reading.target is not None:
                    self._set_target(self._resolve_heater_name(reading.name), reading.target)
        if isinstance(event, Identified) and ("THERMAL_PROTECTION", False) in event.capabilities:
            return NoThermalProtection(event.firmware)
        return None

    def on_answer(self, now: float) -> None:
        """Record that the printer answered at `now`, s."""
        self._last_answer_at = now
        self._has_alarmed = False

    @property
    def alarm_at(self) -> float:
        """Return when the alarm is due, s; infinite if no heater is on or the alarm was raised already."""
        return self._last_answer_at + self.silence if self.targets and not self._has_alarmed else inf

    def check_silence(self, now: float) -> HeaterAlarm | None:
        """Return an alarm if the printer has been silent for too long; at most one until it answers."""
        if now < self.alarm_at:
            return None
        self._has_alarmed = True
        return HeaterAlarm(now - self._last_answer_at, tuple(sorted(self.targets.items())))

    def build_shutdown_lines(self, commands: Iterable[bytes] = (), *, assume_heated: bool = False) -> bytes:
        """Return the lines that switch the heaters off; empty if no heater was ever switched on.

        Heaters that were already switched off are included, because the command for it may have been lost.

        Args:
            commands: sent commands that were not passed to `on_sent`.
            assume_heated: include nozzle and bed in any case, because a macro of the printer may have switched them on.

        Returns:
            Lines without numbers, which most firmware accepts at any time, then the same lines with new numbers, for
            firmware that accepts only numbered lines. M108 comes first, because the printer reads nothing else while it
            waits for a heater.
        """
        for command in commands:
            if command.startswith(_HEATING_PREFIXES):
                self.on_sent(command, self._last_answer_at)
        self._heated |= {"T", "B"} if assume_heated else set()
        if not self._heated:
            return b""
        lines = [b"M108"]
        for name in sorted(self._heated):
            tool = b" T" + name[1:].encode() if name[1:] else b""
            lines.append(
                _OFF_COMMANDS[name[0]] % tool if name[0] == "T" else _OFF_COMMANDS.get(name[0], b"M104 S0")
            )
        lines.append(b"M107")
        numbered = [frame(number, line) for number, line in enumerate([b"M110 N0", *lines])]
        return b"\n" + b"\n".join([*lines, *numbered]) + b"\n"

    def _resolve_heater_name(self, name: str) -> str:
        """Return the name of a reported heater with its tool number; T stands for the active tool."""
        return "T" + self._active_tool if name == "T" else name

    def _set_target(self, heater: str, target: float) -> None:
        """Record the target temperature of a heater, °C."""
        if target > 0:
            self.targets[heater] = target
            self._heated.add(heater)
        else:
            self.targets.pop(heater, None)
