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
from pathlib import Path
from typing import TYPE_CHECKING

from printer_slicer.errors import PortError
from printer_slicer.sim.link import Cable
from printer_slicer.sim.serving import CHUNK, Clock, carry

if sys.platform != "win32":
    import pty
    import tty

if TYPE_CHECKING:
    from printer_slicer.sim.printer import SimulatedPrinter
    from printer_slicer.sim.tally import Report

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
        unplugged: whether the cable is out; as long as it is there is no device, and afterwards it may be another one.
        stop: asked about twenty times a second.
        ready: called with the name of the device when it can be opened.

    Raises:
        PortError: there are no pseudo-terminals on this system, or the link cannot be made.
    """
    if sys.platform == "win32":
        raise PortError(
            "this system has no pseudo-terminals",
            remedy="Serve it over TCP (sim --tcp HOST:PORT), or use the dry run, which needs no port.",
        )
    made: list[tuple[SimulatedPrinter, Cable, Clock]] = []
    # Ctrl-C is how a person ends it.
    with contextlib.suppress(KeyboardInterrupt):
        while not stop():
            with _terminal() as (master, name), _linked(link_path, name):
                ready(name)
                if not made:
                    printer = printer_factory()
                    made.append((printer, connect(printer), Clock(speed)))
                carry(*made[0], _Terminal(master), lambda: stop() or unplugged())
            carry(*made[0], _Nowhere(), lambda: stop() or not unplugged())
    return (made[0][0] if made else printer_factory()).report()


class _Terminal:
    """Our end of a pseudo-terminal."""

    def __init__(self, master: int) -> None:
        self._master = master

    def wait(self, seconds: float, *, reads: bool, writes: bool) -> bool:
        """Wait for the host."""
        mine = [self._master]
        readable, _, _ = select.select(mine if reads else [], mine if writes else [], [], seconds)
        return bool(readable)

    def read(self) -> bytes:
        """What the host has sent."""
        return os.read(self._master, CHUNK)

    def write(self, data: bytes) -> int:
        """How many bytes the pseudo-terminal took."""
        try:
            return os.write(self._master, data)
        except BlockingIOError:
            return 0


class _Nowhere:
    """A cable whose plug is out."""

    def wait(self, seconds: float, *, reads: bool, writes: bool) -> bool:
        """Let time pass."""
        del reads, writes
        select.select([], [], [], seconds)
        return False

    def read(self) -> bytes:
        """Nothing comes."""
        return b""

    def write(self, data: bytes) -> int:
        """Everything is lost."""
        return len(data)


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
