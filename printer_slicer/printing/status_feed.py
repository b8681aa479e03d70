"""Send the status of a running print to watchers: what changed, at most five times a second, from a thread of its own.

The thread that writes to the port only stores events. A watcher that reads too slowly gets fewer and newer messages,
and is disconnected when it has read nothing for two seconds. The print never waits for a watcher.

Each message is one line of JSON. The first has `status`, the whole status, and the last console lines. Later ones have
`changes`, the members of the status that changed. All have `seq`, a number that grows, and may have `console`: lists
of number, kind and text of a line. The last one has `ended`.
"""

from __future__ import annotations

import json
import socket
from collections import deque
from collections.abc import Callable
from threading import Event as Flag
from threading import Lock, Thread
from time import monotonic
from typing import Any, Final

from printer_slicer.stream.events import (
    Action,
    Busy,
    Event,
    Finished,
    Halted,
    Identified,
    Message,
    Paused,
    PoorLink,
    Prompt,
    ResendRequested,
    Resumed,
    Stopping,
    StreamWarning,
    Temperature,
    get_event_kind,
)

__all__ = ["MAX_CONSOLE_LINES", "MAX_WATCHERS", "StatusFeed"]

MAX_CONSOLE_LINES: Final = 500
"""Number of console lines kept for new watchers."""

MAX_WATCHERS: Final = 16
"""Number of watchers of one print; further ones are rejected."""

_INTERVAL: Final = 0.2  # s between two messages, except for urgent events
_STALL_TIMEOUT: Final = 2.0  # s after which a watcher that reads nothing is disconnected
_HEARTBEAT: Final = 10.0  # s without a change after which an empty message is sent
_CLOSE_TIMEOUT: Final = 1.0  # s to send the last message
_MAX_TEXT: Final = 500  # characters of a console line
_URGENT: Final = (Paused, Resumed, Prompt, Halted, Stopping, Finished)


class StatusFeed:
    """Sends the status of one print to its watchers.

    Args:
        read_status: returns the status of the print at once; called on the thread of the feed.
        interval: least time between two messages, s.
    """

    def __init__(self, read_status: Callable[[], dict[str, Any]], *, interval: float = _INTERVAL) -> None:
        self._read_status, self._interval = read_status, interval
        self._console: deque[tuple[int, str, str]] = deque(maxlen=MAX_CONSOLE_LINES)
        self._n_lines = self._n_resends = self._seq = 0
        self._ended: dict[str, Any] | None = None
        self._watchers: list[_Watcher] = []
        self._lock, self._wake, self._closing = Lock(), Flag(), False
        self._thread: Thread | None = None

    def on_event(self, event: Event) -> None:
        """Store an event; called on the thread that writes to the port."""
        if isinstance(event, Temperature | Identified):
            return
        if text := _describe_event(event):
            self._add_line(get_event_kind(event), text[:_MAX_TEXT], repeats=not isinstance(event, Busy))
        if isinstance(event, ResendRequested):
            self._n_resends += 1
        elif isinstance(event, Finished):
            self._ended = {"cancelled": event.cancelled, "verified": event.verified, "reason": ""}
        elif isinstance(event, Halted):
            self._ended = {"cancelled": False, "verified": None, "reason": event.reason}
        if isinstance(event, _URGENT) and self._watchers:
            self._wake.set()

    def _add_line(self, kind: str, text: str, *, repeats: bool) -> None:
        """Add a console line, unless it is the last one again and lines like it are not to be repeated."""
        if repeats or not self._console or self._console[-1][1:] != (kind, text):
            self._n_lines += 1
            self._console.append((self._n_lines, kind, text))

    def add(self, connection: socket.socket, name: str, last_line: int = 0) -> bool:
        """Send the status to this connection from now on; return False, and close it, if there are too many.

        Args:
            connection: a connected socket, which now belongs to the feed.
            name: name of the job.
            last_line: number of the last console line that the watcher knows.
        """
        with self._lock:
            if self._closing or len(self._watchers) >= MAX_WATCHERS:
                connection.close()
                return False
            connection.setblocking(False)
            self._watchers.append(_Watcher(connection, name, last_line))
            if self._thread is None:
                self._thread = Thread(target=self._run, name="watchers", daemon=True)
                self._thread.start()
        self._wake.set()
        return True

    def close(self) -> None:
        """Send the last message, and disconnect all watchers."""
        with self._lock:
            self._closing = True
        self._wake.set()
        if self._thread is not None:
            self._thread.join(_CLOSE_TIMEOUT * 2)

    def _run(self) -> None:
        """Send messages until the feed is closed."""
        pause = Flag()
        while not self._closing:
            self._wake.wait(self._interval if self._watchers else None)
            self._wake.clear()
            self._send_to_all()
            pause.wait(0.01)  # urgent events arrive in groups
        end = monotonic() + _CLOSE_TIMEOUT
        self._send_to_all(last=True)
        while any(one.pending for one in self._watchers) and monotonic() < end:
            pause.wait(0.01)
            self._send_to_all(last=True)
        for one in self._watchers:
            one.connection.close()
        self._watchers = []

    def _send_to_all(self, *, last: bool = False) -> None:
        """Send each watcher what changed since its last message; forget those who are gone."""
        status = self._read_status() | {"resends": self._n_resends}
        console = list(self._console)
        self._seq += 1
        now = monotonic()
        end = {"ended": self._ended or {}} if last else {}
        for one in list(self._watchers):
            if not one.update(self._seq, status, console, end, now):
                one.connection.close()
                with self._lock:
                    self._watchers.remove(one)


class _Watcher:
    """A connection, and what its other end knows."""

    def __init__(self, connection: socket.socket, name: str, last_line: int) -> None:
        self.connection, self.pending = connection, b""
        self._name, self._last_line = name, last_line
        self._known: dict[str, Any] | None = None
        self._progress_at = self._sent_at = monotonic()
        self._has_end = False

    def update(
        self,
        seq: int,
        status: dict[str, Any],
        console: list[tuple[int, str, str]],
        end: dict[str, Any],
        now: float,
    ) -> bool:
        """Send as much as possible without waiting; return False if the watcher is gone or too slow."""
        if not self.pending and not self._has_end:
            message = self._make_message(status, console) | end
            if message or now - self._sent_at > _HEARTBEAT:
                self.pending = json.dumps({"seq": seq, **message}).encode() + b"\n"
                self._progress_at = self._sent_at = now
                self._has_end = bool(end)
        try:
            while self.pending:
                self.pending = self.pending[self.connection.send(self.pending) :]
                self._progress_at = now
        except (BlockingIOError, InterruptedError):
            pass
        except OSError:
            return False
        return now - self._progress_at <= _STALL_TIMEOUT or not self.pending

    def _make_message(self, status: dict[str, Any], console: list[tuple[int, str, str]]) -> dict[str, Any]:
        """Return what the watcher does not know yet, and remember that it knows it."""
        lines = [line for line in console if line[0] > self._last_line]
        self._last_line = console[-1][0] if console else self._last_line
        extra = {"console": lines} if lines else {}
        known, self._known = self._known, status
        if known is None:
            return {"ok": True, "job": self._name, "status": status, **extra}
        changes = {name: value for name, value in status.items() if known.get(name) != value}
        return ({"changes": changes} if changes else {}) | extra


def _describe_event(event: Event) -> str:
    """Return the console line of an event; empty for an event that the status contains."""
    if isinstance(event, Message | StreamWarning | PoorLink | Prompt | Action | ResendRequested):
        return event.text
    if isinstance(event, Paused | Busy | Halted):
        return event.reason
    return ""
