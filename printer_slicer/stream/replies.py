"""Reading one line of the printer: what it means, whatever the firmware's way of saying it.

Damage on the way back has no checksum to show itself. So a line that looks like the remains of an answer is
told apart (`Garbled`) from text that is merely unknown, and the streamer then asks instead of guessing.
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
    """One more line is done with.

    Attributes:
        number: all lines up to this one are, if it is told.
        heat: it carries temperatures, as M105's.
        planner: free places of the planner, if told.
        places: free places of the command queue, if told.
    """

    number: int | None = None
    heat: bool = False
    planner: int | None = None
    places: int | None = None


@dataclass(frozen=True, slots=True)
class Resend:
    """Line `number` is the next one the printer will take."""

    number: int


@dataclass(frozen=True, slots=True)
class LineError:
    """Why a line was refused; names the wanted one a second time, ahead of the `Resend`."""

    wanted: int
    text: str


@dataclass(frozen=True, slots=True)
class Wait:
    """The printer has nothing to do."""


@dataclass(frozen=True, slots=True)
class Started:
    """The printer has just begun: all it knew is lost."""


@dataclass(frozen=True, slots=True)
class Stopped:
    """The printer will not go on: killed, a heater out of control, an error of Klipper's."""

    text: str


@dataclass(frozen=True, slots=True)
class Unknown:
    """A command that the printer does not know, as it read it."""

    command: bytes
    text: str


@dataclass(frozen=True, slots=True)
class LastLine:
    """Number of the last line that the printer took, as M110 alone tells it."""

    number: int


@dataclass(frozen=True, slots=True)
class Identity:
    """Name of the firmware."""

    firmware: str


@dataclass(frozen=True, slots=True)
class Capability:
    """Whether the firmware can do one thing."""

    name: str
    enabled: bool


@dataclass(frozen=True, slots=True)
class Position:
    """Where the motion planned so far ends: x, y, z, and e if told, mm."""

    x: float
    y: float
    z: float
    text: str
    e: float | None = None


@dataclass(frozen=True, slots=True)
class Garbled:
    """Remains of an answer; `refusal` when it may have been a `Resend`, so that an ok behind it means no."""

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
"""Replies that are also shown as they came."""

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
"""A board that begins says so, often behind bytes that no speed was agreed for yet."""
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
"""First match wins; the most urgent and the most certain stand first."""


def read_reply(line: bytes) -> tuple[Reply, ...]:
    """What one line says, without its line break; nothing for an empty line.

    Two things in one line come in the order in which they count: `ok T:...` is a report and then an ok.
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
        told = [reply for reply in _read_text(line[3:]) if not isinstance(reply, Garbled | Message)]
        # Where it says steps too, `B:` and `C:` are motors.
        placed = any(isinstance(reply, Position) for reply in told)
        ok = Ok(heat=not placed and _HEATER.search(line) is not None)
        # A report belongs to its ok; anything else is the next answer, and the line break between is damaged.
        return (*told, ok) if all(isinstance(reply, _REPORTS) for reply in told) else (ok, *told)
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
    """Whether at least five of the seven characters of `Resend:` stand there in order."""
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
