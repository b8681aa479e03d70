"""From arriving bytes to lines that may be executed: buffer, line, number, checksum.

line begins with      number is          checksum is     then
anything else         -                  -               accepted, even with `*..` behind it
N                     not last + 1       -               refused, or dropped when it repeats a recent one
N                     last + 1           absent          refused
N                     last + 1           wrong           refused
N                     last + 1           right           accepted
N, holds M110         anything           as above        accepted; its own N counts, not the line's

That is what front ends that take the "next" line do. Those that take any "right" line accept what has a right checksum
or none and drop the rest without a word; those that take "any" cut number and checksum off and look at neither.
"""

from __future__ import annotations

import re
from binascii import crc_hqx
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from printer_slicer.sim.front_end import FrontEnd
    from printer_slicer.sim.tally import Tally

__all__ = ["Line", "LineReader", "checksum"]

Line = tuple[int | None, str]
"""Line number, if it had one, and the command without number and checksum."""

_ORDINARY: Final = re.compile(rb"N(\d{1,9}) ([^;*]+)\*(\d{1,3})").fullmatch
_NUMBER: Final = re.compile(rb"[ \t]*([-+]?\d{1,18})").match
_PREFIX: Final = re.compile(rb"N[-+]?\d* *").match

_NEITHER: Final = re.compile(rb"(?:N[-+]?\d* *)?([^*]*)", re.DOTALL).match
_CRC_DIGITS: Final = 5

MOST_UNREAD: Final = 65_536
"""Bytes kept for a printer with flow control: the sender has to wait, and what it sends all the same is lost."""


class LineReader:
    """The receive buffer and the line buffer of a firmware.

    Attributes:
        last: number of the last accepted line.
        fault: why `next` refused a line, as it is said of it; whoever reads it clears it.
        refused: whether it did; whoever reads it clears it.
        passed: what is to be answered instead of an ok, for a line that was passed over; None if none was.
        skipping: lines still to be passed over behind a refused one; below 0 while all is well.
        overflowed: bytes found the buffer full.
    """

    __slots__ = (
        *("_at", "_front_end", "_keep", "_line", "_numbered", "_ring", "_room", "_tally"),
        *("fault", "last", "overflowed", "passed", "refused", "skipping"),
    )

    def __init__(self, front_end: FrontEnd, tally: Tally) -> None:
        self.last = 0
        self.fault = ""
        self.refused = False
        self.passed: tuple[str, ...] | None = None
        self.skipping = -1
        self.overflowed = False
        self._numbered = False
        self._front_end = front_end
        self._keep = front_end.line_size - 1
        self._room = MOST_UNREAD if front_end.receive_buffer is None else front_end.receive_buffer
        self._tally = tally
        self._line = b""
        self._ring = b""
        self._at = 0  # how much of the ring has been read

    def arrive(self, data: bytes) -> None:
        """Put bytes into the receive buffer, as many as fit."""
        if b"\r" in data:
            data = data.replace(b"\r", b"\n")  # both end a line, and empty lines do not count
        unread = self._ring[self._at :]
        room = self._room
        if len(unread) + len(data) > room:
            kept = data[: room - len(unread)]
            self._tally.bytes_lost += len(data) - len(kept)
            self.overflowed = True
            data = kept
        self._ring = unread + data if unread else data
        self._at = 0

    @property
    def waiting(self) -> bool:
        """Whether bytes have arrived that were not read yet."""
        return self._at < len(self._ring)

    @property
    def unread(self) -> int:
        """How many of them."""
        return len(self._ring) - self._at

    @property
    def partial(self) -> bool:
        """Whether the beginning of a line has been read, and not its end."""
        return bool(self._line) and not self.waiting

    def abandon(self) -> None:
        """Throw away the beginning of a line whose end has not come."""
        self._tally.bytes_flushed += len(self._line)
        self._line = b""

    def flush(self) -> None:
        """Throw away everything that has arrived and is not a line yet."""
        self._tally.bytes_flushed += len(self._ring) - self._at + len(self._line)
        self._line = self._ring = b""
        self._at = 0

    def next(self) -> Line | None:
        """The next acceptable line; None when there is none yet, or when one was refused, see `fault`."""
        while self._at < len(self._ring):
            end = self._ring.find(b"\n", self._at)
            if end < 0:
                # What goes beyond the line buffer would be cut off in any case; kept is enough to know that
                # it did.
                self._line = (self._line + self._ring[self._at :])[: self._keep + 1]
                self._ring = b""
                self._at = 0
                return None
            raw = self._ring[self._at : end]
            self._at = end + 1
            if self._line:
                raw = self._line + raw
                self._line = b""
            line = self._judged(raw)
            if line is not None or self.refused or self.passed is not None:
                return line
        return None

    def _judged(self, raw: bytes) -> Line | None:
        """The line if it is acceptable. The shape nearly every line has gets a short way."""
        if self._front_end.takes != "next":
            return self._judged_alone(raw.partition(b";")[0][: self._keep].strip())
        match = _ORDINARY(raw)
        if match is not None and len(raw) <= self._keep and b"M110" not in raw:
            number = int(match[1])
            if number == self.last + 1 and checksum(raw[: match.end(2)]) == int(match[3]):
                self.last = number
                self.skipping = -1
                self._numbered = True
                return number, match[2].decode("latin-1").rstrip(" ")
        return self._judged_carefully(raw)

    def _judged_alone(self, command: bytes) -> Line | None:
        """A line where its number does not matter."""
        if not command or (self._front_end.takes == "right" and not _right(command)):
            return None
        number = _number(command[1:]) if command.startswith(b"N") else None
        match = _NEITHER(command)
        text = _text(match[1] if match else b"")
        self.last = self.last + 1 if number is None else number
        return (number, text) if text else None

    def _judged_carefully(self, raw: bytes) -> Line | None:
        """The same for every line that can come, see the table above."""
        front_end = self._front_end
        command = raw.partition(b";")[0][: self._keep].lstrip(b" ")
        if not command.strip():
            return None
        if not command.startswith(b"N"):
            return self._judged_stray(command)
        renumbers = b"M110" in command
        inner = command.find(b"N", 4) if renumbers else -1
        number = _number(command[max(inner, 0) + 1 :])
        body, star, check = command.rpartition(b"*")
        right = checksum(body) == _number(check) if star else not front_end.checksum_needed
        if front_end.checksum_first and not right:
            self._refuse(front_end.wrong_checksum if star else front_end.no_checksum, number)
            return None
        if number != self.last + 1 and not renumbers:
            self._judged_out_of_turn(number)
            return None
        if not right:
            self._refuse(front_end.wrong_checksum if star else front_end.no_checksum, number)
            return None
        self.last = number
        self.skipping = -1
        self._numbered = True
        prefix = _PREFIX(command)
        return number, _text(command[prefix.end() :] if prefix else command)

    def _judged_stray(self, command: bytes) -> Line | None:
        """A line without a number."""
        strays = self._front_end.strays
        if (strays == "bare" and b"*" in command) or (
            strays == "never" and self._numbered and not command.startswith(b"M112")
        ):
            self._refuse(self._front_end.no_number, 0)
            return None
        return None, _text(command)

    def _judged_out_of_turn(self, number: int) -> None:
        """A line with another number than the next: passed over if it may be a repeat, else refused."""
        front_end = self._front_end
        if self.last - front_end.repeats_dropped < number <= self.last:
            self._tally.repeats_dropped += 1
        elif self.last - front_end.repeats_skipped < number <= self.last:
            self._tally.repeats_dropped += 1
            self.passed = (f"skip {number}", "ok")
        elif self.skipping >= 0:
            self.skipping -= 1
            self.passed = ("ok",)
        else:
            self._refuse(front_end.wrong_number, number)

    def _refuse(self, why: str, number: int) -> None:
        """Take a line for bad."""
        self.fault = why.format(last=self.last, wanted=self.last + 1, got=number)
        self.refused = True
        self.skipping = self._front_end.lines_skipped or -1


def _right(command: bytes) -> bool:
    """Whether the checksum of a line is right; it need not have one."""
    body, star, check = command.rpartition(b"*")
    if not star or not command.startswith(b"N"):
        return True
    if not check.isdigit():
        return False
    return int(check) == (crc_hqx(body, 0) if len(check) == _CRC_DIGITS else checksum(body))


def checksum(data: bytes) -> int:
    """All bytes joined by exclusive or; `data` holds at most 256."""
    folded = int.from_bytes(data, "little")
    folded ^= folded >> 1024
    # Halving beats a loop over the bytes five to one, and every line of a print comes through here.
    folded ^= folded >> 512
    folded ^= folded >> 256
    folded ^= folded >> 128
    folded ^= folded >> 64
    folded ^= folded >> 32
    folded ^= folded >> 16
    folded ^= folded >> 8
    return folded & 0xFF


def _number(data: bytes) -> int:
    """The whole number at the start, 0 when there is none, as C's strtol has it."""
    match = _NUMBER(data)
    return int(match[1]) if match else 0


def _text(command: bytes) -> str:
    """The command as text; Latin-1 keeps every byte, so that garbage can be said back as it came."""
    return command.partition(b"*")[0].rstrip(b" ").decode("latin-1")
