"""A server on a socket in this process, and raw bytes sent to it."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from threading import Event, Thread
from typing import Any, NamedTuple

import uvicorn

from printer_slicer.print_queue import JobRequest, PrintQueue, Supervisor, open_queue, read_file_facts
from printer_slicer.print_queue.supervisor import launch_run, lock_queue
from printer_slicer.printing.job_store import default_job_store
from printer_slicer.server.access import SCOPES, AccessStore
from printer_slicer.server.guard import GuardSettings
from printer_slicer.server.running import Listener, make_server_config
from printer_slicer.server.services import Services
from tests.waiting import LAST_RESORT, until

PRINTERS = '[left]\nport = "sim:"\nprofile = "marlin_220"\nspeed = 20\n'


class LiveServer(NamedTuple):
    """A server that listens at a port of this computer."""

    queue: PrintQueue
    access: AccessStore
    server: uvicorn.Server
    port: int
    key: str

    def connect(self) -> socket.socket:
        """A new connection."""
        return socket.create_connection(("127.0.0.1", self.port), LAST_RESORT)

    def talk(self, *pieces: bytes) -> bytes:
        """Send bytes, and return what comes back until the server closes the connection."""
        with self.connect() as connection:
            with suppress(OSError):  # the server does not want more
                for piece in pieces:
                    connection.sendall(piece)
            return read_all(connection)

    def head(self, request: str, *headers: str, key: str | None = None) -> bytes:
        """Head of a request with a key, which ends the connection."""
        wanted = self.key if key is None else key
        lines = (request + " HTTP/1.1", "Host: localhost", "Connection: close", f"X-Api-Key: {wanted}")
        return "\r\n".join((*lines, *headers, "", "")).encode("latin-1")

    def get(self, path: str, *headers: str, key: str | None = None) -> bytes:
        """The whole response to a GET."""
        return self.talk(self.head(f"GET {path}", *headers, key=key))


def read_all(connection: socket.socket) -> bytes:
    """All bytes until the other side closes the connection."""
    received = b""
    with suppress(ConnectionError):
        while piece := connection.recv(65536):
            received += piece
    return received


def read_response(connection: socket.socket) -> bytes:
    """One whole response with a `content-length`, after which the connection may stay open."""
    received = b""
    while b"\r\n\r\n" not in received:
        piece = connection.recv(65536)
        if not piece:
            return received
        received += piece
    head, body = received.split(b"\r\n\r\n", 1)
    length = int(head.lower().split(b"content-length: ", 1)[1].split(b"\r\n", 1)[0])
    while len(body) < length and (piece := connection.recv(65536)):
        body += piece
    return head + b"\r\n\r\n" + body


def status_of(response: bytes) -> int:
    """Status code of a response; 0 for none."""
    return int(response.split(b" ", 2)[1]) if response.startswith(b"HTTP/") else 0


@contextmanager
def run_live_server(folder: Path, listener: Listener | None = None) -> Iterator[LiveServer]:
    """Run a server on a new queue in a folder."""
    (folder / "printers.toml").write_text(PRINTERS)
    queue, access = open_queue(folder / "queue", folder / "printers.toml"), AccessStore(folder / "access.db")
    _, key = access.create_key("tests", SCOPES)
    services = Services(
        queue, access, GuardSettings(frozenset({"localhost", "127.0.0.1"})), default_job_store()
    )
    config = make_server_config(services, listener or Listener())
    server = uvicorn.Server(config)
    with socket.create_server(("127.0.0.1", 0)) as listening:
        thread = Thread(target=server.run, args=([listening],))
        thread.start()
        try:
            until(lambda: server.started or not thread.is_alive())
            yield LiveServer(queue, access, server, listening.getsockname()[1], key)
        finally:
            server.should_exit = True
            thread.join()
            services.close()


@contextmanager
def supervise(queue: PrintQueue) -> Iterator[None]:
    """Start the jobs of the queue within a `with` block, and wait for the end of their processes."""
    stop, processes = Event(), list[Any]()

    def launch(folder: Path) -> Any:
        processes.append(launch_run(folder))
        return processes[-1]

    def work() -> None:
        with lock_queue(queue):
            Supervisor(queue, launch=launch).run(stop.is_set)

    thread = Thread(target=work)
    thread.start()
    try:
        yield
    finally:
        stop.set()
        thread.join()
        for process in processes:
            process.wait()


def add_job(queue: PrintQueue, gcode: bytes) -> int:
    """Queue G-code on a bed that is clear; return the number of the job."""
    file = queue.add_file("part.gcode", [gcode])
    queue.store_facts(file.id, read_file_facts(queue.files.find_path(file.id), file.name))
    queue.set_bed("left", "clear")
    return queue.add_jobs(file.id, JobRequest())[0].id
