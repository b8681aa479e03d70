"""Commands for a running print, and how they are typed.

pause [now] [cold] [here]     pause after the planned moves or at once; let the nozzle cool down; do not park
resume, cancel, stop          stop halts the printer like its emergency button
object NAME                   cancel one object on the plate
speed PERCENT, flow PERCENT   factors on the values in the file
nozzle C, bed C, fan PERCENT
babystep MM                   move the nozzle up, or down if negative
say COMMAND                   send one line of G-code
answer N                      press a button of the printer's prompt
status
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import isfinite
from typing import Final, TypeAlias

from printer_slicer.errors import UsageError

__all__ = [
    "WORDS",
    "Answer",
    "BabyStep",
    "Cancel",
    "CancelObject",
    "Flow",
    "Pause",
    "PrintCommand",
    "Resume",
    "Say",
    "SetFan",
    "SetTemperature",
    "Speed",
    "Status",
    "Stop",
    "parse_command",
]


@dataclass(frozen=True, slots=True)
class Pause:
    """Pause the print.

    Attributes:
        now: stop within the planned moves, not after them.
        cold: let the nozzle cool down; the bed stays warm, so that the part does not come loose.
        park: retract, lift, and move off the part.
    """

    now: bool = False
    cold: bool = False
    park: bool = True


@dataclass(frozen=True, slots=True)
class Resume:
    """Resume after a pause at the same position and with the same settings."""


@dataclass(frozen=True, slots=True)
class Cancel:
    """Cancel the job and run the end script."""


@dataclass(frozen=True, slots=True)
class CancelObject:
    """Cancel one object on the plate, by its name or number."""

    name: str


@dataclass(frozen=True, slots=True)
class Speed:
    """Set the speed, in percent of the speeds in the file."""

    percent: float


@dataclass(frozen=True, slots=True)
class Flow:
    """Set the flow, in percent of the flow in the file."""

    percent: float


@dataclass(frozen=True, slots=True)
class SetTemperature:
    """Set a target temperature, °C; `heater` is nozzle or bed."""

    heater: str
    celsius: float


@dataclass(frozen=True, slots=True)
class SetFan:
    """Set the part fan, in percent, until the file changes it."""

    percent: float


@dataclass(frozen=True, slots=True)
class BabyStep:
    """Move the nozzle and all following moves up by `mm`, down if negative."""

    mm: float


@dataclass(frozen=True, slots=True)
class Say:
    """Send one line of G-code."""

    gcode: str


@dataclass(frozen=True, slots=True)
class Answer:
    """Press a button of the printer's prompt, counted from 0."""

    choice: int


@dataclass(frozen=True, slots=True)
class Status:
    """Return the status."""


@dataclass(frozen=True, slots=True)
class Stop:
    """Halt the printer at once with M112."""


PrintCommand: TypeAlias = (
    Pause
    | Resume
    | Cancel
    | CancelObject
    | Speed
    | Flow
    | SetTemperature
    | SetFan
    | BabyStep
    | Say
    | Answer
    | Status
    | Stop
)

_PAUSE_WORDS: Final = frozenset({"now", "cold", "here"})


def _pause(rest: str) -> PrintCommand:
    words = set(rest.split())
    if unknown := words - _PAUSE_WORDS:
        raise UsageError(f"unknown option {min(unknown)!r} of pause", remedy="Use pause [now] [cold] [here]")
    return Pause(now="now" in words, cold="cold" in words, park="here" not in words)


def _bare(build: Callable[[], PrintCommand]) -> Callable[[str], PrintCommand]:
    def read(rest: str) -> PrintCommand:
        if rest:
            raise UsageError(f"unexpected argument {rest!r}", remedy="Remove it")
        return build()

    return read


def _text(build: Callable[[str], PrintCommand], what: str) -> Callable[[str], PrintCommand]:
    def read(rest: str) -> PrintCommand:
        if not rest or not rest.isprintable():
            raise UsageError(f"expected {what}", remedy="Use one line without control characters")
        return build(rest)

    return read


def _value(
    build: Callable[[float], PrintCommand], low: float, high: float, unit: str
) -> Callable[[str], PrintCommand]:
    def read(rest: str) -> PrintCommand:
        try:
            value = float(rest)
        except ValueError:
            value = float("nan")
        if not isfinite(value) or not low <= value <= high:
            raise UsageError(
                f"{rest or 'nothing'}: expected {low:g} to {high:g} {unit}".rstrip(),
                remedy="Enter a number in this range",
            )
        return build(value)

    return read


WORDS: Final[Mapping[str, Callable[[str], PrintCommand]]] = {
    "pause": _pause,
    "resume": _bare(Resume),
    "cancel": _bare(Cancel),
    "stop": _bare(Stop),
    "status": _bare(Status),
    "object": _text(CancelObject, "the name or number of an object on the plate"),
    "say": _text(Say, "a line of G-code"),
    "speed": _value(Speed, 10, 500, "%"),
    "flow": _value(Flow, 10, 300, "%"),
    "fan": _value(SetFan, 0, 100, "%"),
    "nozzle": _value(lambda value: SetTemperature("nozzle", value), 0, 500, "°C"),
    "bed": _value(lambda value: SetTemperature("bed", value), 0, 200, "°C"),
    "babystep": _value(BabyStep, -2, 2, "mm"),
    "answer": _value(lambda value: Answer(int(value)), 0, 99, ""),
}
"""Parser of the arguments of each command, by its first word."""


def parse_command(line: str) -> PrintCommand:
    """Parse a command line.

    Raises:
        UsageError: it is not a valid command.
    """
    word, _, rest = line.strip().partition(" ")
    if word not in WORDS:
        raise UsageError(f"unknown command {word!r}", remedy="Use one of " + ", ".join(WORDS))
    return WORDS[word](rest.strip())
