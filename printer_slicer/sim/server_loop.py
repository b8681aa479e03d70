"""Exchange bytes between a simulated printer and a host connection, in real or accelerated time."""

from __future__ import annotations

from math import inf
from time import monotonic
from typing import TYPE_CHECKING, Final, Protocol

if TYPE_CHECKING:
    from collections.abc import Callable

    from printer_slicer.sim.link import Cable
    from printer_slicer.sim.printer import SimulatedPrinter

__all__ = ["CHUNK_BYTES", "Clock", "HostConnection", "exchange_bytes"]

LONGEST_WAIT: Final = 0.05
"""Maximum time between two calls of the function `stop`, s."""

CHUNK_BYTES: Final = 4096
"""Maximum number of bytes that are read at once."""

MAX_UNREAD_BYTES: Final = 65_536
"""Maximum number of bytes kept for a host that does not read; older bytes are lost."""


class HostConnection(Protocol):
    """A connection to a host, such as a pseudo-terminal or a socket."""

    def wait(self, seconds: float, *, reads: bool, writes: bool) -> bool:
        """Wait up to `seconds` until data can be read or written; return whether there are bytes to read."""

    def read(self) -> bytes:
        """Return the bytes from the host; empty if there are none."""

    def write(self, data: bytes) -> int:
        """Write bytes to the host; return the number of bytes that were accepted."""


class Clock:
    """Simulated time derived from real time.

    Args:
        speed: simulated seconds per real second; 0 or infinity: see `skips`.

    Attributes:
        skips: whether time runs at normal speed, but waits of the host for the printer are skipped.
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
        """Advance the simulated time to at least `moment`, s."""
        self._skipped += max(moment - self.now(), 0.0)

    def real_seconds_until(self, moment: float) -> float:
        """Return the real time that remains until the simulated time `moment`, s."""
        return max(moment - self.now(), 0.0) / self._rate


def exchange_bytes(
    printer: SimulatedPrinter, cable: Cable, clock: Clock, host: HostConnection, stop: Callable[[], bool]
) -> None:
    """Exchange bytes between printer and host until `stop`, called about 20 times a second, returns True."""
    unsent = b""
    while not stop():
        due = cable.next_event_time()
        jump = clock.skips and printer.has_unanswered_command and due < inf
        wait = 0.0 if jump else min(clock.real_seconds_until(due), LONGEST_WAIT)
        received = b""
        if host.wait(wait, reads=not cable.is_full, writes=bool(unsent)):
            received = host.read()
        if received:
            cable.write(received, clock.now())
        elif jump:
            clock.skip_to(due)
        now = clock.now()
        # Simulate each event of the cable at its own time.
        while (due := cable.next_event_time()) <= now:
            unsent += cable.read(due)
        unsent = (unsent + cable.read(now))[-MAX_UNREAD_BYTES:]
        if unsent:
            unsent = unsent[host.write(unsent) :]
