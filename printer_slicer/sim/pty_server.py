"""Serve a simulated printer as a device file that hosts open like a serial port.

It uses a pseudo-terminal with a symbolic link as its name. Baud rate and parity set by the host have no effect.
"""

from __future__ import annotations

import contextlib
import os
import select
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from printer_slicer.errors import PortError
from printer_slicer.sim.link import Cable
from printer_slicer.sim.server_loop import CHUNK, Clock, exchange_bytes

if sys.platform != "win32":
    import pty
    import tty

if TYPE_CHECKING:
    from printer_slicer.sim.printer import SimulatedPrinter
    from printer_slicer.sim.statistics import Report

__all__ = ["serve"]


def serve(  # noqa: PLR0913 - all but two have a good default
    printer_factory: Callable[[], SimulatedPrinter],
    link_path: Path,
    *,
    speed: float = 1.0,
    connect: Callable[[SimulatedPrinter], Cable] = Cable,
    unplugged: Callable[[], bool] = lambda: False,
    stop: Callable[[], bool] = lambda: False,
    ready: Callable[[str], None] = lambda _: None,
) -> Report:
    """Serve a simulated printer under the name `link_path` until `stop` returns True or Ctrl-C; return its report.

    The host may close and reopen the port; the printer continues in the meantime.

    Args:
        printer_factory: creates the printer when the port exists.
        link_path: symbolic link to create; replaces an old one, and is removed at the end.
        speed: simulated seconds per real second. 0 or infinity: real time, but waits of the host for a reply are
            skipped.
        connect: creates the cable, with its baud rate and latency. A firmware with a small receive buffer needs a baud
            rate; otherwise everything written at once arrives at once.
        unplugged: whether the cable is disconnected; there is no device then, and its name may change.
        stop: called about twenty times a second.
        ready: called with the device name when it can be opened.

    Raises:
        PortError: the system has no pseudo-terminals, or the link cannot be created.
    """
    if sys.platform == "win32":
        raise PortError(
            "this system has no pseudo-terminals",
            remedy="Serve it over TCP (sim --tcp HOST:PORT), or use dry-run, which needs no port",
        )
    made: list[tuple[SimulatedPrinter, Cable, Clock]] = []
    # Users stop it with Ctrl-C.
    with contextlib.suppress(KeyboardInterrupt):
        while not stop():
            with _terminal() as (master, name), _linked(link_path, name):
                ready(name)
                if not made:
                    printer = printer_factory()
                    made.append((printer, connect(printer), Clock(speed)))
                exchange_bytes(*made[0], _Terminal(master), lambda: stop() or unplugged())
            exchange_bytes(*made[0], _Nowhere(), lambda: stop() or not unplugged())
    return (made[0][0] if made else printer_factory()).report()


class _Terminal:
    """The server end of a pseudo-terminal."""

    def __init__(self, master: int) -> None:
        self._master = master

    def wait(self, seconds: float, *, reads: bool, writes: bool) -> bool:
        """Wait for bytes from the host, or for room to write."""
        mine = [self._master]
        readable, _, _ = select.select(mine if reads else [], mine if writes else [], [], seconds)
        return bool(readable)

    def read(self) -> bytes:
        """Return the bytes from the host."""
        return os.read(self._master, CHUNK)

    def write(self, data: bytes) -> int:
        """Write bytes; return how many were accepted."""
        try:
            return os.write(self._master, data)
        except BlockingIOError:
            return 0


class _Nowhere:
    """A disconnected cable."""

    def wait(self, seconds: float, *, reads: bool, writes: bool) -> bool:
        """Wait; there is never anything to read."""
        del reads, writes
        select.select([], [], [], seconds)
        return False

    def read(self) -> bytes:
        """Return no bytes."""
        return b""

    def write(self, data: bytes) -> int:
        """Discard the bytes."""
        return len(data)


@contextlib.contextmanager
def _terminal() -> Iterator[tuple[int, str]]:
    """Open a pseudo-terminal in raw mode; yield the server end and the name of the other."""
    master, slave = pty.openpty()
    try:
        # The other end stays open here too, or its settings would be lost when a host closes it.
        tty.setraw(slave)
        os.set_blocking(master, False)
        yield master, os.ttyname(slave)
    finally:
        os.close(master)
        os.close(slave)


@contextlib.contextmanager
def _linked(path: Path, target: str) -> Iterator[None]:
    """Create a symbolic link, and remove it at the end."""
    _link(path, target)
    try:
        yield
    finally:
        # Another program may have replaced it.
        if path.is_symlink() and path.readlink() == Path(target):
            path.unlink()


def _link(path: Path, target: str) -> None:
    """Create a symbolic link at `path`, replacing only another symbolic link."""
    try:
        if path.is_symlink():
            path.unlink()
        path.symlink_to(target)
    except FileExistsError as error:
        raise PortError(
            f"{path} exists and is not a link", remedy="Choose another name, or move the file away"
        ) from error
    except OSError as error:
        raise PortError(
            f"cannot create the link {path}: {error.strerror}",
            remedy="Choose a name in a writable folder",
        ) from error
