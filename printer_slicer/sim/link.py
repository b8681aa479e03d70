"""A cable between host and simulated printer in one process; its clock only moves when the host waits."""

from __future__ import annotations

from collections import deque
from math import inf
from typing import TYPE_CHECKING, Literal, NamedTuple, Protocol

from printer_slicer.errors import PortError

if TYPE_CHECKING:
    from collections.abc import Callable

    from printer_slicer.sim.printer import SimulatedPrinter

__all__ = ["Cable", "Chance", "Damage", "Direction", "VirtualPort", "Wire"]

Direction = Literal["to printer", "to host"]

BITS_PER_BYTE = 10
"""8 data bits between a start and a stop bit."""


class Chance(Protocol):
    """A source of chance, such as a seeded `random.Random`."""

    def random(self) -> float:
        """A number from 0 to below 1."""

    def randrange(self, stop: int, /) -> int:
        """A whole number from 0 to below `stop`."""


class Damage:
    """Bytes flipped, dropped and inserted at random.

    Every byte is hit independently of all others, so several can be hit in one line, and nothing comes in
    bursts; no byte is repeated, delayed or overtaken, and a written chunk is never lost as a whole. A flip
    turns one of the eight bits, an insertion puts any of the 256 bytes in front. The checksum of a line is
    one exclusive or: two flips of the same bit, or two equal bytes lost, pass it, so altered lines can be
    executed; how many to expect follows from the rates.

    Attributes:
        flipped, dropped, inserted: how many bytes so far, both directions together.
    """

    def __init__(self, chance: Chance, *, flip: float = 0.0, drop: float = 0.0, insert: float = 0.0) -> None:
        self.flipped = self.dropped = self.inserted = 0
        self._chance = chance
        self._flip = flip
        self._drop = drop
        self._insert = insert

    def __call__(self, data: bytes, direction: Direction) -> bytes:
        """What arrives of `data`; both directions are treated alike."""
        del direction
        whole = self._flip + self._drop + self._insert
        out = bytearray()
        for byte in data:
            drawn = self._chance.random()
            if drawn >= whole:
                out.append(byte)
            elif drawn < self._flip:
                self.flipped += 1
                out.append(byte ^ 1 << self._chance.randrange(8))
            elif drawn < self._flip + self._drop:
                self.dropped += 1
            else:
                self.inserted += 1
                out += bytes((self._chance.randrange(256), byte))
        return bytes(out)


class _Chunk(NamedTuple):
    """Bytes on their way: when the first one has arrived, s, and how long each further one takes."""

    first: float
    each: float
    data: bytes


class Wire:
    """One direction of a cable.

    Args:
        baud: bits/s; a byte takes ten bits, and bytes queue behind each other. None = no time at all.
        latency: s that every byte takes in addition.

    Attributes:
        byte_seconds: s between two bytes that follow each other.
    """

    def __init__(self, baud: int | None = None, latency: float = 0.0) -> None:
        self.byte_seconds = BITS_PER_BYTE / baud if baud else 0.0
        self._latency = latency
        self._free = 0.0  # when the sender's end is free again
        self._chunks: deque[_Chunk] = deque()

    def push(self, data: bytes, now: float) -> None:
        """Bytes written at `now`, s."""
        if data:
            start = max(now, self._free)
            self._free = start + len(data) * self.byte_seconds
            self._chunks.append(_Chunk(start + self.byte_seconds + self._latency, self.byte_seconds, data))

    def pop(self, now: float) -> tuple[bytes, float] | None:
        """Some bytes that have arrived by `now`, s, and when the last of them did; None without any."""
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

    def due(self) -> float:
        """When the next line, or all written with it, has arrived, s; infinite when nothing comes."""
        if not self._chunks:
            return inf
        first, each, data = self._chunks[0]
        end = data.find(b"\n")
        return first + (end if end >= 0 else len(data) - 1) * each


class Cable:
    """Both directions between a host and a simulated printer; the caller has the clock.

    Args:
        printer: at the far end.
        baud: of both directions; None = bytes take no time.
        latency: s added to each byte in each direction.
        damage: what the cable does to bytes as they are written, see `Damage`.
    """

    def __init__(
        self,
        printer: SimulatedPrinter,
        *,
        baud: int | None = None,
        latency: float = 0.0,
        damage: Callable[[bytes, Direction], bytes] | None = None,
    ) -> None:
        self._printer = printer
        self._to_printer = Wire(baud, latency)
        self._to_host = Wire(baud, latency)
        self._damage = damage

    def write(self, data: bytes, now: float) -> None:
        """Send bytes to the printer, at `now`, s."""
        if self._damage is not None:
            data = self._damage(data, "to printer")
        self._to_printer.push(data, now)

    def read(self, now: float) -> bytes:
        """Let everything happen until `now`, s: the bytes that have come back.

        Between two calls may be no more than one moment that `due` gave, or things happen in the wrong order.
        """
        while (part := self._to_printer.pop(now)) is not None:
            data, at = part
            wakeup = self._printer.wakeup()
            if wakeup is not None and wakeup <= at:
                # What came before the printer does something must be in its buffer by then; all but the last
                # byte came earlier than this moment.
                self._printer.receive(data[:-1], at - self._to_printer.byte_seconds)
                data = data[-1:]
            self._printer.receive(data, at)
        said = self._printer.send(now)
        if said:
            self._to_host.push(said if self._damage is None else self._damage(said, "to host"), now)
        come = b""
        while (part := self._to_host.pop(now)) is not None:
            come += part[0]
        return come

    def due(self) -> float:
        """When something happens next, s; infinite when nothing will."""
        wakeup = self._printer.wakeup()
        return min(self._to_printer.due(), self._to_host.due(), inf if wakeup is None else wakeup)


class VirtualPort:
    """The host's transport, with a simulated printer at the other end and an invented clock.

    Time stands still until the host reads; then it moves to the moment at which there is something to read,
    but no further than the timeout. `now` is the clock to give to the host.

    Args:
        printer: at the other end.
        baud, latency, damage: as for `Cable`.
        started: s, what the clock begins with; for a second port to a printer that has been running.
    """

    def __init__(
        self,
        printer: SimulatedPrinter,
        *,
        baud: int | None = None,
        latency: float = 0.0,
        damage: Callable[[bytes, Direction], bytes] | None = None,
        started: float = 0.0,
    ) -> None:
        self._cable = Cable(printer, baud=baud, latency=latency, damage=damage)
        self._now = started
        self._open = True

    def now(self) -> float:
        """Simulated time, s."""
        return self._now

    def write(self, data: bytes) -> None:
        """Send bytes to the printer; they are on their way, time does not move.

        Raises:
            PortError: the port was closed.
        """
        self._check()
        self._cable.write(data, self._now)

    def read(self, timeout: float) -> bytes:
        """Wait for bytes, at most `timeout` seconds; empty when none came.

        Raises:
            PortError: the port was closed.
        """
        self._check()
        deadline = self._now + timeout
        while True:
            data = self._cable.read(self._now)
            if data or self._now >= deadline:
                return data
            self._now = min(deadline, max(self._cable.due(), self._now))

    def close(self) -> None:
        """Pull the plug: nothing goes in or out any more, and time stands still."""
        self._open = False

    def _check(self) -> None:
        if not self._open:
            raise PortError("the simulated port is closed", remedy="Make a new one for the same printer.")
