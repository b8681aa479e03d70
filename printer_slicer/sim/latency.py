"""The latency timer of a USB to serial chip.

A packet is sent to the computer when it has 62 bytes, or when the timer expires, which restarts with every packet. FTDI
chips use 16 ms by default, which dominates the time of a host that waits for every reply.

Source: FTDI, AN232B-04, "Data throughput, latency and handshaking".
"""

from __future__ import annotations

from math import floor, inf
from typing import Final

__all__ = ["PACKET", "LatencyTimer"]

PACKET: Final = 62
"""Bytes of a full packet; two more hold the line status."""


class LatencyTimer:
    """Delays bytes to the computer.

    Args:
        seconds: period of the timer; 0: no such chip.
    """

    def __init__(self, seconds: float) -> None:
        self._seconds = seconds
        self._held = b""
        self._ready = b""
        self._last = 0.0  # when a packet was sent
        self._due = inf

    def arrive(self, data: bytes, at: float) -> None:
        """Take bytes from the serial line; the last one arrived at `at`, s."""
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
        """Return what reaches the computer by `now`, s."""
        if self._held and self._due <= now:
            self._ready += self._held
            self._held = b""
            self._last, self._due = self._due, inf
        ready, self._ready = self._ready, b""
        return ready

    def due(self) -> float:
        """Return when the timer expires, s; infinite if no bytes wait."""
        return self._due
