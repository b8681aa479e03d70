"""What a person, or a program, may want of a running print: one value per wish, and how it is typed.

pause [now] [cold] [here]     when what is planned has ended, or at once; without heat; without parking
resume, cancel, stop          stop halts the printer like its emergency button
object NAME                   give up one of several things on the plate
speed PERCENT, flow PERCENT   factors over what the file says
nozzle C, bed C, fan PERCENT
babystep MM                   nozzle up, or down with a minus sign
say COMMAND                   one line of G-code
answer N                      press a button of the printer's question
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
    """Pause.

    Attributes:
        now: stop within the planned moves, not behind them.
        cold: let the nozzle cool down; the bed stays warm, or the part would come loose.
        park: pull back filament, lift, and go off the part.
    """

    now: bool = False
    cold: bool = False
    park: bool = True


@dataclass(frozen=True, slots=True)
class Resume:
    """Go on after a pause, from where it was and as it was."""


@dataclass(frozen=True, slots=True)
class Cancel:
    """Drop the rest of the job and run the end script."""


@dataclass(frozen=True, slots=True)
class CancelObject:
    """Print no more of one thing on the plate, by its name or number."""

    name: str


@dataclass(frozen=True, slots=True)
class Speed:
    """Percent of the speeds of the file."""

    percent: float


@dataclass(frozen=True, slots=True)
class Flow:
    """Percent of the filament of the file."""

    percent: float


@dataclass(frozen=True, slots=True)
class SetTemperature:
    """Another wanted temperature, °C: `heater` is nozzle or bed."""

    heater: str
    celsius: float


@dataclass(frozen=True, slots=True)
class SetFan:
    """Percent of the part fan, until the file changes it."""

    percent: float


@dataclass(frozen=True, slots=True)
class BabyStep:
    """Move the nozzle by so many mm, up or down, and everything that follows with it."""

    mm: float


@dataclass(frozen=True, slots=True)
class Say:
    """Send one line of G-code."""

    gcode: str


@dataclass(frozen=True, slots=True)
class Answer:
    """The button that a person chose when the printer asked, counted from 0."""

    choice: int


@dataclass(frozen=True, slots=True)
class Status:
    """How it stands."""


@dataclass(frozen=True, slots=True)
class Stop:
    """Emergency: M112, ahead of everything."""


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
        raise UsageError(f"pause {min(unknown)}: not known", remedy="pause [now] [cold] [here]")
    return Pause(now="now" in words, cold="cold" in words, park="here" not in words)


def _bare(build: Callable[[], PrintCommand]) -> Callable[[str], PrintCommand]:
    def read(rest: str) -> PrintCommand:
        if rest:
            raise UsageError(f"{rest}: nothing is expected here", remedy="leave it out")
        return build()

    return read


def _text(build: Callable[[str], PrintCommand], what: str) -> Callable[[str], PrintCommand]:
    def read(rest: str) -> PrintCommand:
        if not rest or not rest.isprintable():
            raise UsageError(f"expected {what}", remedy="in one line, without control characters")
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
                f"{rest or 'nothing'}: expected {low:g} to {high:g} {unit}", remedy="give a number"
            )
        return build(value)

    return read


WORDS: Final[Mapping[str, Callable[[str], PrintCommand]]] = {
    "pause": _pause,
    "resume": _bare(Resume),
    "cancel": _bare(Cancel),
    "stop": _bare(Stop),
    "status": _bare(Status),
    "object": _text(CancelObject, "the name or number of a thing on the plate"),
    "say": _text(Say, "a line of G-code"),
    "speed": _value(Speed, 10, 500, "%"),
    "flow": _value(Flow, 10, 300, "%"),
    "fan": _value(SetFan, 0, 100, "%"),
    "nozzle": _value(lambda value: SetTemperature("nozzle", value), 0, 500, "°C"),
    "bed": _value(lambda value: SetTemperature("bed", value), 0, 200, "°C"),
    "babystep": _value(BabyStep, -2, 2, "mm"),
    "answer": _value(lambda value: Answer(int(value)), 0, 99, ""),
}
"""First word to how the rest of the line is read."""


def parse_command(line: str) -> PrintCommand:
    """The wish that a line says.

    Raises:
        UsageError: it says none.
    """
    word, _, rest = line.strip().partition(" ")
    if word not in WORDS:
        raise UsageError(f"{word or 'nothing'}: not known", remedy="one of " + ", ".join(WORDS))
    return WORDS[word](rest.strip())
