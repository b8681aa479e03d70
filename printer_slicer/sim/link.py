"""The cable between host and simulated printer in one process, with simulated time."""

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

MOST_ON_ITS_WAY: Final = 8192
"""Bytes in transit from which on a sender waits, as with the buffers of an operating system."""

BITS_PER_BYTE: Final = 10
"""8 data bits between a start and a stop bit."""


class _Chunk(NamedTuple):
    """Bytes in transit: arrival time of the first, s, and time for each further one, s."""

    first: float
    each: float
    data: bytes


class Wire:
    """One direction of a cable.

    Args:
        baud: bits/s, ten per byte; None: bytes take no time.
        latency: additional delay of each byte, s.

    Attributes:
        byte_seconds: time between consecutive bytes, s.
    """

    def __init__(self, baud: int | None = None, latency: float = 0.0) -> None:
        self.byte_seconds = BITS_PER_BYTE / baud if baud else 0.0
        self._latency = latency
        self._free = 0.0  # when the sender's end is free again
        self._chunks: deque[_Chunk] = deque()

    def push(self, data: bytes, now: float) -> None:
        """Write bytes at `now`, s."""
        if data:
            start = max(now, self._free)
            self._free = start + len(data) * self.byte_seconds
            self._chunks.append(_Chunk(start + self.byte_seconds + self._latency, self.byte_seconds, data))

    def pop(self, now: float) -> tuple[bytes, float] | None:
        """Return bytes that have arrived by `now`, s, and the arrival time of the last; None without any."""
        if not self._chunks or self._chunks[0].first > now:
            return None
        first, each, data = self._chunks.popleft()
        n = len(data)
        if first + (n - 1) * each > now:
            n = int((now - first) / each) + 1
            # Division and multiplication round differently; `due` multiplies.
            while first + (n - 1) * each > now:
                n -= 1
            while first + n * each <= now:
                n += 1
            self._chunks.appendleft(_Chunk(first + n * each, each, data[n:]))
            data = data[:n]
        return data, first + (n - 1) * each

    @property
    def on_its_way(self) -> int:
        """Number of bytes that have not arrived yet."""
        return sum(len(chunk.data) for chunk in self._chunks)

    def due(self) -> float:
        """Return when the next line or chunk has arrived, s; infinite if nothing is in transit."""
        if not self._chunks:
            return inf
        first, each, data = self._chunks[0]
        end = data.find(b"\n")
        return first + (end if end >= 0 else len(data) - 1) * each


class Cable:
    """Both directions between a host and a simulated printer; the caller provides the time.

    Args:
        printer: at the far end.
        baud: of both directions; None = bytes take no time.
        latency: s added to each byte in each direction.
        noise: changes bytes as they are written, see `CableNoise`.
        timer: latency timer of a USB chip, s, see `LatencyTimer`.
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

        Call it at every time that `due` returns, or events happen in the wrong order.
        """
        while (part := self._to_printer.pop(now)) is not None:
            data, at = part
            wakeup = self._printer.wakeup()
            if wakeup is not None and wakeup <= at:
                # Bytes that arrived before an event of the printer must be in its buffer by then; all but the
                # last byte arrived earlier.
                self._printer.receive(data[:-1], at - self._to_printer.byte_seconds)
                data = data[-1:]
            self._printer.receive(data, at)
        said = self._printer.send(now)
        if said:
            self._to_host.push(said if self._noise is None else self._noise(said, "to host"), now)
        chip = self._chip
        come = b""
        while (part := self._to_host.pop(now)) is not None:
            if chip is None:
                come += part[0]
            else:
                chip.arrive(*part)
        return come if chip is None else chip.release(now)

    def due(self) -> float:
        """Return the time of the next event, s; infinite if there is none."""
        wakeup = self._printer.wakeup()
        due = min(self._to_printer.due(), self._to_host.due(), inf if wakeup is None else wakeup)
        return due if self._chip is None else min(due, self._chip.due())

    @property
    def crowded(self) -> bool:
        """Whether a sender with flow control has to wait."""
        return self._to_printer.on_its_way + self._printer.unread > MOST_ON_ITS_WAY


class VirtualPort:
    """A serial port with a simulated printer at the other end and simulated time.

    Time passes only while the host reads: until there is something to read, or until the timeout. `now` is the clock
    for the host.

    Args:
        printer: at the other end.
        baud, latency, noise, timer: as for `Cable`.
        started: initial time, s; for a second port to a running printer.
        faults: faults to inject, instead of `noise`; pass them to the printer too.
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
        """Send bytes to the printer; time does not pass.

        Raises:
            PortError: the port was closed.
        """
        self._check()
        self._cable.write(data, self._now)

    def read(self, timeout: float) -> bytes:
        """Wait for bytes, at most `timeout` seconds; return empty bytes if none arrive.

        Raises:
            PortError: the port was closed.
        """
        self._check()
        deadline = self._now + timeout
        while True:
            data = self._cable.read(self._now)
            if self._faults is not None:
                self._check()
            if data or self._now >= deadline:
                return data
            self._now = min(deadline, max(self._cable.due(), self._now))

    def close(self) -> None:
        """Close the port: no bytes are transferred any more, and time stops."""
        self._open = False

    def _check(self) -> None:
        if not self._open:
            raise PortError("the simulated port is closed", remedy="Make a new one for the same printer")
        if self._faults is not None and self._faults.unplugged:
            raise PortError(
                "the cable of the simulated printer was disconnected", remedy="An injected fault caused this"
            )
