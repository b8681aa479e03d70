"""Serve a simulated printer at a TCP port, as plain bytes or with RFC 2217.

One host can connect at a time, as to a serial port; another one is disconnected after a second. The printer continues
while no host is connected.
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
from printer_slicer.sim.server_loop import CHUNK, Clock, exchange_bytes

if TYPE_CHECKING:
    from printer_slicer.sim.printer import SimulatedPrinter
    from printer_slicer.sim.statistics import Report

__all__ = ["Telnet", "serve_tcp"]


PATIENCE: Final = 1.0
"""s that a new host waits for the previous one to leave."""


class Telnet(Protocol):
    """Serial port settings over a connection, see `rfc2217.Rfc2217Server`."""

    def answers(self) -> bytes:
        """Return protocol bytes to send to the host."""

    def decode(self, data: bytes) -> bytes:
        """Return the bytes for the printer; raise ValueError for an invalid protocol."""

    def encode(self, data: bytes) -> bytes:
        """Return bytes of the printer, encoded for the host."""


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
    """Serve a simulated printer at a TCP address until `stop` returns True or Ctrl-C; return its report.

    Args:
        printer_factory: creates the printer when the port is open.
        address: host and port to listen at; port 0 chooses a free one.
        speed: simulated seconds per real second, as for `pty_server.serve`.
        connect: creates the cable, likewise.
        telnet: creates the RFC 2217 encoder for a new host; None passes bytes unchanged.
        unplugged: whether the cable is disconnected; no host can connect then.
        stop: called about twenty times a second.
        ready: called with `host:port` when a host can connect.

    Raises:
        PortError: cannot listen at this address.
    """
    with _listening(address) as listener:
        host, port = listener.getsockname()[:2]
        ready(f"{host}:{port}")
        printer = printer_factory()
        with contextlib.ExitStack() as leaving:
            hosts = _HostAcceptor(listener, telnet, unplugged)
            leaving.callback(hosts.end)
            # Users stop it with Ctrl-C.
            with contextlib.suppress(KeyboardInterrupt):
                exchange_bytes(printer, connect(printer), Clock(speed), hosts, stop)
            return printer.report()


def _listening(address: tuple[str, int]) -> socket.socket:
    """Return a listening socket."""
    try:
        return socket.create_server(address, backlog=4)
    except (OSError, OverflowError) as error:
        raise PortError(
            f"cannot listen at {address[0]}:{address[1]}: {getattr(error, 'strerror', None) or error}",
            remedy="Choose a free port above 1024, and an address of this computer",
        ) from error


class _HostAcceptor:
    """Accepts hosts, one at a time."""

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
        self._going = b""  # encoded bytes not sent yet
        self._next: socket.socket | None = None
        self._until = 0.0

    def wait(self, seconds: float, *, reads: bool, writes: bool) -> bool:
        """Wait for bytes from the host, room to write, or a new host."""
        if self._unplugged():
            self.close()
        mine = [self._host] if self._host is not None else []
        wants = [self._listener, *(mine if reads else [])]
        readable, ready, _ = select.select(wants, mine if writes or self._going else [], [], seconds)
        if ready and self._going:
            self._send()
        if self._listener in readable:
            self._accept()
        self._admit_next()
        return self._host is not None and self._host in readable

    def read(self) -> bytes:
        """Return the bytes from the host; notice if it has disconnected."""
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
            data = self._talk.decode(data)
        except ValueError:
            self.close()
            return b""
        self._going += self._talk.answers()
        self._send()
        return data

    def write(self, data: bytes) -> int:
        """Send to the host; without one, the bytes are lost, as at a closed port."""
        if self._host is None:
            return len(data)
        if not self._send() or len(self._going) >= CHUNK:
            return 0
        self._going += data if self._talk is None else self._talk.encode(data)
        self._send()
        return len(data)

    def end(self) -> None:
        """Disconnect all hosts."""
        self.close()
        if self._next is not None:
            self._next.close()

    def close(self) -> None:
        """Disconnect the host."""
        if self._host is not None:
            self._host.close()
        self._host = self._talk = None
        self._going = b""

    def _send(self) -> bool:
        """Send as much as possible; return False if the host has disconnected."""
        assert self._host is not None
        try:
            self._going = self._going[self._host.send(self._going) :]
        except (BlockingIOError, InterruptedError):
            return True
        except OSError:
            self.close()
            return False
        return True

    def _accept(self) -> None:
        """Accept a new host; it waits while another one is connected."""
        try:
            host, _ = self._listener.accept()
        except OSError:
            return
        if self._next is not None or self._unplugged():
            host.close()
        else:
            self._next, self._until = host, monotonic() + PATIENCE

    def _admit_next(self) -> None:
        """Connect the waiting host when possible; disconnect it after a timeout."""
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
