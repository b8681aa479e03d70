"""RFC 2217 at the printer's end: speed, parity and control lines told over Telnet. pyserial does the talking.

What a host sets is acknowledged and means nothing, as at a USB port. Raising DTR resets nothing.
"""

from __future__ import annotations

from struct import error as struct_error
from typing import Any, Final

import serial
from serial import rfc2217

__all__ = ["Negotiator"]

_LONGEST: Final = 1024
"""Bytes of one setting; no real one has more than five."""


class Negotiator:
    """Speaks RFC 2217 with one host."""

    def __init__(self) -> None:
        self._answers = b""
        # A port that is no device, to keep what the host sets.
        port: Any = serial.serial_for_url("loop://")
        self._manager: Any = rfc2217.PortManager(port, self)  # type: ignore[arg-type] # it only wants `write`

    def write(self, data: bytes) -> None:
        """What the protocol says; `answers` gives it."""
        self._answers += data

    def answers(self) -> bytes:
        """What is to be said to the host on the protocol's account."""
        answers, self._answers = self._answers, b""
        return answers

    def taken_apart(self, data: bytes) -> bytes:
        """The bytes for the printer, of those that came.

        Raises:
            ValueError: this is no RFC 2217.
        """
        try:
            out = b"".join(self._manager.filter(data))
        except (struct_error, IndexError, KeyError, TypeError, serial.SerialException) as error:
            raise ValueError(str(error)) from error
        if len(self._manager.suboption or b"") > _LONGEST:
            raise ValueError("a setting that does not end")
        return out

    def put_together(self, data: bytes) -> bytes:
        """The printer's bytes as they go out: one that has a meaning in Telnet goes twice."""
        return b"".join(self._manager.escape(data))
