"""The chip between a serial line and USB: it sends what has come in packets, and small ones only when its timer ends.

A packet goes to the computer when 62 bytes are there, or when the timer ends, which runs anew from every packet. FTDI's
chips come with 16 ms, which is most of what a host that waits for every answer waits for.

Source: FTDI, AN232B-04, "Data throughput, latency and handshaking".
"""

from __future__ import annotations

from math import floor, inf
from typing import Final

__all__ = ["PACKET", "LatencyTimer"]

PACKET: Final = 62
"""Bytes of a full packet; two more tell the state of the lines."""


class LatencyTimer:
    """Holds bytes on their way to the computer.

    Args:
        seconds: of the timer; 0 = there is no such chip.
    """

    def __init__(self, seconds: float) -> None:
        self._seconds = seconds
        self._held = b""
        self._ready = b""
        self._last = 0.0  # when a packet was sent
        self._due = inf

    def arrive(self, data: bytes, at: float) -> None:
        """Bytes from the serial line; the last of them came at `at`, s."""
        if self._seconds <= 0.0:
            self._ready += data
            return
        self._held += data
        full = len(self._held) - len(self._held) % PACKET
        if full:
            self._ready += self._held[:full]
            self._held = self._held[full:]
            self._last = at
        self._due = inf
        if self._held:
            ticks = floor((at - self._last) / self._seconds) + 1
            self._due = max(self._last + ticks * self._seconds, at)

    def release(self, now: float) -> bytes:
        """What the computer has by `now`, s."""
        if self._held and self._due <= now:
            self._ready += self._held
            self._held = b""
            self._last, self._due = self._due, inf
        ready, self._ready = self._ready, b""
        return ready

    def due(self) -> float:
        """When the timer ends, s; infinite when nothing is held."""
        return self._due
