"""The numbered lines: which exist, which went out, which were accepted.

Lines in flight are always the gap between `accepted` and `cursor`, so an acknowledgement moves the one and a
resend the other, and no count can drift. A number belongs to its line for ever: sending a number again always
sends the same line, which is why it is safe to believe the printer whenever it names the line it wants.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import TYPE_CHECKING, Final

from printer_slicer.stream.framing import frame

if TYPE_CHECKING:
    from collections.abc import Callable

__all__ = ["ASK", "NumberedLine", "SendHistory"]

ASK: Final = b"M105"
"""Harmless, and its answer cannot be mistaken for the answer to another line."""

_CERTAIN_AFTER: Final = 16
"""A line was accepted for certain when this many later ones were: each of them would have exposed the gap."""

_KEPT: Final = 2 * _CERTAIN_AFTER


@dataclass(slots=True)
class NumberedLine:
    """One numbered line.

    Attributes:
        command: without number and checksum.
        text: with both.
        job: entries of the job that are accepted once this line is.
        patience: longest time until its ok from when the line before it was accepted, s.
        sent: when it last went out, s.
    """

    command: bytes
    text: bytes
    job: int
    patience: float
    sent: float = -inf


class SendHistory:
    """Lines from 1 on.

    Attributes:
        accepted: highest line that counts as accepted.
        proven: highest line that certainly was; a printer that wants one of these again has lost count.
        cursor: next line to go out.
        top: next number that no line has yet.
        frame: makes the text of a line out of its number and command.
    """

    def __init__(self) -> None:
        self.accepted = 0
        self.proven = 0
        self.cursor = 1
        self.top = 1
        self.frame: Callable[[int, bytes], bytes] = frame
        self._lines: dict[int, NumberedLine] = {}

    @property
    def in_flight(self) -> int:
        """Lines sent and not yet accepted."""
        return self.cursor - self.accepted - 1

    @property
    def bytes_in_flight(self) -> int:
        """Bytes of these lines, with their line breaks."""
        return sum(len(self._lines[number].text) + 1 for number in range(self.accepted + 1, self.cursor))

    @property
    def oldest(self) -> NumberedLine:
        """The line whose answer comes next. Only while lines are in flight."""
        return self._lines[self.accepted + 1]

    @property
    def next(self) -> NumberedLine:
        """The line that goes out next. Only while `cursor` is below `top`."""
        return self._lines[self.cursor]

    def add(self, command: bytes, job: int, patience: float) -> None:
        """Give a command the next number."""
        self._lines[self.top] = NumberedLine(command, self.frame(self.top, command), job, patience)
        self.top += 1

    def take(self, now: float, *, break_first: bool = False) -> bytes:
        """Bytes of the next line, which is in flight from now on; after a line break if asked for.

        A repeat always begins with one: should the break of the copy before be lost, the copies would else be
        read as one line, and the xor of three copies is the xor of one.
        """
        line = self.next
        start = b"\n" if break_first or line.sent != -inf else b""
        line.sent = now
        self.cursor += 1
        return b"%s%s\n" % (start, line.text)

    def accept(self, number: int) -> int:
        """Count the lines up to `number`, one in flight, as accepted; entries of the job done then."""
        for old in range(self.accepted + 1, number + 1):
            self._lines.pop(old - _KEPT, None)
        self.accepted = number
        self.prove(number - _CERTAIN_AFTER)
        return self._lines[number].job

    def prove(self, number: int) -> None:
        """Count all lines up to `number` as certainly accepted."""
        self.proven = max(self.proven, number)

    def line(self, number: int) -> NumberedLine:
        """A line in flight."""
        return self._lines[number]

    def find(self, command: bytes) -> int | None:
        """Number of the newest line in flight with this command."""
        for number in range(self.cursor - 1, self.accepted, -1):
            if self._lines[number].command == command:
                return number
        return None

    def find_oldest(self, command: bytes) -> int | None:
        """Number of the oldest line in flight with this command."""
        numbers = range(self.accepted + 1, self.cursor)
        return next((number for number in numbers if self._lines[number].command == command), None)

    def commands(self) -> list[bytes]:
        """The commands in flight."""
        return [self._lines[number].command for number in range(self.accepted + 1, self.cursor)]

    def rewind(self, number: int) -> int:
        """Go back so that `number`, above `proven`, goes out next; entries of the job that stay accepted."""
        self.cursor = number
        self.accepted = min(self.accepted, number - 1)
        return self._lines[self.accepted].job if self.accepted else 0
