"""Parse the lines of a printer into replies that do not depend on the firmware.

Replies have no checksum, so damage cannot be detected with certainty. A line that looks like the remains of an answer
becomes `Garbled` instead of `Message`, and the streamer then sends a probe.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, TypeAlias

from printer_slicer.stream.events import Action, Busy, Message, Reading, Temperature

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
    "Resend",
    "Started",
    "Stopped",
    "Unknown",
    "Wait",
    "WithText",
    "read_reply",
]


@dataclass(frozen=True, slots=True)
class Ok:
    """Acknowledgement of a line.

    Attributes:
        number: line up to which it acknowledges, None if not reported.
        heat: whether it contains temperatures, as the answer to M105 does.
        planner: free places of the planner, None if not reported.
        places: free places of the command queue, None if not reported.
    """

    number: int | None = None
    heat: bool = False
    planner: int | None = None
    places: int | None = None


@dataclass(frozen=True, slots=True)
class Resend:
    """Resend request: the printer accepts line `number` next."""

    number: int


@dataclass(frozen=True, slots=True)
class LineError:
    """Error about a rejected line; it names the wanted line before the `Resend` does."""

    wanted: int
    text: str


@dataclass(frozen=True, slots=True)
class Wait:
    """Report that the printer is idle."""


@dataclass(frozen=True, slots=True)
class Started:
    """Report that the printer has just started and has lost its state."""


@dataclass(frozen=True, slots=True)
class Stopped:
    """Report that the printer has halted: killed, a thermal error, or an error of Klipper."""

    text: str


@dataclass(frozen=True, slots=True)
class Unknown:
    """Report of an unknown command, as the printer read it."""

    command: bytes
    text: str


@dataclass(frozen=True, slots=True)
class LastLine:
    """Number of the last accepted line, the answer to a plain M110."""

    number: int


@dataclass(frozen=True, slots=True)
class Identity:
    """Report of the firmware name."""

    firmware: str


@dataclass(frozen=True, slots=True)
class Capability:
    """Report of one capability of the firmware."""

    name: str
    enabled: bool


@dataclass(frozen=True, slots=True)
class Position:
    """Reported end position of the planned motion: x, y, z, and e if reported, mm."""

    x: float
    y: float
    z: float
    text: str
    e: float | None = None


@dataclass(frozen=True, slots=True)
class Garbled:
    """Damaged answer; `refusal`: it may have been a `Resend`, so the next ok may belong to a rejection."""

    text: str
    refusal: bool


Reply: TypeAlias = (
    Ok
    | Resend
    | LineError
    | Wait
    | Started
    | Stopped
    | Unknown
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

WithText: TypeAlias = Unknown | Position | Garbled
"""Replies that are also reported as text."""

_REPORTS: Final = (Temperature, Position, Identity)
_PLAIN_OK: Final = (Ok(),)  # nearly every line is this one
_NUMBER: Final = rb"(-?\d+(?:\.\d*)?)"
_OK: Final = re.compile(rb"ok(?: N(\d{1,9}))?(?: P(\d{1,4}))?(?: B(\d{1,4}))?")
_OK_AND: Final = re.compile(rb"ok\s")
_HEATERS: Final = re.compile(rb"\s*(?:T\d?|B|C):\s*-?\d")
_HEATER: Final = re.compile(rb"\b(T\d?|B|C):\s*" + _NUMBER + rb"(?:\s*/\s*" + _NUMBER + rb")?")
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
"""A board reports its start, often after bytes sent at another baud rate."""
_SENSIBLE_CONTROL: Final = re.compile(r"[^\x00-\x08\x0a-\x1f\x7f]*")
_RESEND_LETTERS: Final = "Resend:"
_RESEND_LONGEST: Final = 20  # "Resend: " with a number of nine digits, and some damage


def _position(found: re.Match[bytes]) -> tuple[Reply, ...]:
    x, y, z = (float(value) for value in found.groups()[:3])
    return (Position(x, y, z, _text(found.string), float(found[4]) if found[4] else None),)


def _resend(found: re.Match[bytes]) -> tuple[Reply, ...]:
    asked = Resend(int(found[1]))
    # The line break between the request and its ok was lost.
    return (asked, Ok()) if found[2] else (asked,)


_PATTERNS: Final[tuple[tuple[re.Pattern[bytes], Callable[[re.Match[bytes]], tuple[Reply, ...]]], ...]] = (
    (re.compile(rb"(?:Resend:|^rs )\s*N?:?\s*(\d{1,9})(ok)?(?=\s|$)"), _resend),
    (re.compile(rb"Last Line: *(\d{1,9})\s*$"), lambda m: (LineError(int(m[1]) + 1, _text(m.string)),)),
    (re.compile(rb"expected line (\d{1,9}) got"), lambda m: (LineError(int(m[1]), _text(m.string)),)),
    (_STARTED, lambda _: (Started(),)),
    (re.compile(rb"^wait$"), lambda _: (Wait(),)),
    (re.compile(rb"^(?:echo: ?)?M110 N(-?\d{1,9})$"), lambda m: (LastLine(int(m[1])),)),
    (re.compile(rb"^skip \d+$"), lambda m: (Garbled(_text(m.string), refusal=True),)),
    (re.compile(rb"\bbusy:\s*(.*)"), lambda m: (Busy(_text(m[1])),)),
    (
        re.compile(
            rb"^!!(?: [ -~]+)?$|^fatal:|insufficient axes homed"
            rb"|kill\(\) called|Printer halted|system stopped|(?i:emergency (?:shutdown|stop))"
            rb"|^// Klipper state: (?:Shutdown|Disconnect)"
        ),
        lambda m: (Stopped(_text(m.string)),),
    ),
    (re.compile(rb"^//\s*action:\s*(.*)"), lambda m: (Action(_text(m[1])),)),
    (re.compile(rb'Unknown command:\s*"(.*)"'), lambda m: (Unknown(m[1], _text(m.string)),)),
    (re.compile(rb"FIRMWARE_NAME:\s*(.*?)(?:\s+[A-Z_]+:.*)?$"), lambda m: (Identity(_text(m[1])),)),
    (re.compile(rb"^Cap:(\w+):([01])$"), lambda m: (Capability(_text(m[1]), m[2] == b"1"),)),
    (_POSITION, _position),
)
"""The first match wins; urgent and unambiguous patterns come first."""


def read_reply(line: bytes) -> tuple[Reply, ...]:
    """Parse one line without its line break; an empty line gives no reply.

    Several replies in one line are returned in processing order: `ok T:...` is a report, then an ok.
    """
    line = line.strip()
    if line == b"ok":
        return _PLAIN_OK
    if not line:
        return ()
    if found := _OK.fullmatch(line):
        number, planner, places = (int(value) if value else None for value in found.groups())
        return (Ok(number, planner=planner, places=places),)
    if _OK_AND.match(line):
        parsed = [reply for reply in _read_text(line[3:]) if not isinstance(reply, Garbled | Message)]
        # In a position report `B:` and `C:` are motors.
        placed = any(isinstance(reply, Position) for reply in parsed)
        ok = Ok(heat=not placed and _HEATER.search(line) is not None)
        # A report belongs to its ok; anything else is the next answer after a damaged line break.
        return (*parsed, ok) if all(isinstance(reply, _REPORTS) for reply in parsed) else (ok, *parsed)
    return _read_text(line)


def _read_text(line: bytes) -> tuple[Reply, ...]:
    for pattern, build in _PATTERNS:
        if found := pattern.search(line):
            return build(found)
    if _HEATERS.match(line):
        return (_temperature(line),)
    text = _text(line)
    damaged = "\ufffd" in text or not _SENSIBLE_CONTROL.fullmatch(text)
    refusal = _resembles_resend(text) or (damaged and len(text) > len("ok N1"))
    if refusal or damaged or len(line) <= 3 or line.startswith(b"ok"):
        return (Garbled(text, refusal),)
    return (Message(text),)


def _temperature(line: bytes) -> Temperature:
    readings = tuple(
        Reading(name.decode(), float(actual), float(target) if target else None)
        for name, actual, target in _HEATER.findall(line)
    )
    return Temperature(readings, waiting=b"W:" in line)


def _resembles_resend(text: str) -> bool:
    """Return whether the text contains at least five of the seven characters of `Resend:` in order."""
    if len(text) > _RESEND_LONGEST:
        return False
    position = kept = 0
    for letter in _RESEND_LETTERS:
        found = text.find(letter, position)
        if found >= 0:
            position = found + 1
            kept += 1
    return kept >= 5


def _text(data: bytes) -> str:
    return data.decode(errors="replace").strip()
