"""The latency timer of a USB to serial chip.

The chip sends a packet to the computer when it has 62 bytes or when the timer expires. The timer restarts with every
packet. FTDI chips use 16 ms by default, which dominates the time of a host that waits for every reply.

Source: FTDI, AN232B-04, "Data throughput, latency and handshaking".
"""

from __future__ import annotations

from math import floor, inf
from typing import Final

__all__ = ["PACKET_BYTES", "LatencyTimer"]

PACKET_BYTES: Final = 62
"""Number of data bytes in a full packet; two more bytes hold the line status."""


class LatencyTimer:
    """Delays bytes on their way to the computer, as the latency timer of the chip does.

    Args:
        seconds: period of the timer, s; 0: no delay.
    """

    def __init__(self, seconds: float) -> None:
        self._seconds = seconds
        self._waiting = b""
        self._ready = b""
        self._last = 0.0  # time of the last packet, s
        self._due = inf

    def add_bytes(self, data: bytes, at: float) -> None:
        """Add bytes from the serial line; the last byte arrived at `at`, s."""
        if self._seconds <= 0.0:
            self._ready += data
            return
        self._waiting += data
        full = len(self._waiting) - len(self._waiting) % PACKET_BYTES
        if full:
            self._ready += self._waiting[:full]
            self._waiting = self._waiting[full:]
            self._last = at
        self._due = inf
        if self._waiting:
            ticks = floor((at - self._last) / self._seconds) + 1
            self._due = max(self._last + ticks * self._seconds, at)

    def take_arrived_bytes(self, now: float) -> bytes:
        """Return the bytes that have reached the computer until `now`, s, since the last call."""
        if self._waiting and self._due <= now:
            self._ready += self._waiting
            self._waiting = b""
            self._last, self._due = self._due, inf
        ready, self._ready = self._ready, b""
        return ready

    def next_event_time(self) -> float:
        """Return the time, s, at which the timer expires; infinite if there are no bytes to send."""
        return self._due
