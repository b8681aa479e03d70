"""The server side of RFC 2217: baud rate, parity and control lines over Telnet, implemented with pyserial.

Settings of the host are acknowledged and have no effect, as at a USB port. DTR does not reset the printer.
"""

from __future__ import annotations

from struct import error as struct_error
from typing import Any, Final

import serial
from serial import rfc2217

__all__ = ["Rfc2217Server"]

_LONGEST: Final = 1024
"""Maximum bytes of a setting; real ones have at most five."""


class Rfc2217Server:
    """Speaks RFC 2217 with one host."""

    def __init__(self) -> None:
        self._answers = b""
        # A dummy port that keeps the settings of the host.
        port: Any = serial.serial_for_url("loop://")
        self._manager: Any = rfc2217.PortManager(port, self)  # type: ignore[arg-type] # it only wants `write`

    def write(self, data: bytes) -> None:
        """Collect protocol bytes for `answers`."""
        self._answers += data

    def answers(self) -> bytes:
        """Return protocol bytes to send to the host."""
        answers, self._answers = self._answers, b""
        return answers

    def decode(self, data: bytes) -> bytes:
        """Return the bytes for the printer.

        Raises:
            ValueError: the data is not RFC 2217.
        """
        try:
            out = b"".join(self._manager.filter(data))
        except (struct_error, IndexError, KeyError, TypeError, serial.SerialException) as error:
            raise ValueError(str(error)) from error
        if len(self._manager.suboption or b"") > _LONGEST:
            raise ValueError("a setting that does not end")
        return out

    def encode(self, data: bytes) -> bytes:
        """Return bytes of the printer with Telnet control bytes doubled."""
        return b"".join(self._manager.escape(data))
