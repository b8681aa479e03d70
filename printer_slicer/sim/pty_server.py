"""The simulated printer as a device file: any host that can open a serial port can print to it.

The printer lives behind a pseudo-terminal; a symbolic link gives it a name that can be told to a host. Baud
rate and parity that a host sets mean nothing here.
"""

from __future__ import annotations

import contextlib
import os
import select
import sys
from collections.abc import Callable, Iterator
from math import inf
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING, Final

from printer_slicer.errors import PortError
from printer_slicer.sim.link import Cable

if sys.platform != "win32":
    import pty
    import tty

if TYPE_CHECKING:
    from printer_slicer.sim.printer import SimulatedPrinter
    from printer_slicer.sim.tally import Report

__all__ = ["serve"]

LONGEST_WAIT: Final = 0.05
"""s between two looks at `stop`."""

CHUNK: Final = 4096
"""Bytes read at once."""

MOST_UNREAD: Final = 65_536
"""Bytes kept for a host that does not read; older ones are lost, as in a cable nobody listens to."""


def serve(
    printer_factory: Callable[[], SimulatedPrinter],
    link_path: Path,
    *,
    speed: float = 1.0,
    connect: Callable[[SimulatedPrinter], Cable] = Cable,
    stop: Callable[[], bool] = lambda: False,
    ready: Callable[[str], None] = lambda _: None,
) -> Report:
    """Serve a simulated printer under the name `link_path` until `stop` says so or Ctrl-C; what it did.

    The host may close the port and open it again; the printer goes on in the meantime.

    Args:
        printer_factory: makes the printer when the port exists.
        link_path: symbolic link to make; an old symbolic link there is replaced, and it is removed at the
            end.
        speed: simulated seconds per real second. 0 or infinity: the printer's time runs like the real one,
            but whenever the host waits for an answer, the time until that answer is skipped.
        connect: makes the cable, with the pace and latency of the bytes in simulated time. A front end with a small
            receive buffer wants a pace: without, everything written at once arrives at once.
        stop: asked about twenty times a second.
        ready: called with the name of the device when it can be opened.

    Raises:
        PortError: there are no pseudo-terminals on this system, or the link cannot be made.
    """
    if sys.platform == "win32":
        raise PortError(
            "this system has no pseudo-terminals",
            remedy="Use the dry run, which needs no port, or serve the printer from Linux or macOS.",
        )
    with _terminal() as (master, name), _linked(link_path, name):
        ready(name)
        printer = printer_factory()
        # Ctrl-C is how a person ends it.
        with contextlib.suppress(KeyboardInterrupt):
            _carry(printer, connect(printer), master, _Clock(speed), stop)
        return printer.report()


@contextlib.contextmanager
def _terminal() -> Iterator[tuple[int, str]]:
    """A pseudo-terminal that passes bytes unchanged: our end, and the name of the other."""
    master, slave = pty.openpty()
    try:
        # The other end stays open here too, or its settings would be lost whenever a host closes it.
        tty.setraw(slave)
        os.set_blocking(master, False)
        yield master, os.ttyname(slave)
    finally:
        os.close(master)
        os.close(slave)


@contextlib.contextmanager
def _linked(path: Path, target: str) -> Iterator[None]:
    """A symbolic link for as long as it is needed."""
    _link(path, target)
    try:
        yield
    finally:
        # Somebody else may have put another one in its place.
        if path.is_symlink() and path.readlink() == Path(target):
            path.unlink()


def _link(path: Path, target: str) -> None:
    """Make `path` a symbolic link, replacing only another symbolic link."""
    try:
        if path.is_symlink():
            path.unlink()
        path.symlink_to(target)
    except FileExistsError as error:
        raise PortError(
            f"{path} exists and is not a link", remedy="Choose another name, or move the file away."
        ) from error
    except OSError as error:
        raise PortError(
            f"cannot make the link {path}: {error.strerror}",
            remedy="Choose a name in a folder you may write to.",
        ) from error


class _Clock:
    """Simulated time out of real time.

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


def _carry(
    printer: SimulatedPrinter, cable: Cable, master: int, clock: _Clock, stop: Callable[[], bool]
) -> None:
    """Carry bytes between the printer and the pseudo-terminal until `stop` says so."""
    unsent = b""
    while not stop():
        due = cable.due()
        jump = clock.skips and printer.working and due < inf
        wait = 0.0 if jump else min(clock.real_seconds(due), LONGEST_WAIT)
        readable, _, _ = select.select([master], [master] if unsent else [], [], wait)
        if readable:
            cable.write(os.read(master, CHUNK), clock.now())
        elif jump:
            clock.skip_to(due)
        now = clock.now()
        # Moment by moment, as the cable wants it.
        while (due := cable.due()) <= now:
            unsent += cable.read(due)
        unsent = (unsent + cable.read(now))[-MOST_UNREAD:]
        if unsent:
            unsent = unsent[_written(master, unsent) :]


def _written(master: int, data: bytes) -> int:
    """How many bytes the pseudo-terminal took."""
    try:
        return os.write(master, data)
    except BlockingIOError:
        return 0
