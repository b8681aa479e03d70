"""Turn received bytes into lines to execute: buffer, line, number, checksum.

line begins with      number is          checksum is     then
anything else         -                  -               accepted, even with `*..` at its end
N                     not last + 1       -               rejected, or dropped if it repeats a recent one
N                     last + 1           absent          rejected
N                     last + 1           wrong           rejected
N                     last + 1           right           accepted
N, with M110          anything           as above        accepted; the N of M110 counts, not that of the line

This is for firmwares that take the "next" line. Those that take any "right" line accept a right checksum or none, and
drop other lines silently. Those that take "any" ignore number and checksum.
"""

from __future__ import annotations

import re
from binascii import crc_hqx
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from printer_slicer.sim.firmwares import SimulatedFirmware
    from printer_slicer.sim.statistics import Statistics

__all__ = ["Line", "LineReader", "checksum"]

Line = tuple[int | None, str]
"""Line number, None without one, and the command without number and checksum."""

_ORDINARY: Final = re.compile(rb"N(\d{1,9}) ([^;*]+)\*(\d{1,3})").fullmatch
_NUMBER: Final = re.compile(rb"[ \t]*([-+]?\d{1,18})").match
_PREFIX: Final = re.compile(rb"N[-+]?\d* *").match

_NEITHER: Final = re.compile(rb"(?:N[-+]?\d* *)?([^*]*)", re.DOTALL).match
_CRC_DIGITS: Final = 5

MOST_UNREAD: Final = 65_536
"""Bytes kept with flow control; the sender has to wait, and further bytes are lost."""


class LineReader:
    """The receive buffer and the line buffer of a firmware.

    Attributes:
        last: number of the last accepted line.
        fault: error message for a line that `next` rejected; the reader of it clears it.
        refused: whether `next` rejected a line; the reader of it clears it.
        passed: replies to a line that was skipped; None if none was.
        skipping: lines still to skip after a rejected one; negative if none.
        overflowed: whether the buffer overflowed.
    """

    __slots__ = (
        *("_at", "_firmware", "_keep", "_line", "_numbered", "_ring", "_room", "_statistics"),
        *("fault", "last", "overflowed", "passed", "refused", "skipping"),
    )

    def __init__(self, firmware: SimulatedFirmware, statistics: Statistics) -> None:
        self.last = 0
        self.fault = ""
        self.refused = False
        self.passed: tuple[str, ...] | None = None
        self.skipping = -1
        self.overflowed = False
        self._numbered = False
        self._firmware = firmware
        self._keep = firmware.line_size - 1
        self._room = MOST_UNREAD if firmware.receive_buffer is None else firmware.receive_buffer
        self._statistics = statistics
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
            self._statistics.bytes_lost += len(data) - len(kept)
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
        """Number of bytes not read yet."""
        return len(self._ring) - self._at

    @property
    def partial(self) -> bool:
        """Whether only the start of a line has been read."""
        return bool(self._line) and not self.waiting

    def abandon(self) -> None:
        """Discard a partial line."""
        self._statistics.bytes_flushed += len(self._line)
        self._line = b""

    def flush(self) -> None:
        """Discard all received bytes that are no accepted line yet."""
        self._statistics.bytes_flushed += len(self._ring) - self._at + len(self._line)
        self._line = self._ring = b""
        self._at = 0

    def next(self) -> Line | None:
        """Return the next accepted line; None if there is none yet, or one was rejected (see `fault`)."""
        while self._at < len(self._ring):
            end = self._ring.find(b"\n", self._at)
            if end < 0:
                # The rest beyond the line buffer would be cut off anyway; one byte more shows that it was.
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
        """Return a line if it is accepted, with a fast path for ordinary lines."""
        if self._firmware.takes != "next":
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
        """Return a line if it is accepted by a firmware that ignores the order of numbers."""
        if not command or (self._firmware.takes == "right" and not _right(command)):
            return None
        number = _number(command[1:]) if command.startswith(b"N") else None
        match = _NEITHER(command)
        text = _text(match[1] if match else b"")
        self.last = self.last + 1 if number is None else number
        return (number, text) if text else None

    def _judged_carefully(self, raw: bytes) -> Line | None:
        """Return a line if it is accepted, by the table above."""
        firmware = self._firmware
        command = raw.partition(b";")[0][: self._keep].lstrip(b" ")
        if not command.strip():
            return None
        if not command.startswith(b"N"):
            return self._judged_stray(command)
        renumbers = b"M110" in command
        inner = command.find(b"N", 4) if renumbers else -1
        number = _number(command[max(inner, 0) + 1 :])
        body, star, check = command.rpartition(b"*")
        right = checksum(body) == _number(check) if star else not firmware.checksum_needed
        if firmware.checksum_first and not right:
            self._refuse(firmware.wrong_checksum if star else firmware.no_checksum, number)
            return None
        if number != self.last + 1 and not renumbers:
            self._judged_out_of_turn(number)
            return None
        if not right:
            self._refuse(firmware.wrong_checksum if star else firmware.no_checksum, number)
            return None
        self.last = number
        self.skipping = -1
        self._numbered = True
        prefix = _PREFIX(command)
        return number, _text(command[prefix.end() :] if prefix else command)

    def _judged_stray(self, command: bytes) -> Line | None:
        """Return a line without a number if it is accepted."""
        strays = self._firmware.strays
        if (strays == "bare" and b"*" in command) or (
            strays == "never" and self._numbered and not command.startswith(b"M112")
        ):
            self._refuse(self._firmware.no_number, 0)
            return None
        return None, _text(command)

    def _judged_out_of_turn(self, number: int) -> None:
        """Handle a line out of order: skip it if it may be a repeat, else reject it."""
        firmware = self._firmware
        if self.last - firmware.repeats_dropped < number <= self.last:
            self._statistics.repeats_dropped += 1
        elif self.last - firmware.repeats_skipped < number <= self.last:
            self._statistics.repeats_dropped += 1
            self.passed = (f"skip {number}", "ok")
        elif self.skipping >= 0:
            self.skipping -= 1
            self.passed = ("ok",)
        else:
            self._refuse(firmware.wrong_number, number)

    def _refuse(self, why: str, number: int) -> None:
        """Reject a line."""
        self.fault = why.format(last=self.last, wanted=self.last + 1, got=number)
        self.refused = True
        self.skipping = self._firmware.lines_skipped or -1


def _right(command: bytes) -> bool:
    """Return whether a line has a correct checksum or none."""
    body, star, check = command.rpartition(b"*")
    if not star or not command.startswith(b"N"):
        return True
    if not check.isdigit():
        return False
    return int(check) == (crc_hqx(body, 0) if len(check) == _CRC_DIGITS else checksum(body))


def checksum(data: bytes) -> int:
    """Return the XOR of all bytes; `data` has at most 256."""
    folded = int.from_bytes(data, "little")
    folded ^= folded >> 1024
    # Halving is five times faster than a loop over the bytes, and every line of a print needs it.
    folded ^= folded >> 512
    folded ^= folded >> 256
    folded ^= folded >> 128
    folded ^= folded >> 64
    folded ^= folded >> 32
    folded ^= folded >> 16
    folded ^= folded >> 8
    return folded & 0xFF


def _number(data: bytes) -> int:
    """Return the integer at the start, 0 without one, as C's strtol does."""
    match = _NUMBER(data)
    return int(match[1]) if match else 0


def _text(command: bytes) -> str:
    """Return the command as text; Latin-1 keeps every byte, so damaged text can be echoed unchanged."""
    return command.partition(b"*")[0].rstrip(b" ").decode("latin-1")
