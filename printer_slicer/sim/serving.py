"""Carries bytes between a simulated printer and a door of the system, in real time or in time of its own."""

from __future__ import annotations

from math import inf
from time import monotonic
from typing import TYPE_CHECKING, Final, Protocol

if TYPE_CHECKING:
    from collections.abc import Callable

    from printer_slicer.sim.link import Cable
    from printer_slicer.sim.printer import SimulatedPrinter

__all__ = ["CHUNK", "Clock", "Door", "carry"]

LONGEST_WAIT: Final = 0.05
"""s between two looks at `stop`."""

CHUNK: Final = 4096
"""Bytes read at once."""

MOST_UNREAD: Final = 65_536
"""Bytes kept for a host that does not read; older ones are lost, as in a cable nobody listens to."""


class Door(Protocol):
    """Where a host comes in."""

    def wait(self, seconds: float, *, reads: bool, writes: bool) -> bool:
        """Wait until there is something to read, or room to write, if wanted; whether something can be read."""

    def read(self) -> bytes:
        """What the host has sent; empty when it has sent nothing."""

    def write(self, data: bytes) -> int:
        """How many of the bytes were taken."""


class Clock:
    """Simulated time out of real time.

    Args:
        speed: simulated seconds per real second; 0 or infinity: see `skips`.

    Attributes:
        skips: jumps over the printer's waits instead of running faster.
    """

    def __init__(self, speed: float) -> None:
        self.skips = speed in (0.0, inf)
        self._rate = 1.0 if self.skips else speed
        self._began = monotonic()
        self._skipped = 0.0

    def now(self) -> float:
        """Simulated seconds since the beginning."""
        return (monotonic() - self._began) * self._rate + self._skipped

    def skip_to(self, moment: float) -> None:
        """Make it at least `moment`."""
        self._skipped += max(moment - self.now(), 0.0)

    def real_seconds(self, moment: float) -> float:
        """Real seconds until `moment`."""
        return max(moment - self.now(), 0.0) / self._rate


def carry(
    printer: SimulatedPrinter, cable: Cable, clock: Clock, door: Door, stop: Callable[[], bool]
) -> None:
    """Carry bytes until `stop` says so; it is asked about twenty times a second."""
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
        # Moment by moment, as the cable wants it.
        while (due := cable.due()) <= now:
            unsent += cable.read(due)
        unsent = (unsent + cable.read(now))[-MOST_UNREAD:]
        if unsent:
            unsent = unsent[door.write(unsent) :]
