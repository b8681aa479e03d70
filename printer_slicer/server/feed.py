"""Status of the queue and of all running prints, for browsers.

One thread watches the queue, and one each running print. They keep only the newest status, so a slow browser gets
fewer messages and never old ones, and each message is encoded once for all browsers.
"""

from __future__ import annotations

import asyncio
import json
import socket
from collections import deque
from contextlib import suppress
from threading import Event as Flag
from threading import Lock, Thread
from time import time
from typing import Any, Final

from printer_slicer.errors import PortError, PrinterSlicerError
from printer_slicer.print_queue import PrintRun
from printer_slicer.printing.control_socket import connect_to_print
from printer_slicer.server.json_values import encode_json
from printer_slicer.server.services import Services
from printer_slicer.values import Struct, field

__all__ = ["Feed", "FeedPosition"]

_CONSOLE_LINES: Final = 500
_QUEUE_TIMEOUT: Final = 0.5  # s, after which the watcher of the queue looks whether the server stops
_PRINT_TIMEOUT: Final = 30.0  # s without any message, after which a print is connected again
_RETRY: Final = 1.0  # s


class FeedPosition(Struct, frozen=True):
    """What a browser has got: messages about the queue, and for each run its version and its last console line."""

    n_queue_messages: int = 0
    runs: dict[str, tuple[int, int]] = field(default_factory=dict)


class _WatchedRun:
    """The newest status of a running print."""

    def __init__(self, run: PrintRun) -> None:
        self.run = run
        self.version = 0
        self.status: dict[str, Any] = {}
        self.console: deque[list[Any]] = deque(maxlen=_CONSOLE_LINES)
        self.encoded: dict[tuple[int, int], bytes] = {}
        self.connection: socket.socket | None = None

    def add(self, message: dict[str, Any]) -> None:
        """Add a message of the print process."""
        self.status = {**message.get("status", self.status), **message.get("changes", {})}
        self.console.extend(message.get("console", ()))
        self.version += 1

    @property
    def last_line(self) -> int:
        """Number of the last console line; 0 before the first."""
        return int(self.console[-1][0]) if self.console else 0

    def encode(self, last_line: int) -> bytes:
        """Return the message for browsers that have the console up to a line."""
        key = (self.version, last_line)
        if key not in self.encoded:
            lines = [line for line in self.console if line[0] > last_line]
            message = {
                "kind": "print",
                "run": self.run.id,
                "printer": self.run.printer,
                "status": self.status,
            }
            self.encoded = {key: json.dumps(message | {"console": lines}).encode()}
        return self.encoded[key]


class Feed:
    """Watches the queue and all running prints.

    Args:
        services: with the queue and the folder of the prints.
    """

    def __init__(self, services: Services) -> None:
        self._services, self._lock, self._stop = services, Lock(), Flag()
        self._runs: dict[str, _WatchedRun] = {}
        self._n_queue_messages, self._queue = 0, b""
        self._waiting: set[tuple[asyncio.AbstractEventLoop, asyncio.Event]] = set()
        self._thread = Thread(target=self._watch_queue, name="queue watcher", daemon=True)

    def start(self) -> None:
        """Start to watch."""
        self._thread.start()

    def close(self) -> None:
        """Stop to watch."""
        self._stop.set()
        with self._lock:
            watched = list(self._runs.values())
        for one in watched:
            _disconnect(one)
        self._thread.join()

    def find_status(self, printer: str) -> dict[str, Any]:
        """Return the newest status of the print on a printer; empty if nothing is printed or it is not known yet."""
        with self._lock:
            return next((dict(one.status) for one in self._runs.values() if one.run.printer == printer), {})

    def list_messages(self, position: FeedPosition) -> tuple[list[bytes], FeedPosition]:
        """Return the messages that a browser at this position needs, and its position after them."""
        messages, runs = list[bytes](), dict[str, tuple[int, int]]()
        with self._lock:
            if self._n_queue_messages != position.n_queue_messages:
                messages.append(self._queue)
            for key, one in self._runs.items():
                version, last_line = position.runs.get(key, (0, 0))
                if one.version != version:
                    messages.append(one.encode(last_line))
                runs[key] = (one.version, max(one.last_line, last_line))
            return messages, FeedPosition(self._n_queue_messages, runs)

    async def wait(self, position: FeedPosition, timeout: float) -> None:
        """Wait until a browser at this position has something to get, or for a timeout in s."""
        entry = (asyncio.get_running_loop(), asyncio.Event())
        with self._lock:
            versions = {key: one.version for key, one in self._runs.items()}
            known = {key: version for key, (version, _) in position.runs.items()}
            if self._n_queue_messages != position.n_queue_messages or versions != known:
                return
            self._waiting.add(entry)
        with suppress(TimeoutError):
            await asyncio.wait_for(entry[1].wait(), timeout)
        with self._lock:
            self._waiting.discard(entry)

    def _notify(self) -> None:
        """Wake all browsers; the lock is held."""
        for loop, event in self._waiting:
            with suppress(RuntimeError):  # the loop is closed
                loop.call_soon_threadsafe(event.set)
        self._waiting.clear()

    def _watch_queue(self) -> None:
        """Follow the queue until the server stops; start to watch each new run."""
        while not self._stop.is_set():
            try:
                snapshot = self._services.queue.snapshot()
                encoded = b'{"kind":"queue","queue":' + encode_json(snapshot) + b"}"
                self._follow(snapshot.runs)
                self._publish(encoded)
                self._services.queue.wait_for_change(snapshot.revision, _QUEUE_TIMEOUT)
            except PrinterSlicerError as error:  # printers.toml is invalid or the disk is full
                message = {"kind": "problem", "detail": str(error.args[0]), "remedy": error.remedy}
                self._publish(json.dumps(message).encode())
                self._stop.wait(_QUEUE_TIMEOUT)

    def _publish(self, message: bytes) -> None:
        """Send a message about the queue, or why it cannot be read, unless it was the last one."""
        with self._lock:
            if message != self._queue:
                self._queue = message
                self._n_queue_messages += 1
                self._notify()

    def _follow(self, runs: tuple[PrintRun, ...]) -> None:
        """Watch exactly these runs."""
        now = {run.id: run for run in runs}
        with self._lock:
            for key in self._runs.keys() - now.keys():
                _disconnect(self._runs.pop(key))
            new = [_WatchedRun(run) for key, run in now.items() if key not in self._runs]
            self._runs |= {one.run.id: one for one in new}
        for one in new:
            Thread(target=self._watch_run, args=(one,), name=f"watcher of {one.run.id}", daemon=True).start()

    def _watch_run(self, watched: _WatchedRun) -> None:
        """Follow a print until it ends or the server stops."""
        folder, key, pause = self._services.job_store / watched.run.id, watched.run.id, Flag()
        while not self._stop.is_set() and self._runs.get(key) is watched:
            try:
                watched.connection = connect_to_print(folder, f"watch {watched.last_line}", _PRINT_TIMEOUT)
                with watched.connection, watched.connection.makefile("rb") as lines:
                    for line in lines:
                        message = json.loads(line)
                        with self._lock:
                            watched.add(message)
                            self._notify()
                        temperatures = watched.status.get("temperatures", {})
                        self._services.temperatures.add(watched.run.printer, temperatures, time())
            except (PortError, OSError, ValueError):
                pass  # the print has not opened its socket yet, or has ended
            pause.wait(_RETRY)


def _disconnect(watched: _WatchedRun) -> None:
    """End the connection to a print, so that its thread ends."""
    if watched.connection is not None:
        with suppress(OSError):
            watched.connection.shutdown(socket.SHUT_RDWR)
