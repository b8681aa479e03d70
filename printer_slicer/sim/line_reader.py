"""Read lines to execute from received bytes: receive buffer, line buffer, line number, checksum.

line begins with      number is          checksum is     result
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
"""Line number, or None, and the command without line number and checksum."""

_match_ordinary_line: Final = re.compile(rb"N(\d{1,9}) ([^;*]+)\*(\d{1,3})").fullmatch
_match_number: Final = re.compile(rb"[ \t]*([-+]?\d{1,18})").match
_match_number_prefix: Final = re.compile(rb"N[-+]?\d* *").match

_match_command: Final = re.compile(rb"(?:N[-+]?\d* *)?([^*]*)", re.DOTALL).match
_CRC_DIGITS: Final = 5

MAX_UNREAD_BYTES: Final = 65_536
"""Size of the receive buffer with flow control, bytes; a sender that does not wait loses further bytes."""


class LineReader:
    """The receive buffer and the line buffer of a firmware.

    Attributes:
        last: number of the last accepted line.
        rejection: error message for a line that `next_line` rejected; whoever sends it must clear it.
        is_rejected: whether `next_line` rejected a line; cleared together with `rejection`.
        skip_replies: replies to a line that was skipped; None without one.
        skipping: number of lines still to skip after a rejected one; negative: none.
        overflowed: whether the receive buffer overflowed.
    """

    __slots__ = (
        *(
            "_position",
            "_firmware",
            "_max_length",
            "_line",
            "_saw_number",
            "_ring",
            "_buffer_size",
            "_statistics",
        ),
        *("rejection", "last", "overflowed", "skip_replies", "is_rejected", "skipping"),
    )

    def __init__(self, firmware: SimulatedFirmware, statistics: Statistics) -> None:
        self.last = 0
        self.rejection = ""
        self.is_rejected = False
        self.skip_replies: tuple[str, ...] | None = None
        self.skipping = -1
        self.overflowed = False
        self._saw_number = False
        self._firmware = firmware
        self._max_length = firmware.line_size - 1
        self._buffer_size = MAX_UNREAD_BYTES if firmware.receive_buffer is None else firmware.receive_buffer
        self._statistics = statistics
        self._line = b""
        self._ring = b""
        self._position = 0  # number of bytes of the ring that have been read

    def add_bytes(self, data: bytes) -> None:
        """Put received bytes into the receive buffer; bytes that do not fit are lost."""
        if b"\r" in data:
            data = data.replace(b"\r", b"\n")  # both characters end a line, and empty lines are ignored
        unread = self._ring[self._position :]
        room = self._buffer_size
        if len(unread) + len(data) > room:
            kept = data[: room - len(unread)]
            self._statistics.bytes_lost += len(data) - len(kept)
            self.overflowed = True
            data = kept
        self._ring = unread + data if unread else data
        self._position = 0

    @property
    def has_unread_bytes(self) -> bool:
        """Whether the receive buffer has bytes that were not read yet."""
        return self._position < len(self._ring)

    @property
    def unread_bytes(self) -> int:
        """Number of bytes in the receive buffer that were not read yet."""
        return len(self._ring) - self._position

    @property
    def has_partial_line(self) -> bool:
        """Whether only the start of a line has been read."""
        return bool(self._line) and not self.has_unread_bytes

    def discard_partial_line(self) -> None:
        """Discard a partial line."""
        self._statistics.bytes_flushed += len(self._line)
        self._line = b""

    def flush(self) -> None:
        """Discard all received bytes that do not belong to an accepted line."""
        self._statistics.bytes_flushed += len(self._ring) - self._position + len(self._line)
        self._line = self._ring = b""
        self._position = 0

    def next_line(self) -> Line | None:
        """Return the next accepted line; None if no line is complete or it was rejected (see `rejection`)."""
        while self._position < len(self._ring):
            end = self._ring.find(b"\n", self._position)
            if end < 0:
                # Bytes beyond the line buffer would be cut off anyway; one more byte shows that the line is too long.
                self._line = (self._line + self._ring[self._position :])[: self._max_length + 1]
                self._ring = b""
                self._position = 0
                return None
            raw = self._ring[self._position : end]
            self._position = end + 1
            if self._line:
                raw = self._line + raw
                self._line = b""
            line = self._check_line(raw)
            if line is not None or self.is_rejected or self.skip_replies is not None:
                return line
        return None

    def _check_line(self, raw: bytes) -> Line | None:
        """Return a line if the firmware accepts it, else None; ordinary lines take a fast path."""
        if self._firmware.accepted_lines != "next":
            return self._check_unordered_line(raw.partition(b";")[0][: self._max_length].strip())
        match = _match_ordinary_line(raw)
        if match is not None and len(raw) <= self._max_length and b"M110" not in raw:
            number = int(match[1])
            if number == self.last + 1 and checksum(raw[: match.end(2)]) == int(match[3]):
                self.last = number
                self.skipping = -1
                self._saw_number = True
                return number, match[2].decode("latin-1").rstrip(" ")
        return self._check_numbered_line(raw)

    def _check_unordered_line(self, command: bytes) -> Line | None:
        """Return a line if a firmware that ignores the order of line numbers accepts it, else None."""
        if not command or (self._firmware.accepted_lines == "right" and not _has_valid_checksum(command)):
            return None
        number = _parse_number(command[1:]) if command.startswith(b"N") else None
        match = _match_command(command)
        text = _decode_command(match[1] if match else b"")
        self.last = self.last + 1 if number is None else number
        return (number, text) if text else None

    def _check_numbered_line(self, raw: bytes) -> Line | None:
        """Return a numbered line if the table at the top of this module accepts it, else None."""
        firmware = self._firmware
        command = raw.partition(b";")[0][: self._max_length].lstrip(b" ")
        if not command.strip():
            return None
        if not command.startswith(b"N"):
            return self._check_unnumbered_line(command)
        renumbers = b"M110" in command
        inner = command.find(b"N", 4) if renumbers else -1
        number = _parse_number(command[max(inner, 0) + 1 :])
        body, star, check = command.rpartition(b"*")
        right = checksum(body) == _parse_number(check) if star else not firmware.checksum_needed
        if firmware.checksum_first and not right:
            self._reject(firmware.wrong_checksum if star else firmware.no_checksum, number)
            return None
        if number != self.last + 1 and not renumbers:
            self._handle_wrong_number(number)
            return None
        if not right:
            self._reject(firmware.wrong_checksum if star else firmware.no_checksum, number)
            return None
        self.last = number
        self.skipping = -1
        self._saw_number = True
        prefix = _match_number_prefix(command)
        return number, _decode_command(command[prefix.end() :] if prefix else command)

    def _check_unnumbered_line(self, command: bytes) -> Line | None:
        """Return a line without a line number if the firmware accepts it, else None."""
        strays = self._firmware.unnumbered_lines
        if (strays == "bare" and b"*" in command) or (
            strays == "never" and self._saw_number and not command.startswith(b"M112")
        ):
            self._reject(self._firmware.no_number, 0)
            return None
        return None, _decode_command(command)

    def _handle_wrong_number(self, number: int) -> None:
        """Skip a line with a wrong number if the line may be a repetition; else reject the line."""
        firmware = self._firmware
        if self.last - firmware.repeats_dropped < number <= self.last:
            self._statistics.repeats_dropped += 1
        elif self.last - firmware.repeats_skipped < number <= self.last:
            self._statistics.repeats_dropped += 1
            self.skip_replies = (f"skip {number}", "ok")
        elif self.skipping >= 0:
            self.skipping -= 1
            self.skip_replies = ("ok",)
        else:
            self._reject(firmware.wrong_number, number)

    def _reject(self, message: str, number: int) -> None:
        """Reject a line with this number, and store the error message."""
        self.rejection = message.format(last=self.last, wanted=self.last + 1, got=number)
        self.is_rejected = True
        self.skipping = self._firmware.lines_skipped or -1


def _has_valid_checksum(command: bytes) -> bool:
    """Return whether a line has a correct checksum or no checksum."""
    body, star, check = command.rpartition(b"*")
    if not star or not command.startswith(b"N"):
        return True
    if not check.isdigit():
        return False
    return int(check) == (crc_hqx(body, 0) if len(check) == _CRC_DIGITS else checksum(body))


def checksum(data: bytes) -> int:
    """Return the XOR of all bytes of `data`, at most 256 bytes."""
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


def _parse_number(data: bytes) -> int:
    """Return the integer at the start of `data`, or 0 without one, as C's strtol does."""
    match = _match_number(data)
    return int(match[1]) if match else 0


def _decode_command(command: bytes) -> str:
    """Return the command as text; Latin-1 preserves every byte, so damaged text can be echoed unchanged."""
    return command.partition(b"*")[0].rstrip(b" ").decode("latin-1")
