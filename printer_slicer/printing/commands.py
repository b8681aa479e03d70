"""Parse the commands with which a user controls a running print.

pause [now] [cold] [here]     pause after the planned moves or at once; let the nozzle cool down; do not park
resume, cancel                resume, or cancel and run the end script
abort                         halt the printer at once with M112 (emergency stop); also: estop, M112
object NAME                   cancel one object on the plate
speed PERCENT, flow PERCENT   set speed or flow in percent of the values in the file
nozzle C, bed C               set a target temperature, °C
fan PERCENT                   set the part fan
babystep MM                   move the nozzle up, or down if negative
say COMMAND                   send one line of G-code; while the print runs, none that moves the printer
answer N                      press a button of the printer's prompt
status                        show the state of the print
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import isfinite
from typing import Final, TypeAlias

from printer_slicer.errors import UsageError
from printer_slicer.values import Struct

__all__ = [
    "COMMAND_PARSERS",
    "FORMER_ABORT",
    "Abort",
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
    "parse_command",
]


FORMER_ABORT: Final = "stop"
"""Former name of the command `abort`; the name still works in this release."""


class Pause(Struct, frozen=True):
    """Pause the print.

    Attributes:
        now: discard the planned moves instead of finishing them.
        cold: let the nozzle cool down; the bed stays warm, so that the part does not come loose.
        park: retract, lift, and move off the part.
    """

    now: bool = False
    cold: bool = False
    park: bool = True


class Resume(Struct, frozen=True):
    """Resume the print at the position and with the settings that it had before the pause."""


class Cancel(Struct, frozen=True):
    """Cancel the job and run the end script."""


class CancelObject(Struct, frozen=True):
    """Cancel one object on the plate, by its name or number."""

    name: str


class Speed(Struct, frozen=True):
    """Set the speed, in percent of the speeds in the file."""

    percent: float


class Flow(Struct, frozen=True):
    """Set the flow, in percent of the flow in the file."""

    percent: float


class SetTemperature(Struct, frozen=True):
    """Set a target temperature, °C; `heater` is nozzle or bed."""

    heater: str
    celsius: float


class SetFan(Struct, frozen=True):
    """Set the speed of the part fan, in percent, until the file changes it."""

    percent: float


class BabyStep(Struct, frozen=True):
    """Move the nozzle and all following moves up by `mm`, down if negative."""

    mm: float


class Say(Struct, frozen=True):
    """Send one line of G-code."""

    gcode: str


class Answer(Struct, frozen=True):
    """Press button number `choice` of the printer's prompt; the first button is 0."""

    choice: int


class Status(Struct, frozen=True):
    """Request the status of the print."""


class Abort(Struct, frozen=True):
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
    | Abort
)

_PAUSE_OPTIONS: Final = frozenset({"now", "cold", "here"})


def _parse_pause(rest: str) -> PrintCommand:
    """Parse the options of the command `pause`."""
    words = set(rest.split())
    if unknown := words - _PAUSE_OPTIONS:
        raise UsageError(f"unknown option {min(unknown)!r} of pause", remedy="Use pause [now] [cold] [here]")
    return Pause(now="now" in words, cold="cold" in words, park="here" not in words)


def _make_parser_without_argument(build: Callable[[], PrintCommand]) -> Callable[[str], PrintCommand]:
    """Return the parser of a command without arguments."""

    def parse(rest: str) -> PrintCommand:
        if rest:
            raise UsageError(f"unexpected argument {rest!r}", remedy="Remove the argument")
        return build()

    return parse


def _make_text_parser(build: Callable[[str], PrintCommand], expected: str) -> Callable[[str], PrintCommand]:
    """Return the parser of a command with a text; `expected` describes the text in messages."""

    def parse(rest: str) -> PrintCommand:
        if not rest or not rest.isprintable():
            raise UsageError(f"expected {expected}", remedy="Use one line without control characters")
        return build(rest)

    return parse


def _parse_say(rest: str) -> PrintCommand:
    """Parse a line of G-code; M112 is an emergency stop, which does not wait for the lines before it."""
    if rest.upper() == "M112":
        return Abort()
    return _make_text_parser(Say, "a line of G-code")(rest)


def _make_number_parser(
    build: Callable[[float], PrintCommand], low: float, high: float, unit: str, example: float
) -> Callable[[str], PrintCommand]:
    """Return the parser of a command with a number from `low` to `high`, which may be followed by its unit."""

    def parse(rest: str) -> PrintCommand:
        try:
            value = float(_remove_unit(rest, unit))
        except ValueError:
            value = float("nan")
        if not isfinite(value) or not low <= value <= high:
            raise UsageError(
                f"{rest or 'no value'}: expected a number from {low:g} to {high:g} {unit}".rstrip(),
                remedy=f"Enter for example {example:g}",
            )
        return build(value)

    return parse


def _remove_unit(text: str, unit: str) -> str:
    """Remove the unit at the end of a number: %, mm, °C or C."""
    lower = text.lower()
    ending = next((one for one in (unit.lower(), unit[-1:].lower()) if one and lower.endswith(one)), "")
    return lower.removesuffix(ending)


COMMAND_PARSERS: Final[Mapping[str, Callable[[str], PrintCommand]]] = {
    "pause": _parse_pause,
    "resume": _make_parser_without_argument(Resume),
    "cancel": _make_parser_without_argument(Cancel),
    "abort": lambda _: Abort(),  # whatever follows: an emergency stop must not fail because of it
    "status": _make_parser_without_argument(Status),
    "object": _make_text_parser(CancelObject, "the name or number of an object on the plate"),
    "say": _parse_say,
    "speed": _make_number_parser(Speed, 10, 500, "%", 80),
    "flow": _make_number_parser(Flow, 10, 300, "%", 95),
    "fan": _make_number_parser(SetFan, 0, 100, "%", 50),
    "nozzle": _make_number_parser(lambda value: SetTemperature("nozzle", value), 0, 500, "°C", 210),
    "bed": _make_number_parser(lambda value: SetTemperature("bed", value), 0, 200, "°C", 60),
    "babystep": _make_number_parser(BabyStep, -2, 2, "mm", 0.02),
    "answer": _make_number_parser(lambda value: Answer(int(value)), 0, 99, "", 0),
}
"""Parser of the arguments of each command, by the first word of the command."""

_OTHER_NAMES: Final[Mapping[str, str]] = {"estop": "abort", "m112": "abort", FORMER_ABORT: "abort"}
_MEANINGS: Final[Mapping[str, str]] = {
    "continue": "resume",
    "end": "cancel",
    "quit": "cancel",
    "temperature": "nozzle",
    "temp": "nozzle",
    "hotend": "nozzle",
    "extruder": "nozzle",
    "feedrate": "speed",
    "feed": "speed",
    "flowrate": "flow",
    "extrusion": "flow",
    "z": "babystep",
    "z_offset": "babystep",
    "z-offset": "babystep",
    "zoffset": "babystep",
    "offset": "babystep",
    "exclude": "object",
    "skip": "object",
    "gcode": "say",
    "send": "say",
    "command": "say",
    "state": "status",
    "progress": "status",
}
"""Word that users of other hosts try -> the command that they mean."""
_MIN_SIMILARITY: Final = 0.75  # from 0 to 1; less similar words are not suggested


def parse_command(line: str) -> PrintCommand:
    """Parse a command for a running print, such as `pause now`.

    Raises:
        UsageError: the line is not a valid command.
    """
    word, _, rest = line.strip().partition(" ")
    word = _OTHER_NAMES.get(word.lower(), word.lower())
    if word not in COMMAND_PARSERS:
        raise UsageError(
            f"unknown command {word!r}",
            remedy=f"{_suggest_command(word)}Use one of {', '.join(COMMAND_PARSERS)}",
        )
    return COMMAND_PARSERS[word](rest.strip())


def _suggest_command(word: str) -> str:
    """Return a question that suggests a command in place of an unknown word; empty without a suggestion."""
    from difflib import get_close_matches  # noqa: PLC0415 - an emergency stop does not wait for this import

    near = get_close_matches(word, COMMAND_PARSERS, 1, _MIN_SIMILARITY) if word else []
    meant = _MEANINGS.get(word) or next(iter(near), "")
    return f"Did you mean {meant!r}? " if meant else ""
