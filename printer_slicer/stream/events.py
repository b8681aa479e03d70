"""What a streamer tells its owner, in the order in which it happened."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

__all__ = [
    "Accepted",
    "Action",
    "AxisPositions",
    "Busy",
    "Event",
    "Finished",
    "Halted",
    "Identified",
    "LineSent",
    "Message",
    "Paused",
    "PoorLink",
    "Probe",
    "Prompt",
    "Reading",
    "ResendAsked",
    "Resumed",
    "Stopping",
    "StreamWarning",
    "Temperature",
]

AxisPositions: TypeAlias = tuple[float | None, float | None, float | None]
"""x, y, z in mm; None where it is not known."""


@dataclass(frozen=True, slots=True)
class Accepted:
    """The printer took more of the job: its first `acknowledged` entries."""

    acknowledged: int


@dataclass(frozen=True, slots=True)
class LineSent:
    """Line `number` is about to go out for the first time, and it is not just the next entry of the job.

    Attributes:
        number: of the line; a number lower than the last one means that counting began anew.
        job: entries of the job that are accepted once the line is.
        command: what it says, empty for an entry of the job behind others that were left out.
    """

    number: int
    job: int
    command: bytes


@dataclass(frozen=True, slots=True)
class ResendAsked:
    """The printer found an error on the wire and gets everything from line `number` again."""

    number: int


@dataclass(frozen=True, slots=True)
class Probe:
    """The printer was silent or hard to read, so line `number` asks it for the truth."""

    number: int


@dataclass(frozen=True, slots=True)
class Reading:
    """One heater: its name as the printer says it (T, T0, B, C), °C, and the wanted °C where told."""

    name: str
    actual: float
    target: float | None


@dataclass(frozen=True, slots=True)
class Temperature:
    """A report of all heaters; `waiting` when the printer does nothing else until they are warm."""

    readings: tuple[Reading, ...]
    waiting: bool = False


@dataclass(frozen=True, slots=True)
class Busy:
    """The printer lives and cannot answer yet: "processing", "paused for user"..."""

    reason: str


@dataclass(frozen=True, slots=True)
class Identified:
    """Who answered, and what it can do.

    Attributes:
        firmware: its name, "" if it does not say.
        capabilities: what it says it has or has not.
        dialect: how it is spoken to, a key of `WIRE_DIALECTS`.
        advice: what to know before streaming to it, "" if nothing.
    """

    firmware: str
    capabilities: tuple[tuple[str, bool], ...]
    dialect: str = "marlin"
    advice: str = ""

    def can(self, name: str) -> bool:
        """Whether the firmware says that it has this capability."""
        return (name, True) in self.capabilities


@dataclass(frozen=True, slots=True)
class Action:
    """The printer asks its host for something: "pause", "resume", "cancel", "notification ..."."""

    name: str


@dataclass(frozen=True, slots=True)
class Prompt:
    """The printer asks a person: text and buttons, both from outside; no text any more when it was answered."""

    text: str
    buttons: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Paused:
    """The print waits for a person; why."""

    reason: str


@dataclass(frozen=True, slots=True)
class Resumed:
    """It goes on."""


@dataclass(frozen=True, slots=True)
class StreamWarning:
    """The host tells its owner something that is no reason to stop."""

    text: str


@dataclass(frozen=True, slots=True)
class PoorLink:
    """The cable damages lines or loses acknowledgements.

    Attributes:
        lines: number of lines acknowledged so far.
        resends: number of resend requests.
        lost_answers: number of acknowledgements that got lost.
        resends_per_1000: resends per 1000 lines.
        undetected: expected number of damaged lines that the checksum did not detect.
        text: message for people, with a remedy.
    """

    lines: int
    resends: int
    lost_answers: int
    resends_per_1000: float
    undetected: float
    text: str


@dataclass(frozen=True, slots=True)
class Message:
    """Anything else the printer said. Text from outside: never markup, never a command."""

    text: str


@dataclass(frozen=True, slots=True)
class Halted:
    """The end before the end of the job, and why. `commands[:acknowledged]` were accepted."""

    reason: str
    acknowledged: int


@dataclass(frozen=True, slots=True)
class Stopping:
    """The owner of the host, or the printer, wants the end: the end script goes out as soon as it is taken."""


@dataclass(frozen=True, slots=True)
class Finished:
    """The printer has executed all it was sent.

    Attributes:
        acknowledged: entries of the job that it took; fewer than all only when cancelled.
        cancelled: the rest of the job was dropped and the end script run instead.
        position: where the printer says it is, None if it never said.
        expected: where the commands lead.
        verified: whether the two agree; None when they cannot be compared.
    """

    acknowledged: int
    cancelled: bool
    position: AxisPositions | None
    expected: AxisPositions
    verified: bool | None


Event: TypeAlias = (
    Accepted
    | LineSent
    | ResendAsked
    | Probe
    | Temperature
    | Busy
    | Identified
    | Action
    | Message
    | StreamWarning
    | PoorLink
    | Paused
    | Resumed
    | Prompt
    | Halted
    | Stopping
    | Finished
)
