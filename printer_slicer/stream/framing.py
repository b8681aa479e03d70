"""From a line of a file to a line on the wire: comment cut, number in front, checksum behind.

The form is `N<number> <command>*<xor of all bytes before the star>`. Firmware cuts longer lines without a
word, which takes the checksum away, so a numbered line that is too long can never get through.

Source: Marlin documentation, "G-code: line numbers and checksums"; MAX_CMD_SIZE 96 holds 95 bytes.
"""

from __future__ import annotations

import re
from functools import reduce
from operator import xor
from typing import TYPE_CHECKING, Final

from printer_slicer.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Sequence

__all__ = ["LONGEST", "check_commands", "checksum", "command_room", "frame", "strip"]

LONGEST: Final = 95
"""Bytes of a numbered line, without its line break."""

_FRAME_ROOM: Final = 15  # b"N", nine digits, a blank, a star, three digits
_NUMBERED: Final = re.compile(rb"N\d+\s*")
_CHECKED: Final = re.compile(rb"\s*\*\d{1,3}$")
_SETS_NUMBER: Final = re.compile(rb"M110(?!\d)")


def checksum(data: bytes) -> int:
    """Exclusive or of all bytes, 0 to 255."""
    return reduce(xor, data, 0)


def strip(command: bytes) -> bytes:
    """What the printer needs of a line: no comment, no blanks around it, no number or checksum of its own.

    Empty when nothing is left, and for M110, which would set another line number behind the host's back.
    """
    if b";" in command:
        command = command[: command.index(b";")]
    command = command.strip()
    if command.startswith(b"N"):
        command = _NUMBERED.sub(b"", command, count=1)
        command = _CHECKED.sub(b"", command, count=1)
    if command.startswith(b"M110") and _SETS_NUMBER.match(command):
        return b""
    return command


def frame(number: int, command: bytes) -> bytes:
    """The line on the wire, without its line break."""
    body = b"N%d %s" % (number, command)
    return b"%s*%d" % (body, checksum(body))


def command_room(number: int, room: int) -> int:
    """Bytes that a command may have so that its line with this number, and its line break, has `room`."""
    return room - len(b"N%d *255\n" % number)


def check_commands(commands: Sequence[bytes]) -> None:
    """Refuse what can never be sent, before anything is.

    Raises:
        UsageError: a line is too long together with number and checksum, or holds a line break or a NUL.
    """
    for index, command in enumerate(commands):
        # Nearly all lines are short and clean: look closer only at the others.
        if len(command) > LONGEST - _FRAME_ROOM or b"\n" in command or b"\r" in command or b"\0" in command:
            _check_command(index, strip(command))


def _check_command(index: int, command: bytes) -> None:
    shown = command[:40].decode(errors="replace")
    if any(break_ in command for break_ in (b"\n", b"\r", b"\0")):
        message = f"line {index + 1} holds a line break or a NUL inside: {shown!r}"
        raise UsageError(message, remedy="give one command per line")
    if len(command) > LONGEST - _FRAME_ROOM:
        message = f"line {index + 1} is {len(command)} bytes long: {shown!r}..."
        room = LONGEST - _FRAME_ROOM
        raise UsageError(message, remedy=f"printers cut lines silently; shorten it to {room} bytes")
