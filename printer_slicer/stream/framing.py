"""From a command to a line on the wire: number in front, checksum behind.

The form is `N<number> <command>*<xor of all bytes before the star>`; RepRapFirmware also knows a CRC of 16 bits
there, which it tells from the other by its five digits. Firmware cuts longer lines without a word, which takes
the checksum away, so a numbered line that is too long can never get through.

Source: Marlin documentation, "G-code: line numbers and checksums"; MAX_CMD_SIZE 96 holds 95 bytes. Duet3D's
G-code dictionary, "Line numbers and checksums"; the polynomial is x^16 + x^12 + x^5 + 1, beginning with 0.
"""

from __future__ import annotations

from binascii import crc_hqx
from typing import TYPE_CHECKING, Final

from printer_slicer.errors import UsageError
from printer_slicer.gcode.lexer import strip

if TYPE_CHECKING:
    from collections.abc import Sequence

__all__ = ["LONGEST", "check_commands", "checksum", "command_room", "frame", "frame_crc"]

LONGEST: Final = 95
"""Bytes of a numbered line, without its line break."""

_FRAME_ROOM: Final = 15  # b"N", nine digits, a blank, a star, three digits


def checksum(data: bytes) -> int:
    """Exclusive or of all bytes, 0 to 255."""
    bits = int.from_bytes(data, "little")
    # Folded in halves, which is quicker than a loop over the bytes; what is longer than 256 of them is folded first.
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
    """The line on the wire, without its line break."""
    body = b"N%d %s" % (number, command)
    return b"%s*%d" % (body, checksum(body))


def frame_crc(number: int, command: bytes) -> bytes:
    """The same with a CRC of 16 bits, five digits, instead of the exclusive or."""
    body = b"N%d %s" % (number, command)
    return b"%s*%05d" % (body, crc_hqx(body, 0))


def command_room(number: int, room: int) -> int:
    """Bytes that a command may have so that its line with this number, and its line break, has `room`."""
    return room - len(b"N%d *255\n" % number)


def check_commands(commands: Sequence[bytes], longest: int = LONGEST) -> None:
    """Refuse what can never be sent, before anything is.

    Args:
        commands: as they stand in the job.
        longest: bytes that the firmware reads of a line.

    Raises:
        UsageError: a line is too long together with number and checksum, or holds a line break or a NUL.
    """
    for index, command in enumerate(commands):
        # Nearly all lines are short and clean: look closer only at the others.
        if len(command) > LONGEST - _FRAME_ROOM or b"\n" in command or b"\r" in command or b"\0" in command:
            _check_command(index, strip(command), longest - _FRAME_ROOM)


def _check_command(index: int, command: bytes, room: int) -> None:
    shown = command[:40].decode(errors="replace")
    if any(break_ in command for break_ in (b"\n", b"\r", b"\0")):
        message = f"line {index + 1} holds a line break or a NUL inside: {shown!r}"
        raise UsageError(message, remedy="give one command per line")
    if len(command) > room:
        message = f"line {index + 1} is {len(command)} bytes long: {shown!r}..."
        raise UsageError(message, remedy=f"printers cut lines silently; shorten it to {room} bytes")
