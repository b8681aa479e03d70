"""What a streamer's session needs of a cable."""

from __future__ import annotations

from typing import Protocol

__all__ = ["Transport"]


class Transport(Protocol):
    """Bytes to and from a printer: a serial port, a socket, a simulated cable."""

    def write(self, data: bytes) -> None:
        """Hand over all bytes.

        Raises:
            PortError: the other end is gone or takes nothing.
        """

    def read(self, timeout: float) -> bytes:
        """What has come, as soon as there is something, empty after `timeout` seconds without.

        Raises:
            PortError: the other end is gone.
        """

    def close(self) -> None:
        """Let go of it; once is enough, twice does no harm."""
