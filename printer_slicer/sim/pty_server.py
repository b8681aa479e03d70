"""Serve a simulated printer as a device file that hosts open like a serial port.

The device is a pseudo-terminal, to which a symbolic link gives a name. Baud rate and parity set by the host have no
effect.
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
from printer_slicer.sim.server_loop import CHUNK_BYTES, Clock, exchange_bytes

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
    """Serve a simulated printer at `link_path` until `stop` returns True or Ctrl-C; return the report.

    The host may close and reopen the port; the printer keeps running.

    Args:
        printer_factory: function that creates the printer when the port exists.
        link_path: symbolic link to create; it replaces an old one, and is removed at the end.
        speed: simulated seconds per real second. 0 or infinity: real time, but time in which the host waits for a
            reply is skipped.
        connect: function that creates the cable, with its baud rate and latency. A firmware with a small receive
            buffer needs a baud rate; otherwise everything written at once arrives at once.
        unplugged: function that returns whether the cable is disconnected. There is no device then, and the next one
            may have another name.
        stop: function that returns whether to stop; called about twenty times a second.
        ready: function that is called with the device name when the device can be opened.

    Raises:
        PortError: the system has no pseudo-terminals, or the symbolic link cannot be created.
    """
    if sys.platform == "win32":
        raise PortError(
            "this system has no pseudo-terminals",
            remedy="Serve it over TCP (sim --tcp HOST:PORT), or use dry-run, which needs no port",
        )
    made: list[tuple[SimulatedPrinter, Cable, Clock]] = []
    # Users stop the server with Ctrl-C.
    with contextlib.suppress(KeyboardInterrupt):
        while not stop():
            with _open_terminal() as (master, name), _temporary_link(link_path, name):
                ready(name)
                if not made:
                    printer = printer_factory()
                    made.append((printer, connect(printer), Clock(speed)))
                exchange_bytes(*made[0], _Terminal(master), lambda: stop() or unplugged())
            exchange_bytes(*made[0], _UnpluggedCable(), lambda: stop() or not unplugged())
    return (made[0][0] if made else printer_factory()).report()


class _Terminal:
    """The connection to the host through the server end of a pseudo-terminal."""

    def __init__(self, master: int) -> None:
        self._master = master

    def wait(self, seconds: float, *, reads: bool, writes: bool) -> bool:
        """Wait up to `seconds` until data can be read or written; return whether there are bytes to read."""
        mine = [self._master]
        readable, _, _ = select.select(mine if reads else [], mine if writes else [], [], seconds)
        return bool(readable)

    def read(self) -> bytes:
        """Return the bytes from the host."""
        return os.read(self._master, CHUNK_BYTES)

    def write(self, data: bytes) -> int:
        """Write bytes to the host; return the number of bytes that were accepted."""
        try:
            return os.write(self._master, data)
        except BlockingIOError:
            return 0


class _UnpluggedCable:
    """A connection that transfers nothing, used while the cable is disconnected."""

    def wait(self, seconds: float, *, reads: bool, writes: bool) -> bool:
        """Wait `seconds`; return False, because there is never anything to read."""
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
def _open_terminal() -> Iterator[tuple[int, str]]:
    """Open a pseudo-terminal in raw mode; yield the server end, and the device name for the host."""
    master, slave = pty.openpty()
    try:
        # The host end stays open here too, so that its settings survive when the host closes it.
        tty.setraw(slave)
        os.set_blocking(master, False)
        yield master, os.ttyname(slave)
    finally:
        os.close(master)
        os.close(slave)


@contextlib.contextmanager
def _temporary_link(path: Path, target: str) -> Iterator[None]:
    """Create a symbolic link at `path`, and remove it at the end of the context."""
    _create_link(path, target)
    try:
        yield
    finally:
        # Another program may have replaced the link.
        if path.is_symlink() and path.readlink() == Path(target):
            path.unlink()


def _create_link(path: Path, target: str) -> None:
    """Create a symbolic link at `path`; replace an existing symbolic link, but no other file."""
    try:
        if path.is_symlink():
            path.unlink()
        path.symlink_to(target)
    except FileExistsError as error:
        raise PortError(
            f"{path} exists and is not a symbolic link", remedy="Choose another name, or move the file away"
        ) from error
    except OSError as error:
        raise PortError(
            f"cannot create the link {path}: {error.strerror}",
            remedy="Choose a name in a writable folder",
        ) from error
