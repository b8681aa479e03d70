"""The server side of RFC 2217: baud rate, parity and control lines over Telnet, implemented with pyserial.

Settings of the host are acknowledged but have no effect, as at a USB port. DTR does not reset the printer.
"""

from __future__ import annotations

from struct import error as struct_error
from typing import Any, Final

import serial
from serial import rfc2217

__all__ = ["Rfc2217Server"]

_MAX_OPTION_BYTES: Final = 1024
"""Maximum length of a Telnet option, bytes; valid ones have at most five."""


class Rfc2217Server:
    """The RFC 2217 protocol on the connection to one host, with its current state."""

    def __init__(self) -> None:
        self._answers = b""
        # A dummy port, which only stores the settings of the host.
        port: Any = serial.serial_for_url("loop://")
        self._manager: Any = rfc2217.PortManager(port, self)  # type: ignore[arg-type] # it calls only `write`

    def write(self, data: bytes) -> None:
        """Store protocol bytes for the host; `take_answers` returns them."""
        self._answers += data

    def take_answers(self) -> bytes:
        """Return the stored protocol bytes, which must be sent to the host."""
        answers, self._answers = self._answers, b""
        return answers

    def decode(self, data: bytes) -> bytes:
        """Return the bytes for the printer that data from the host contains.

        Raises:
            ValueError: the data violates RFC 2217.
        """
        try:
            out = b"".join(self._manager.filter(data))
        except (struct_error, IndexError, KeyError, TypeError, serial.SerialException) as error:
            raise ValueError(str(error)) from error
        if len(self._manager.suboption or b"") > _MAX_OPTION_BYTES:
            raise ValueError("a Telnet option is too long")
        return out

    def encode(self, data: bytes) -> bytes:
        """Return bytes of the printer for the host, with Telnet control bytes doubled."""
        return b"".join(self._manager.escape(data))
