"""Resynchronize with a printer that is still running: find its last accepted line and the end of its planned motion.

No motion command is sent, and line numbers are not reset. A query with a number far ahead is rejected, and the
rejection names the expected line. Oks of earlier lines may still arrive, so the next number queries the temperatures,
whose answer follows all of them. The last query asks for the position.

Like the streamer, `Resync` works on bytes without I/O. `done` is True once there is a result.
"""

from __future__ import annotations

from math import inf
from typing import Final

from printer_slicer.stream import replies
from printer_slicer.stream.events import AxisPositions, Busy, Temperature
from printer_slicer.stream.framing import frame

__all__ = ["Resync"]

_NUMBER_OFFSET: Final = 100_000
"""Distance of the rejected line number from the highest number that may have been sent."""

_REPEAT_TIME: Final = 0.3
"""Time after a rejection within which the printer may repeat it, s."""

_QUERY_INTERVAL: Final = 2.0
_MAX_SILENCE: Final = 30.0
"""Time without an answer after which the printer counts as unresponsive, s."""

_MAX_UNREJECTED: Final = 8
"""Number of oks, where a rejection is expected, after which the firmware counts as ignoring line numbers.

Six of them may belong to earlier lines."""

_QUERIES: Final = (b"M105", b"M114")


class Resync:
    """Queries last line, temperatures and position of a printer whose previous host has ended.

    Args:
        last: highest line number that may have been used.

    Attributes:
        line: last line that the printer accepted before these queries, None until known.
        position: position at the end of the planned motion, None until reported.
        temperature: the last temperature report, None if there is none.
        reason: why the state cannot be determined, empty if it can.
        done: whether the result is known or cannot be determined.
    """

    def __init__(self, last: int) -> None:
        self.line: int | None = None
        self.position: AxisPositions | None = None
        self.temperature: Temperature | None = None
        self.reason = ""
        self.done = False
        self._invalid_number = last + _NUMBER_OFFSET
        self._rejected_line: int | None = None
        self._n_temperature_oks = 0
        self._n_answered = 0  # number of answered queries
        self._next_query_at = -inf
        self._is_query_sent = False
        self._last_heard: float | None = None
        self._partial = b""

    def queries(self) -> tuple[tuple[int, bytes], ...]:
        """Return the line number and text of each query that follows once `line` is known."""
        line = self.line
        return () if line is None else tuple((line + 1 + i, query) for i, query in enumerate(_QUERIES))

    def send(self, now: float) -> bytes:
        """Return the query to write now; may be empty."""
        if self._last_heard is None:
            self._last_heard = now
        if self.done or now < self._next_query_at:
            return b""
        if now >= self._last_heard + _MAX_SILENCE:
            self._fail("the printer does not answer")
            return b""
        self._next_query_at = now + _QUERY_INTERVAL
        self._is_query_sent = self.line is not None
        if self.line is None:
            return b"\n%s\n" % frame(self._invalid_number, b"M105")
        return b"\n%s\n" % frame(*self.queries()[self._n_answered])

    def wakeup(self) -> float | None:
        """Return when to call `send` even if nothing arrives, s; None if done."""
        return None if self.done else max(self._next_query_at, 0.0)

    def receive(self, data: bytes, now: float) -> None:
        """Process bytes that were received at `now`, s."""
        *lines, self._partial = (self._partial + data).split(b"\n")
        self._partial = self._partial[-1024:]
        for line in lines:
            for reply in replies.parse_replies(line.rstrip(b"\r")):
                if not self.done:
                    self._process_reply(reply, now)

    def _process_reply(self, reply: replies.Reply, now: float) -> None:
        if isinstance(reply, replies.Garbled):
            return
        if not isinstance(reply, Temperature) or reply.waiting:  # temperature reports come without a query
            self._last_heard = now
        self._fail_if_restarted(reply)
        if isinstance(reply, replies.Resend | replies.LineError):
            self._on_rejection(
                reply.number if isinstance(reply, replies.Resend) else reply.expected_line, now
            )
        elif isinstance(reply, replies.Ok):
            self._on_ok(reply, now)
        elif isinstance(reply, Busy | Temperature):
            self._on_report(reply, now)
        elif isinstance(reply, replies.Position) and self._n_answered == 1:
            self.position = (reply.x, reply.y, reply.z)

    def _fail_if_restarted(self, reply: replies.Reply) -> None:
        """End the queries without a result if the printer has restarted or stopped."""
        if isinstance(reply, replies.Started):
            self._fail("the printer was reset")
        elif isinstance(reply, replies.Stopped):
            self._fail(f"the printer has stopped: {reply.text}")

    def _on_report(self, reply: Busy | Temperature, now: float) -> None:
        """Record a temperature report or a busy message."""
        if isinstance(reply, Temperature):
            self.temperature = reply
        if isinstance(reply, Busy) or reply.waiting:
            self._postpone_query(now)

    def _postpone_query(self, now: float) -> None:
        """Postpone the next query while the printer is busy, so that its buffer does not fill up."""
        if self.line is not None and self._is_query_sent:
            self._next_query_at = max(self._next_query_at, now + _QUERY_INTERVAL)

    def _on_rejection(self, expected: int, now: float) -> None:
        """Handle a rejection, which names the line that the printer expects."""
        if self.line is None:
            if expected == self._rejected_line:
                self.line = expected - 1
                self._next_query_at = now + _REPEAT_TIME
            self._rejected_line = expected
            return
        first = self.line + 1
        if expected == first + self._n_answered + 1:
            self._finish_query(now)  # the answer was lost
        elif expected == first + self._n_answered:
            self._next_query_at = (
                now + _REPEAT_TIME
            )  # an earlier rejection was repeated, or the query was lost
        else:
            self._fail(f"the printer requests line {expected} after line {first + self._n_answered}")

    def _on_ok(self, ok: replies.Ok, now: float) -> None:
        """Handle an ok, which answers a query or an earlier line."""
        if self.line is None:
            # Some answers may belong to earlier queries. Firmware that never rejects ignores line numbers.
            self._n_temperature_oks += ok.has_temperatures
            if ok.has_temperatures:  # the printer answers, so the next query can follow soon
                self._next_query_at = min(self._next_query_at, now + _REPEAT_TIME)
            if self._n_temperature_oks >= _MAX_UNREJECTED and self._rejected_line is None:
                self._fail("the firmware does not check line numbers")
            return
        if (self._n_answered == 0 and ok.has_temperatures) or (
            self._n_answered == 1 and not ok.has_temperatures and self.position is not None
        ):
            self._finish_query(now)

    def _finish_query(self, now: float) -> None:
        """Count a query as answered, and allow the next query."""
        self._n_answered += 1
        self._is_query_sent = False
        self._next_query_at = now
        if self._n_answered >= len(_QUERIES):
            self.done = True

    def _fail(self, reason: str) -> None:
        """End the queries without a result, because of `reason`."""
        self.reason = reason
        self.done = True
