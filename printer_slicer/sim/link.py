"""The cable between a host and a simulated printer in the same process, with simulated time."""

from __future__ import annotations

from collections import deque
from math import inf
from typing import TYPE_CHECKING, Final, NamedTuple

from printer_slicer.errors import PortError
from printer_slicer.sim.cable_noise import CableNoise, Direction, RandomSource
from printer_slicer.sim.latency import LatencyTimer

if TYPE_CHECKING:
    from collections.abc import Callable

    from printer_slicer.sim.faults import Faults
    from printer_slicer.sim.printer import SimulatedPrinter

__all__ = ["Cable", "CableNoise", "Direction", "RandomSource", "VirtualPort", "Wire"]

MAX_BYTES_IN_TRANSIT: Final = 8192
"""Maximum number of bytes in transit; beyond it a sender waits, as with an operating system's buffers."""

BITS_PER_BYTE: Final = 10
"""A start bit, 8 data bits and a stop bit."""


class _Chunk(NamedTuple):
    """Bytes in transit, with the arrival time of the first byte, s, and the time from byte to byte, s."""

    first: float
    each: float
    data: bytes


class Wire:
    """One direction of a cable.

    Args:
        baud: baud rate; a byte takes ten bits. None: bytes take no time.
        latency: additional delay of each byte, s.

    Attributes:
        byte_seconds: time between consecutive bytes, s.
    """

    def __init__(self, baud: int | None = None, latency: float = 0.0) -> None:
        self.byte_seconds = BITS_PER_BYTE / baud if baud else 0.0
        self._latency = latency
        self._free = 0.0  # time at which the sender can send again, s
        self._chunks: deque[_Chunk] = deque()

    def push(self, data: bytes, now: float) -> None:
        """Send bytes at `now`, s."""
        if data:
            start = max(now, self._free)
            self._free = start + len(data) * self.byte_seconds
            self._chunks.append(_Chunk(start + self.byte_seconds + self._latency, self.byte_seconds, data))

    def pop(self, now: float) -> tuple[bytes, float] | None:
        """Return bytes arrived until `now`, s, and the arrival time of the last, s; None without bytes."""
        if not self._chunks or self._chunks[0].first > now:
            return None
        first, each, data = self._chunks.popleft()
        n = len(data)
        if first + (n - 1) * each > now:
            n = int((now - first) / each) + 1
            # Division and multiplication round differently; `next_event_time` multiplies.
            while first + (n - 1) * each > now:
                n -= 1
            while first + n * each <= now:
                n += 1
            self._chunks.appendleft(_Chunk(first + n * each, each, data[n:]))
            data = data[:n]
        return data, first + (n - 1) * each

    @property
    def bytes_in_transit(self) -> int:
        """Number of bytes that have not arrived yet."""
        return sum(len(chunk.data) for chunk in self._chunks)

    def next_event_time(self) -> float:
        """Return when the next line or chunk will have arrived, s; infinite if nothing is in transit."""
        if not self._chunks:
            return inf
        first, each, data = self._chunks[0]
        end = data.find(b"\n")
        return first + (end if end >= 0 else len(data) - 1) * each


class Cable:
    """The cable between a host and a simulated printer, in both directions; the caller provides the time.

    Args:
        printer: printer at the other end.
        baud: baud rate of both directions; None: bytes take no time.
        latency: additional delay of each byte in each direction, s.
        noise: function that damages bytes when they are sent, see `CableNoise`.
        timer: period of the latency timer of a USB chip, s, see `LatencyTimer`.
    """

    def __init__(
        self,
        printer: SimulatedPrinter,
        *,
        baud: int | None = None,
        latency: float = 0.0,
        noise: Callable[[bytes, Direction], bytes] | None = None,
        timer: float = 0.0,
    ) -> None:
        self._printer = printer
        self._to_printer = Wire(baud, latency)
        self._to_host = Wire(baud, latency)
        self._chip = LatencyTimer(timer) if timer > 0.0 else None
        self._noise = noise

    def write(self, data: bytes, now: float) -> None:
        """Send bytes to the printer at `now`, s."""
        if self._noise is not None:
            data = self._noise(data, "to printer")
        self._to_printer.push(data, now)

    def read(self, now: float) -> bytes:
        """Simulate until `now`, s, and return the bytes that reach the host.

        Call it at every time that `next_event_time` returns; otherwise events occur in the wrong order.
        """
        while (part := self._to_printer.pop(now)) is not None:
            data, at = part
            wakeup = self._printer.wakeup()
            if wakeup is not None and wakeup <= at:
                # Bytes that arrived before an event of the printer must be in its buffer at that event. All but
                # the last byte arrived earlier.
                self._printer.receive(data[:-1], at - self._to_printer.byte_seconds)
                data = data[-1:]
            self._printer.receive(data, at)
        replies = self._printer.send(now)
        if replies:
            self._to_host.push(replies if self._noise is None else self._noise(replies, "to host"), now)
        chip = self._chip
        come = b""
        while (part := self._to_host.pop(now)) is not None:
            if chip is None:
                come += part[0]
            else:
                chip.add_bytes(*part)
        return come if chip is None else chip.take_arrived_bytes(now)

    def next_event_time(self) -> float:
        """Return the time of the next event at either end of the cable, s; infinite without events."""
        wakeup = self._printer.wakeup()
        due = min(
            self._to_printer.next_event_time(),
            self._to_host.next_event_time(),
            inf if wakeup is None else wakeup,
        )
        return due if self._chip is None else min(due, self._chip.next_event_time())

    @property
    def is_full(self) -> bool:
        """Whether the cable is so full that a sender with flow control has to wait."""
        return self._to_printer.bytes_in_transit + self._printer.unread_bytes > MAX_BYTES_IN_TRANSIT


class VirtualPort:
    """A serial port in simulated time, with a simulated printer at the other end.

    Time passes only while the host reads, until there are bytes to read or until the timeout. `now` is the clock for
    the host.

    Args:
        printer: printer at the other end.
        baud, latency, noise, timer: as for `Cable`.
        started: start time, s; needed for a second port to a running printer.
        faults: faults to inject, instead of `noise`; the printer must get the same ones.
    """

    def __init__(  # noqa: PLR0913 - all but one have a good default
        self,
        printer: SimulatedPrinter,
        *,
        baud: int | None = None,
        latency: float = 0.0,
        noise: Callable[[bytes, Direction], bytes] | None = None,
        started: float = 0.0,
        faults: Faults | None = None,
        timer: float = 0.0,
    ) -> None:
        self._cable = Cable(printer, baud=baud, latency=latency, noise=noise or faults, timer=timer)
        self._faults = faults
        self._now = started
        self._open = True

    def now(self) -> float:
        """Simulated time, s."""
        return self._now

    def write(self, data: bytes) -> None:
        """Send bytes to the printer; the simulated time stays the same.

        Raises:
            PortError: the port is closed.
        """
        self._check_connection()
        self._cable.write(data, self._now)

    def read(self, timeout: float) -> bytes:
        """Wait for bytes, at most `timeout` seconds; return empty bytes if none arrive.

        Raises:
            PortError: the port is closed.
        """
        self._check_connection()
        deadline = self._now + timeout
        while True:
            data = self._cable.read(self._now)
            if self._faults is not None:
                self._check_connection()
            if data or self._now >= deadline:
                return data
            self._now = min(deadline, max(self._cable.next_event_time(), self._now))

    def close(self) -> None:
        """Close the port, which stops all transfers and the simulated time."""
        self._open = False

    def _check_connection(self) -> None:
        """Raise a PortError if the port is closed or the cable disconnected."""
        if not self._open:
            raise PortError(
                "the simulated port is closed", remedy="Create a new VirtualPort for the same printer"
            )
        if self._faults is not None and self._faults.unplugged:
            raise PortError(
                "the cable of the simulated printer was disconnected by an injected fault",
                remedy="Open a new port when the fault has ended",
            )
