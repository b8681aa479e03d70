"""Serve a simulated printer at a TCP port, as plain bytes or with RFC 2217.

One host can connect at a time, as to a serial port; a second one is disconnected after a second. The printer keeps
running while no host is connected.
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
from printer_slicer.sim.server_loop import CHUNK_BYTES, Clock, exchange_bytes

if TYPE_CHECKING:
    from printer_slicer.sim.printer import SimulatedPrinter
    from printer_slicer.sim.statistics import Report

__all__ = ["Telnet", "serve_tcp"]


HOST_TIMEOUT: Final = 1.0
"""Time that a new host waits for the previous one to disconnect, s."""


class Telnet(Protocol):
    """A protocol for serial port settings over a connection, see `rfc2217.Rfc2217Server`."""

    def take_answers(self) -> bytes:
        """Return the protocol bytes that must be sent to the host."""

    def decode(self, data: bytes) -> bytes:
        """Return the bytes for the printer in the host's data; raise ValueError for invalid data."""

    def encode(self, data: bytes) -> bytes:
        """Return bytes of the printer encoded for the host."""


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
    """Serve a simulated printer at a TCP address until `stop` returns True or Ctrl-C; return the report.

    Args:
        printer_factory: function that creates the printer when the port is open.
        address: host and port to listen at; port 0 chooses a free one.
        speed: simulated seconds per real second, as for `pty_server.serve`.
        connect: function that creates the cable, as for `pty_server.serve`.
        telnet: function that creates the RFC 2217 encoder for a new host; None: bytes are not changed.
        unplugged: function that returns whether the cable is disconnected; no host can connect then.
        stop: function that returns whether to stop; called about twenty times a second.
        ready: function that is called with `host:port` when a host can connect.

    Raises:
        PortError: the server cannot listen at this address.
    """
    with _open_listener(address) as listener:
        host, port = listener.getsockname()[:2]
        ready(f"{host}:{port}")
        printer = printer_factory()
        with contextlib.ExitStack() as cleanup:
            hosts = _TcpConnection(listener, telnet, unplugged)
            cleanup.callback(hosts.disconnect_all)
            # Users stop the server with Ctrl-C.
            with contextlib.suppress(KeyboardInterrupt):
                exchange_bytes(printer, connect(printer), Clock(speed), hosts, stop)
            return printer.report()


def _open_listener(address: tuple[str, int]) -> socket.socket:
    """Return a socket that listens at an address.

    Raises:
        PortError: the server cannot listen at this address.
    """
    try:
        return socket.create_server(address, backlog=4)
    except (OSError, OverflowError) as error:
        raise PortError(
            f"cannot listen at {address[0]}:{address[1]}: {getattr(error, 'strerror', None) or error}",
            remedy="Choose a free port above 1024, and an address of this computer",
        ) from error


class _TcpConnection:
    """The connection to the current host; only one host can be connected at a time."""

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
        self._encoder: Telnet | None = None
        self._outgoing = b""  # encoded bytes not sent yet
        self._waiting_host: socket.socket | None = None
        self._deadline = 0.0

    def wait(self, seconds: float, *, reads: bool, writes: bool) -> bool:
        """Wait up to `seconds` for data, a chance to write or a new host; return whether there is data."""
        if self._unplugged():
            self.close()
        mine = [self._host] if self._host is not None else []
        wants = [self._listener, *(mine if reads else [])]
        readable, ready, _ = select.select(wants, mine if writes or self._outgoing else [], [], seconds)
        if ready and self._outgoing:
            self._send_outgoing_bytes()
        if self._listener in readable:
            self._accept_host()
        self._admit_waiting_host()
        return self._host is not None and self._host in readable

    def read(self) -> bytes:
        """Return the bytes from the host; close the connection if the host has disconnected."""
        assert self._host is not None
        try:
            data = self._host.recv(CHUNK_BYTES)
        except (BlockingIOError, InterruptedError):
            return b""
        except OSError:
            data = b""
        if not data:
            self.close()
            return b""
        if self._encoder is None:
            return data
        try:
            data = self._encoder.decode(data)
        except ValueError:
            self.close()
            return b""
        self._outgoing += self._encoder.take_answers()
        self._send_outgoing_bytes()
        return data

    def write(self, data: bytes) -> int:
        """Send bytes to the host; return how many were accepted. Without a host, all are lost."""
        if self._host is None:
            return len(data)
        if not self._send_outgoing_bytes() or len(self._outgoing) >= CHUNK_BYTES:
            return 0
        self._outgoing += data if self._encoder is None else self._encoder.encode(data)
        self._send_outgoing_bytes()
        return len(data)

    def disconnect_all(self) -> None:
        """Disconnect the current and the waiting host."""
        self.close()
        if self._waiting_host is not None:
            self._waiting_host.close()

    def close(self) -> None:
        """Disconnect the current host."""
        if self._host is not None:
            self._host.close()
        self._host = self._encoder = None
        self._outgoing = b""

    def _send_outgoing_bytes(self) -> bool:
        """Send as many outgoing bytes as possible; return False if the host has disconnected."""
        assert self._host is not None
        try:
            self._outgoing = self._outgoing[self._host.send(self._outgoing) :]
        except (BlockingIOError, InterruptedError):
            return True
        except OSError:
            self.close()
            return False
        return True

    def _accept_host(self) -> None:
        """Accept a new host; if another host is connected, the new host waits."""
        try:
            host, _ = self._listener.accept()
        except OSError:
            return
        if self._waiting_host is not None or self._unplugged():
            host.close()
        else:
            self._waiting_host, self._deadline = host, monotonic() + HOST_TIMEOUT

    def _admit_waiting_host(self) -> None:
        """Connect the waiting host once no other host is connected; disconnect it after a timeout."""
        if self._waiting_host is None or (self._host is not None and monotonic() < self._deadline):
            return
        host, self._waiting_host = self._waiting_host, None
        if self._host is not None:
            host.close()
            return
        host.setblocking(False)
        host.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        host.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        self._host = host
        if self._telnet is not None:
            self._encoder = self._telnet()
            self._outgoing = self._encoder.take_answers()
            self._send_outgoing_bytes()
