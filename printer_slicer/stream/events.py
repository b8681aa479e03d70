"""Events that a streamer reports in the order in which they happen."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, TypeAlias

from printer_slicer.values import Struct

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
    "ResendRequested",
    "Resumed",
    "Stopping",
    "StreamWarning",
    "Temperature",
    "get_event_kind",
]

AxisPositions: TypeAlias = tuple[float | None, float | None, float | None]
"""x, y, z in mm; None for an unknown coordinate."""


class Accepted(Struct, frozen=True):
    """The printer has accepted the first `acknowledged` entries of the job."""

    acknowledged: int


class LineSent(Struct, frozen=True):
    """A line is about to be sent for the first time, and it is not simply the next entry of the job.

    Attributes:
        number: line number; lower than the previous one if numbering has restarted.
        entries: number of job entries that are accepted once this line is accepted.
        command: the command; empty for an entry of the job that follows skipped entries.
    """

    number: int
    entries: int
    command: bytes


class ResendRequested(Struct, frozen=True):
    """The printer detected a transmission error; all lines from number `number` on are sent again."""

    number: int

    @property
    def text(self) -> str:
        """The event as a sentence."""
        return f"the printer requests a resend from line {self.number}"


class Probe(Struct, frozen=True):
    """An acknowledgement is missing or unreadable, so line `number` is sent to probe what has arrived."""

    number: int


class Reading(Struct, frozen=True):
    """Reported temperature of one heater and, if known, its target, °C; `name` is T, T0, B, C..."""

    name: str
    actual: float
    target: float | None


class Temperature(Struct, frozen=True):
    """Temperature report of all heaters; `waiting` is whether the printer waits for them to heat up."""

    readings: tuple[Reading, ...]
    waiting: bool = False


class Busy(Struct, frozen=True):
    """The printer is busy and cannot answer yet; `reason` is text such as "processing" or "paused for user"."""

    reason: str


class Identified(Struct, frozen=True):
    """The printer has reported its firmware and capabilities.

    Attributes:
        firmware: name of the firmware, "" if not reported.
        capabilities: reported capabilities, each with whether it is enabled.
        dialect: dialect of the protocol, a key of `WIRE_DIALECTS`.
        advice: advice about streaming to this firmware, "" if none.
    """

    firmware: str
    capabilities: tuple[tuple[str, bool], ...]
    dialect: str = "marlin"
    advice: str = ""

    def has_capability(self, name: str) -> bool:
        """Return whether the firmware reports this capability as enabled."""
        return (name, True) in self.capabilities


class Action(Struct, frozen=True):
    """Action command of the printer for its host: "pause", "resume", "cancel", "notification ..."."""

    name: str

    @property
    def text(self) -> str:
        """The event as a sentence."""
        return f"the printer requests: {self.name}"


class Prompt(Struct, frozen=True):
    """Prompt of the printer for the user: untrusted text and buttons; an empty text closes the prompt."""

    text: str
    buttons: tuple[str, ...]


class Paused(Struct, frozen=True):
    """The print is paused and waits for the user; `reason` says why."""

    reason: str


class Resumed(Struct, frozen=True):
    """The print has resumed."""


class StreamWarning(Struct, frozen=True):
    """Warning of the host that does not stop the print."""

    text: str


class PoorLink(Struct, frozen=True):
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


class Message(Struct, frozen=True):
    """Text from the printer for which there is no other event. It is untrusted: no markup, no command."""

    text: str


class Halted(Struct, frozen=True):
    """The print ended early because of `reason`, after the first `acknowledged` job entries."""

    reason: str
    acknowledged: int


class Stopping(Struct, frozen=True):
    """The user or the printer has cancelled the print; the end script is sent next."""


class Finished(Struct, frozen=True):
    """The printer has executed everything that was sent.

    Attributes:
        acknowledged: number of accepted job entries; all of them unless the print was cancelled.
        cancelled: whether the end script replaced the rest of the job.
        position: position that the printer reports, None if it reported none.
        expected: position at the end of the sent commands.
        verified: whether the two positions agree; None if they cannot be compared.
    """

    acknowledged: int
    cancelled: bool
    position: AxisPositions | None
    expected: AxisPositions
    verified: bool | None


Event: TypeAlias = (
    Accepted
    | LineSent
    | ResendRequested
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

_KINDS: Final[Mapping[type, str]] = {
    ResendRequested: "resend",
    StreamWarning: "warning",
    PoorLink: "poor_link",
    LineSent: "line_sent",
}


def get_event_kind(event: Event) -> str:
    """Return the name of the kind of an event in the JSON output, such as `temperature` or `poor_link`."""
    return _KINDS.get(type(event), type(event).__name__.lower())
