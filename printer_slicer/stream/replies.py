"""Parse the lines of a printer into replies that do not depend on the firmware.

Replies have no checksum, so damage cannot be detected with certainty. A line that looks like part of an answer
becomes `Garbled` instead of `Message`, and the streamer then sends a probe.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Final, TypeAlias

from printer_slicer.stream.events import Action, Busy, Message, Reading, Temperature
from printer_slicer.values import Struct

if TYPE_CHECKING:
    from collections.abc import Callable

__all__ = [
    "Capability",
    "Garbled",
    "Identity",
    "LastLine",
    "LineError",
    "Ok",
    "Position",
    "Reply",
    "ReplyWithText",
    "Resend",
    "Started",
    "Stopped",
    "UnknownCommand",
    "Wait",
    "parse_replies",
]


class Ok(Struct, frozen=True):
    """Acknowledgement (`ok`) of a line.

    Attributes:
        number: the last line that the ok acknowledges, None if not reported.
        has_temperatures: whether the ok contains temperatures, as the answer to M105 does.
        planner: free places of the planner, None if not reported.
        places: free places of the command queue, None if not reported.
    """

    number: int | None = None
    has_temperatures: bool = False
    planner: int | None = None
    places: int | None = None


class Resend(Struct, frozen=True):
    """Resend request: the printer accepts only line `number` next."""

    number: int


class LineError(Struct, frozen=True):
    """Error report about a rejected line: the printer expects line `expected_line` instead."""

    expected_line: int
    text: str


class Wait(Struct, frozen=True):
    """Report that the printer is idle."""


class Started(Struct, frozen=True):
    """Report that the printer has just started and has lost its state."""


class Stopped(Struct, frozen=True):
    """Report that the printer has halted, for example because of a kill or a thermal error."""

    text: str


class UnknownCommand(Struct, frozen=True):
    """Report that the firmware does not know a command; `command` is the text that it received."""

    command: bytes
    text: str


class LastLine(Struct, frozen=True):
    """Report of the number of the last accepted line: the answer to an M110 without a line number."""

    number: int


class Identity(Struct, frozen=True):
    """Report of the firmware name."""

    firmware: str


class Capability(Struct, frozen=True):
    """Report of one capability of the firmware."""

    name: str
    enabled: bool


class Position(Struct, frozen=True):
    """Reported end position of the planned motion: x, y, z, and e if reported, mm."""

    x: float
    y: float
    z: float
    text: str
    e: float | None = None


class Garbled(Struct, frozen=True):
    """Answer that was damaged on the way from the printer.

    Attributes:
        text: the damaged text.
        may_reject: whether the answer may have been a `Resend`; then the next ok may belong to a rejection.
    """

    text: str
    may_reject: bool


Reply: TypeAlias = (
    Ok
    | Resend
    | LineError
    | Wait
    | Started
    | Stopped
    | UnknownCommand
    | LastLine
    | Identity
    | Capability
    | Position
    | Garbled
    | Temperature
    | Busy
    | Action
    | Message
)

ReplyWithText: TypeAlias = UnknownCommand | Position | Garbled
"""Replies that are also reported as text."""

_REPORT_KINDS: Final = (Temperature, Position, Identity)
_PLAIN_OK: Final = (Ok(),)  # the most frequent reply
_NUMBER: Final = rb"(-?\d+(?:\.\d*)?)"
_OK: Final = re.compile(rb"ok(?: N(\d{1,9}))?(?: P(\d{1,4}))?(?: B(\d{1,4}))?")
_OK_AND_MORE: Final = re.compile(rb"ok\s")
_TEMPERATURE_REPORT: Final = re.compile(rb"\s*(?:T\d?|B|C):\s*-?\d")
_HEATER_READING: Final = re.compile(rb"\b(T\d?|B|C):\s*" + _NUMBER + rb"(?:\s*/\s*" + _NUMBER + rb")?")
_POSITION: Final = re.compile(
    rb"(?<!Count )X:\s*"
    + _NUMBER
    + rb"\s+Y:\s*"
    + _NUMBER
    + rb"\s+Z:\s*"
    + _NUMBER
    + rb"(?:\s+E:\s*"
    + _NUMBER
    + rb")?"
)
_STARTED: Final = re.compile(
    rb"^[^ -~]*(?:start|External Reset|Brown out Reset|Watchdog Reset|Software Reset|Smoothie)$"
    rb"|^RepRapFirmware .* is up and running|^// Klipper state: Ready"
)
"""Report of a board that it has started, often after bytes sent at another baud rate."""
_PRINTABLE: Final = re.compile(r"[^\x00-\x08\x0a-\x1f\x7f]*")
_RESEND_LETTERS: Final = "Resend:"
_MAX_RESEND_LENGTH: Final = 20  # "Resend: " with a number of nine digits, and some damage


def _parse_position(found: re.Match[bytes]) -> tuple[Reply, ...]:
    """Build a position report from a match of the pattern `_POSITION`."""
    x, y, z = (float(value) for value in found.groups()[:3])
    return (Position(x, y, z, _decode_text(found.string), float(found[4]) if found[4] else None),)


def _parse_resend(found: re.Match[bytes]) -> tuple[Reply, ...]:
    """Build a resend request from a match, and an ok if one follows on the same line."""
    request = Resend(int(found[1]))
    # The line break between the request and its ok was lost.
    return (request, Ok()) if found[2] else (request,)


_PATTERNS: Final[tuple[tuple[re.Pattern[bytes], Callable[[re.Match[bytes]], tuple[Reply, ...]]], ...]] = (
    (re.compile(rb"(?:Resend:|^rs )\s*N?:?\s*(\d{1,9})(ok)?(?=\s|$)"), _parse_resend),
    (
        re.compile(rb"Last Line: *(\d{1,9})\s*$"),
        lambda m: (LineError(int(m[1]) + 1, _decode_text(m.string)),),
    ),
    (re.compile(rb"expected line (\d{1,9}) got"), lambda m: (LineError(int(m[1]), _decode_text(m.string)),)),
    (_STARTED, lambda _: (Started(),)),
    (re.compile(rb"^wait$"), lambda _: (Wait(),)),
    (re.compile(rb"^(?:echo: ?)?M110 N(-?\d{1,9})$"), lambda m: (LastLine(int(m[1])),)),
    (re.compile(rb"^skip \d+$"), lambda m: (Garbled(_decode_text(m.string), may_reject=True),)),
    (re.compile(rb"\bbusy:\s*(.*)"), lambda m: (Busy(_decode_text(m[1])),)),
    (
        re.compile(
            rb"^!!(?: [ -~]+)?$|^fatal:|insufficient axes homed"
            rb"|kill\(\) called|Printer halted|system stopped|(?i:emergency (?:shutdown|stop))"
            rb"|^// Klipper state: (?:Shutdown|Disconnect)"
        ),
        lambda m: (Stopped(_decode_text(m.string)),),
    ),
    (re.compile(rb"^//\s*action:\s*(.*)"), lambda m: (Action(_decode_text(m[1])),)),
    (re.compile(rb'Unknown command:\s*"(.*)"'), lambda m: (UnknownCommand(m[1], _decode_text(m.string)),)),
    (re.compile(rb"FIRMWARE_NAME:\s*(.*?)(?:\s+[A-Z_]+:.*)?$"), lambda m: (Identity(_decode_text(m[1])),)),
    (re.compile(rb"^Cap:(\w+):([01])$"), lambda m: (Capability(_decode_text(m[1]), m[2] == b"1"),)),
    (_POSITION, _parse_position),
)
"""Pattern of each kind of reply and its parser. The first match counts; urgent and unambiguous patterns come first."""


def parse_replies(line: bytes) -> tuple[Reply, ...]:
    """Parse one line from the printer, without its line break, into its replies.

    Several replies in one line are returned in processing order: `ok T:...` is a report, then an ok.
    An empty line contains no reply.
    """
    line = line.strip()
    if line == b"ok":
        return _PLAIN_OK
    if not line:
        return ()
    if found := _OK.fullmatch(line):
        number, planner, places = (int(value) if value else None for value in found.groups())
        return (Ok(number, planner=planner, places=places),)
    if _OK_AND_MORE.match(line):
        parsed = [reply for reply in _parse_text(line[3:]) if not isinstance(reply, Garbled | Message)]
        # In a position report `B:` and `C:` are motors.
        has_position = any(isinstance(reply, Position) for reply in parsed)
        ok = Ok(has_temperatures=not has_position and _HEATER_READING.search(line) is not None)
        # A report belongs to its ok; anything else is the next answer after a damaged line break.
        return (*parsed, ok) if all(isinstance(reply, _REPORT_KINDS) for reply in parsed) else (ok, *parsed)
    return _parse_text(line)


def _parse_text(line: bytes) -> tuple[Reply, ...]:
    """Parse a line that does not start with a valid ok."""
    for pattern, build in _PATTERNS:
        if found := pattern.search(line):
            return build(found)
    if _TEMPERATURE_REPORT.match(line):
        return (_parse_temperature(line),)
    text = _decode_text(line)
    damaged = "\ufffd" in text or not _PRINTABLE.fullmatch(text)
    may_reject = _resembles_resend(text) or (damaged and len(text) > len("ok N1"))
    if may_reject or damaged or len(line) <= 3 or line.startswith(b"ok"):
        return (Garbled(text, may_reject),)
    return (Message(text),)


def _parse_temperature(line: bytes) -> Temperature:
    """Parse a temperature report."""
    readings = tuple(
        Reading(name.decode(), float(actual), float(target) if target else None)
        for name, actual, target in _HEATER_READING.findall(line)
    )
    return Temperature(readings, waiting=b"W:" in line)


def _resembles_resend(text: str) -> bool:
    """Return whether the text contains at least five of the seven characters of `Resend:` in order."""
    if len(text) > _MAX_RESEND_LENGTH:
        return False
    position = n_found = 0
    for letter in _RESEND_LETTERS:
        found = text.find(letter, position)
        if found >= 0:
            position = found + 1
            n_found += 1
    return n_found >= 5


def _decode_text(data: bytes) -> str:
    """Decode received text without surrounding whitespace; invalid bytes become U+FFFD."""
    return data.decode(errors="replace").strip()
