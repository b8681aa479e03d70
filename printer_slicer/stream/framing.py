"""Framing of commands: a line number in front and a checksum behind.

The form is `N<number> <command>*<xor of all bytes before the star>`. RepRapFirmware also accepts a CRC-16, which it
recognizes by its five digits. Firmware silently truncates lines that are too long and so loses their checksum.
Therefore a numbered line that is too long is never accepted.

Source: Marlin documentation, "G-code: line numbers and checksums"; MAX_CMD_SIZE 96 holds 95 bytes. Duet3D's
G-code dictionary, "Line numbers and checksums"; the polynomial is x^16 + x^12 + x^5 + 1, with initial value 0.
"""

from __future__ import annotations

from binascii import crc_hqx
from typing import TYPE_CHECKING, Final

from printer_slicer.errors import UsageError
from printer_slicer.gcode.lexer import strip

if TYPE_CHECKING:
    from collections.abc import Sequence

__all__ = [
    "MAX_LINE_BYTES",
    "check_commands",
    "compute_checksum",
    "find_max_command_length",
    "frame",
    "frame_with_crc",
]

MAX_LINE_BYTES: Final = 95
"""Maximum length of a numbered line in bytes, without its line break."""

_FRAME_BYTES: Final = 15  # b"N", nine digits, a space, a star, three digits


def compute_checksum(data: bytes) -> int:
    """Return the XOR of all bytes of a line, 0 to 255."""
    bits = int.from_bytes(data, "little")
    # XOR the two halves of the number repeatedly, which is faster than a loop; reduce long data to 256 bytes first.
    while bits >> 2048:
        bits = (bits >> 2048) ^ (bits & (1 << 2048) - 1)
    bits ^= bits >> 1024
    bits ^= bits >> 512
    bits ^= bits >> 256
    bits ^= bits >> 128
    bits ^= bits >> 64
    bits ^= bits >> 32
    bits ^= bits >> 16
    bits ^= bits >> 8
    return bits & 0xFF


def frame(number: int, command: bytes) -> bytes:
    """Return a numbered line with its XOR checksum, without its line break."""
    body = b"N%d %s" % (number, command)
    return b"%s*%d" % (body, compute_checksum(body))


def frame_with_crc(number: int, command: bytes) -> bytes:
    """Return a numbered line with a CRC-16 of five digits, without its line break."""
    body = b"N%d %s" % (number, command)
    return b"%s*%05d" % (body, crc_hqx(body, 0))


def find_max_command_length(number: int, line_bytes: int) -> int:
    """Return the maximum length of a command whose numbered line, with its line break, fits into `line_bytes`."""
    return line_bytes - len(b"N%d *255\n" % number)


def check_commands(commands: Sequence[bytes], max_line_bytes: int = MAX_LINE_BYTES) -> None:
    """Reject commands that cannot be sent over a serial line.

    Args:
        commands: entries of the job.
        max_line_bytes: maximum length of a line that the firmware reads, in bytes.

    Raises:
        UsageError: a line is too long with its number and checksum, or contains a line break or a NUL.
    """
    for index, command in enumerate(commands):
        # Nearly all lines are short and valid: check only long or suspicious lines in detail.
        if (
            len(command) > MAX_LINE_BYTES - _FRAME_BYTES
            or b"\n" in command
            or b"\r" in command
            or b"\0" in command
        ):
            _check_command(index, strip(command), max_line_bytes - _FRAME_BYTES)


def _check_command(index: int, command: bytes, max_length: int) -> None:
    """Reject a command that contains a line break or a NUL, or is longer than `max_length` bytes."""
    shown = command[:40].decode(errors="replace")
    if any(break_ in command for break_ in (b"\n", b"\r", b"\0")):
        message = f"line {index + 1} contains a line break or a NUL: {shown!r}"
        raise UsageError(message, remedy="Put each command on its own line")
    if len(command) > max_length:
        message = f"line {index + 1} is {len(command)} bytes long: {shown!r}..."
        raise UsageError(
            message, remedy=f"Shorten the line to {max_length} bytes; printers truncate longer lines silently"
        )
