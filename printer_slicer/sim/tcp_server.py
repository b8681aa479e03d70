"""The simulated printer at a TCP port, as plain bytes or by RFC 2217: works on every system, and over the network.

One host at a time, as at a serial port: another one that comes is sent away after a second. A host that goes and
comes back meets the printer as it has become meanwhile.
"""

from __future__ import annotations

import contextlib
import select
import socket
from collections.abc import Callable
from time import monotonic
from typing import TYPE_CHECKING, Final, Protocol

from printer_slicer.errors import PortError
from printer_slicer.sim.link import Cable
from printer_slicer.sim.serving import CHUNK, Clock, carry

if TYPE_CHECKING:
    from printer_slicer.sim.printer import SimulatedPrinter
    from printer_slicer.sim.tally import Report

__all__ = ["Telnet", "serve_tcp"]


PATIENCE: Final = 1.0
"""s that a host waits for the place of one that has just left; then it is taken."""


class Telnet(Protocol):
    """What a serial port is told through a connection, besides bytes: see `rfc2217.Negotiator`."""

    def answers(self) -> bytes:
        """What is to be said to the host on the protocol's account."""

    def taken_apart(self, data: bytes) -> bytes:
        """The bytes for the printer, of those that came. Raises ValueError for what makes no sense."""

    def put_together(self, data: bytes) -> bytes:
        """The printer's bytes as they go out."""


def serve_tcp(  # noqa: PLR0913 - all but two have a good default
    printer_factory: Callable[[], SimulatedPrinter],
    address: tuple[str, int],
    *,
    speed: float = 1.0,
    connect: Callable[[SimulatedPrinter], Cable] = Cable,
    telnet: Callable[[], Telnet] | None = None,
    unplugged: Callable[[], bool] = lambda: False,
    stop: Callable[[], bool] = lambda: False,
    ready: Callable[[str], None] = lambda _: None,
) -> Report:
    """Serve a simulated printer at a TCP address until `stop` says so or Ctrl-C; what it did.

    Args:
        printer_factory: makes the printer when the port is open.
        address: host and port to listen at; port 0 takes a free one.
        speed: simulated seconds per real second, as for `pty_server.serve`.
        connect: makes the cable, likewise.
        telnet: speaks RFC 2217 with a host that has come; None passes bytes unchanged.
        unplugged: whether the cable is out: a host is sent away then, and no other is let in.
        stop: asked about twenty times a second.
        ready: called with `host:port` when a host can come.

    Raises:
        PortError: nobody can listen at this address.
    """
    with _listening(address) as listener:
        host, port = listener.getsockname()[:2]
        ready(f"{host}:{port}")
        printer = printer_factory()
        with contextlib.ExitStack() as leaving:
            visits = _Visits(listener, telnet, unplugged)
            leaving.callback(visits.end)
            # Ctrl-C is how a person ends it.
            with contextlib.suppress(KeyboardInterrupt):
                carry(printer, connect(printer), Clock(speed), visits, stop)
            return printer.report()


def _listening(address: tuple[str, int]) -> socket.socket:
    """A socket that hosts can connect to."""
    try:
        return socket.create_server(address, backlog=4)
    except (OSError, OverflowError) as error:
        raise PortError(
            f"cannot listen at {address[0]}:{address[1]}: {getattr(error, 'strerror', None) or error}",
            remedy="Choose another port over 1024 that no other program has, and an address of this computer.",
        ) from error


class _Visits:
    """The hosts that come and go, one at a time."""

    def __init__(
        self,
        listener: socket.socket,
        telnet: Callable[[], Telnet] | None,
        unplugged: Callable[[], bool],
    ) -> None:
        self._listener = listener
        self._telnet = telnet
        self._unplugged = unplugged
        self._host: socket.socket | None = None
        self._talk: Telnet | None = None
        self._going = b""  # bytes that were put together and not taken yet
        self._next: socket.socket | None = None
        self._until = 0.0

    def wait(self, seconds: float, *, reads: bool, writes: bool) -> bool:
        """Wait for the host, or for one to come."""
        if self._unplugged():
            self.close()
        mine = [self._host] if self._host is not None else []
        wants = [self._listener, *(mine if reads else [])]
        readable, ready, _ = select.select(wants, mine if writes or self._going else [], [], seconds)
        if ready and self._going:
            self._send()
        if self._listener in readable:
            self._answer_door()
        self._let_in()
        return self._host is not None and self._host in readable

    def read(self) -> bytes:
        """What the host has sent; it may also have gone."""
        assert self._host is not None
        try:
            data = self._host.recv(CHUNK)
        except (BlockingIOError, InterruptedError):
            return b""
        except OSError:
            data = b""
        if not data:
            self.close()
            return b""
        if self._talk is None:
            return data
        try:
            data = self._talk.taken_apart(data)
        except ValueError:
            self.close()
            return b""
        self._going += self._talk.answers()
        self._send()
        return data

    def write(self, data: bytes) -> int:
        """Send to the host; what is said while there is none is lost, as at a port that nobody has opened."""
        if self._host is None:
            return len(data)
        if not self._send() or len(self._going) >= CHUNK:
            return 0
        self._going += data if self._talk is None else self._talk.put_together(data)
        self._send()
        return len(data)

    def end(self) -> None:
        """Send everybody away."""
        self.close()
        if self._next is not None:
            self._next.close()

    def close(self) -> None:
        """Send the host away."""
        if self._host is not None:
            self._host.close()
        self._host = self._talk = None
        self._going = b""

    def _send(self) -> bool:
        """Hand over what goes; False when the host has gone."""
        assert self._host is not None
        try:
            self._going = self._going[self._host.send(self._going) :]
        except (BlockingIOError, InterruptedError):
            return True
        except OSError:
            self.close()
            return False
        return True

    def _answer_door(self) -> None:
        """Take the host that knocks, or have it wait for the one that may be leaving."""
        try:
            host, _ = self._listener.accept()
        except OSError:
            return
        if self._next is not None or self._unplugged():
            host.close()
        else:
            self._next, self._until = host, monotonic() + PATIENCE

    def _let_in(self) -> None:
        """Let the host that waits in when the place is free; send it away when that takes too long."""
        if self._next is None or (self._host is not None and monotonic() < self._until):
            return
        host, self._next = self._next, None
        if self._host is not None:
            host.close()
            return
        host.setblocking(False)
        host.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        host.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        self._host = host
        if self._telnet is not None:
            self._talk = self._telnet()
            self._going = self._talk.answers()
            self._send()
