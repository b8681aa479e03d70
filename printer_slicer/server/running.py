"""Run the web server until it is interrupted, with a supervisor that starts the jobs of the queue."""

from __future__ import annotations

import sys
from collections.abc import Callable
from ipaddress import ip_address
from socket import socket
from threading import Event, Thread
from typing import Final

import uvicorn

from printer_slicer.errors import PortError, UsageError
from printer_slicer.print_queue import PrintQueue, Supervisor
from printer_slicer.print_queue.supervisor import lock_queue
from printer_slicer.printing.job_store import default_job_store
from printer_slicer.server.access import AccessStore
from printer_slicer.server.app import make_app
from printer_slicer.server.connections import MAX_CONNECTIONS, LimitedConnection
from printer_slicer.server.guard import GuardSettings
from printer_slicer.server.services import Services
from printer_slicer.values import Struct

__all__ = [
    "Listener",
    "RunningSupervisor",
    "check_listener",
    "make_server_config",
    "parse_listener",
    "run_server",
]

_LOOPBACK_NAMES: Final = ("localhost", "127.0.0.1", "::1")
_LOCK_INTERVAL: Final = 2.0  # s between attempts to run the queue that another process runs
_MAX_FRAME: Final = 64 * 1024  # bytes from a browser


class Listener(Struct, frozen=True):
    """Where the server listens, and who may call it.

    Attributes:
        address: IP address of the interface.
        port: TCP port.
        hosts: further names under which browsers call the server.
        origins: origins of other pages that may use the interface with a key.
        proxy: address of the reverse proxy whose forwarded headers count; empty: none.
    """

    address: str = "127.0.0.1"
    port: int = 5000
    hosts: tuple[str, ...] = ()
    origins: tuple[str, ...] = ()
    proxy: str = ""

    @property
    def is_loopback(self) -> bool:
        """Whether only programs of this computer can reach the server."""
        return ip_address(self.address).is_loopback

    @property
    def url(self) -> str:
        """Address of the page: with the first of the further names if the server listens at all interfaces."""
        names = (*self.hosts, "127.0.0.1") if ip_address(self.address).is_unspecified else (self.address,)
        host = f"[{names[0]}]" if ":" in names[0] else names[0]
        return f"http://{host}:{self.port}"


def parse_listener(text: str) -> tuple[str, int]:
    """Parse `ADDRESS`, `PORT` or `ADDRESS:PORT`.

    Raises:
        UsageError: it is none of them.
    """
    address, port = text, ""
    if text.isdecimal():
        address, port = "127.0.0.1", text
    elif text.startswith("["):
        address, _, port = text[1:].partition("]")
        port = port.removeprefix(":")
    elif text.count(":") == 1:
        address, port = text.split(":")
    address = "127.0.0.1" if address == "localhost" else address
    try:
        return str(ip_address(address)), int(port or Listener().port)
    except ValueError:
        raise UsageError(
            f"{text}: not an address of this computer",
            remedy="Write it as 127.0.0.1:5000 or 0.0.0.0",
        ) from None


def check_listener(listener: Listener, access: AccessStore) -> None:
    """Check that a server that others can reach has a key, because without one anybody could be the first.

    Raises:
        UsageError: it has none.
    """
    if not listener.is_loopback and not access.list_keys():
        raise UsageError(
            f"other computers could reach the server at {listener.address}, but there is no key",
            remedy="Create a key first: printer-slicer serve --new-key NAME --scopes all",
        )


def run_server(
    queue: PrintQueue,
    access: AccessStore,
    listener: Listener,
    *,
    on_ready: Callable[[], None],
    say: Callable[[str], None],
) -> None:
    """Run the server until it is interrupted.

    Args:
        queue: the queue.
        access: keys and sessions.
        listener: where it listens.
        on_ready: called once the server accepts requests.
        say: called with a sentence for each start and end of a print, from another thread.

    Raises:
        PortError: the address is in use, or not one of this computer.
    """
    services = Services(queue, access, _make_guard_settings(listener), default_job_store())
    server = _Server(make_server_config(services, listener), on_ready)
    try:
        with server.config.bind_socket() as listening, RunningSupervisor(queue, say):
            server.run([listening])
    except SystemExit:
        raise PortError(
            f"cannot listen at {listener.address}, port {listener.port}",
            remedy="Choose another port, or end the program that uses it",
        ) from None


def _make_guard_settings(listener: Listener) -> GuardSettings:
    """Return which hosts and origins a server accepts."""
    names = _LOOPBACK_NAMES if listener.is_loopback else (*_LOOPBACK_NAMES, listener.address)
    hosts = frozenset((*names, *map(str.lower, listener.hosts)))
    return GuardSettings(hosts, frozenset(one.lower().rstrip("/") for one in listener.origins))


def make_server_config(services: Services, listener: Listener) -> uvicorn.Config:
    """Return the settings of uvicorn for a server that these services answer."""
    return uvicorn.Config(
        make_app(services),
        host=listener.address,
        port=listener.port,
        log_level="critical",
        access_log=False,
        server_header=False,
        proxy_headers=bool(listener.proxy),
        forwarded_allow_ips=listener.proxy or None,
        http=LimitedConnection,
        limit_concurrency=MAX_CONNECTIONS,
        ws="websockets-sansio",
        ws_max_size=_MAX_FRAME,
        timeout_graceful_shutdown=1,
    )


class _Server(uvicorn.Server):
    """A server that tells when it is ready."""

    def __init__(self, config: uvicorn.Config, on_ready: Callable[[], None]) -> None:
        super().__init__(config)
        self._on_ready = on_ready

    async def startup(self, sockets: list[socket] | None = None) -> None:
        """Start to accept requests."""
        await super().startup(sockets)
        if self.started:
            self._on_ready()


class RunningSupervisor:
    """A supervisor in a thread; if another process runs the queue, it begins when that process ends."""

    def __init__(self, queue: PrintQueue, say: Callable[[str], None]) -> None:
        self._queue, self._say, self._stop = queue, say, Event()
        self._thread = Thread(target=self._run, name="supervisor of the queue")

    def __enter__(self) -> None:
        self._thread.start()

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()

    def _run(self) -> None:
        """Work on the queue until the server stops."""
        was_told = False
        try:
            while not self._stop.is_set():
                try:
                    with lock_queue(self._queue):
                        Supervisor(self._queue, on_change=self._say).run(self._stop.is_set)
                except UsageError as error:
                    if not was_told:
                        self._say(f"{error.args[0]}: it starts the jobs until it ends, then this server does")
                    was_told = True
                    self._stop.wait(_LOCK_INTERVAL)
        except Exception as error:  # noqa: BLE001 - a fault must not go unnoticed while the page looks well
            self._say(f"the supervisor of the queue has failed, no job is started any more: {error!r}")
            sys.excepthook(type(error), error, error.__traceback__)
