"""Exchange bytes between a simulated printer and a host connection, in real or accelerated time."""

from __future__ import annotations

from math import inf
from time import monotonic
from typing import TYPE_CHECKING, Final, Protocol

if TYPE_CHECKING:
    from collections.abc import Callable

    from printer_slicer.sim.link import Cable
    from printer_slicer.sim.printer import SimulatedPrinter

__all__ = ["CHUNK", "Clock", "HostConnection", "exchange_bytes"]

LONGEST_WAIT: Final = 0.05
"""s between two calls of `stop`."""

CHUNK: Final = 4096
"""Bytes read at once."""

MOST_UNREAD: Final = 65_536
"""Bytes kept for a host that does not read; older ones are lost."""


class HostConnection(Protocol):
    """A connection to a host."""

    def wait(self, seconds: float, *, reads: bool, writes: bool) -> bool:
        """Wait for bytes to read or room to write, as requested; return whether there are bytes to read."""

    def read(self) -> bytes:
        """Return the bytes from the host; empty without any."""

    def write(self, data: bytes) -> int:
        """Write bytes; return how many were accepted."""


class Clock:
    """Simulated time derived from real time.

    Args:
        speed: simulated seconds per real second; 0 or infinity: see `skips`.

    Attributes:
        skips: whether waits of the printer are skipped instead of running faster.
    """

    def __init__(self, speed: float) -> None:
        self.skips = speed in (0.0, inf)
        self._rate = 1.0 if self.skips else speed
        self._began = monotonic()
        self._skipped = 0.0

    def now(self) -> float:
        """Return the simulated seconds since the start."""
        return (monotonic() - self._began) * self._rate + self._skipped

    def skip_to(self, moment: float) -> None:
        """Advance to at least `moment`."""
        self._skipped += max(moment - self.now(), 0.0)

    def real_seconds(self, moment: float) -> float:
        """Return the real seconds until `moment`."""
        return max(moment - self.now(), 0.0) / self._rate


def exchange_bytes(
    printer: SimulatedPrinter, cable: Cable, clock: Clock, door: HostConnection, stop: Callable[[], bool]
) -> None:
    """Exchange bytes until `stop` returns True; it is called about twenty times a second."""
    unsent = b""
    while not stop():
        due = cable.due()
        jump = clock.skips and printer.working and due < inf
        wait = 0.0 if jump else min(clock.real_seconds(due), LONGEST_WAIT)
        heard = b""
        if door.wait(wait, reads=not cable.crowded, writes=bool(unsent)):
            heard = door.read()
        if heard:
            cable.write(heard, clock.now())
        elif jump:
            clock.skip_to(due)
        now = clock.now()
        # Step through all events of the cable.
        while (due := cable.due()) <= now:
            unsent += cable.read(due)
        unsent = (unsent + cable.read(now))[-MOST_UNREAD:]
        if unsent:
            unsent = unsent[door.write(unsent) :]
