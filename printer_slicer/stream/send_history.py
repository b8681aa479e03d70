"""Keep the numbered lines, and record which of them were sent and accepted.

The lines in flight are those between `accepted` and `cursor`. An acknowledgement moves `accepted` and a resend moves
`cursor`, so there is no separate count that could become wrong. A number always belongs to the same line. Therefore it
is safe to send whatever line the printer requests.
"""

from __future__ import annotations

from math import inf
from typing import TYPE_CHECKING, Final

from printer_slicer.stream.framing import frame
from printer_slicer.values import Struct

if TYPE_CHECKING:
    from collections.abc import Callable

__all__ = ["PROBE_COMMAND", "NumberedLine", "SendHistory"]

PROBE_COMMAND: Final = b"M105"
"""Probe: a harmless command whose answer cannot be mistaken for the answer to another line."""

_CERTAIN_AFTER: Final = 16
"""Number of later accepted lines that prove that a line was accepted: each of them would have exposed a gap."""

_LINES_KEPT: Final = 2 * _CERTAIN_AFTER


class NumberedLine(Struct):
    """A command with its line number and checksum, as it is sent.

    Attributes:
        command: command without number and checksum.
        text: the line as sent, with number and checksum, without line break.
        entries: number of job entries that are accepted once this line is accepted.
        timeout: maximum time, s, from the acceptance of the previous line to the ok of this one.
        sent: time at which it was last sent, s.
    """

    command: bytes
    text: bytes
    entries: int
    timeout: float
    sent: float = -inf


class SendHistory:
    """History of the numbered lines, which start at 1.

    Attributes:
        accepted: highest line that counts as accepted.
        proven: highest line that was certainly accepted; a printer that requests this or an earlier
            line has lost count.
        cursor: number of the next line to send.
        next_number: next unused number.
        frame: function that frames a number and a command as a line.
    """

    def __init__(self) -> None:
        self.accepted = 0
        self.proven = 0
        self.cursor = 1
        self.next_number = 1
        self.frame: Callable[[int, bytes], bytes] = frame
        self._lines: dict[int, NumberedLine] = {}

    @property
    def n_in_flight(self) -> int:
        """Return the number of lines that were sent and are not yet accepted."""
        return self.cursor - self.accepted - 1

    @property
    def bytes_in_flight(self) -> int:
        """Return the total length of the lines in flight, with their line breaks, bytes."""
        return sum(len(self._lines[number].text) + 1 for number in range(self.accepted + 1, self.cursor))

    @property
    def oldest(self) -> NumberedLine:
        """Return the oldest line in flight. Valid only while lines are in flight."""
        return self._lines[self.accepted + 1]

    @property
    def next_line(self) -> NumberedLine:
        """Return the line to send next. Valid only while `cursor` is below `next_number`."""
        return self._lines[self.cursor]

    def add_line(self, command: bytes, entries: int, timeout: float) -> None:
        """Assign the next number to a command; see `NumberedLine` for the arguments."""
        self._lines[self.next_number] = NumberedLine(
            command, self.frame(self.next_number, command), entries, timeout
        )
        self.next_number += 1

    def send_next(self, now: float, *, break_first: bool = False) -> bytes:
        """Return the bytes of the next line, which is then in flight; `break_first` puts a line break in front.

        A resent line always starts with a line break. If the break of the previous copy were lost, the copies would
        otherwise be read as one line, and the XOR of three copies equals that of one.
        """
        line = self.next_line
        start = b"\n" if break_first or line.sent != -inf else b""
        line.sent = now
        self.cursor += 1
        return b"%s%s\n" % (start, line.text)

    def accept(self, number: int) -> int:
        """Mark the lines up to `number` as accepted; return the number of accepted job entries."""
        for old in range(self.accepted + 1, number + 1):
            self._lines.pop(old - _LINES_KEPT, None)
        self.accepted = number
        self.mark_certainly_accepted(number - _CERTAIN_AFTER)
        return self._lines[number].entries

    def mark_certainly_accepted(self, number: int) -> None:
        """Mark all lines up to `number` as certainly accepted."""
        self.proven = max(self.proven, number)

    def get_line(self, number: int) -> NumberedLine:
        """Return line `number`, which must be in flight."""
        return self._lines[number]

    def find_newest_line(self, command: bytes) -> int | None:
        """Return the number of the newest line in flight with this command, None if there is none."""
        for number in range(self.cursor - 1, self.accepted, -1):
            if self._lines[number].command == command:
                return number
        return None

    def find_oldest_line(self, command: bytes) -> int | None:
        """Return the number of the oldest line in flight with this command, None if there is none."""
        numbers = range(self.accepted + 1, self.cursor)
        return next((number for number in numbers if self._lines[number].command == command), None)

    def list_commands_in_flight(self) -> list[bytes]:
        """Return the commands of the lines in flight."""
        return [self._lines[number].command for number in range(self.accepted + 1, self.cursor)]

    def rewind_to(self, number: int) -> int:
        """Go back, so that line `number` is sent next; return the number of job entries still accepted."""
        self.cursor = number
        self.accepted = min(self.accepted, number - 1)
        return self._lines[self.accepted].entries if self.accepted else 0
