"""Resynchronize with a printer that is still running: find its last accepted line and the end of its planned motion.

No motion command is sent, and line numbers are not reset. A query with a number far ahead is rejected, and the
rejection names the wanted line. Oks of earlier lines may still arrive, so the next number queries the temperatures,
whose answer follows all of them. The last query asks for the position.

Like the streamer, it works on bytes without I/O. `done` says when there is a result.
"""

from __future__ import annotations

from math import inf
from typing import Final

from printer_slicer.stream import replies
from printer_slicer.stream.events import AxisPositions, Busy, Temperature
from printer_slicer.stream.framing import frame

__all__ = ["Resync"]

_AHEAD: Final = 100_000
"""Distance of the rejected line number from the highest number that may have been sent."""

_QUIET: Final = 0.3
"""s after a rejection in which it may be repeated."""

_AGAIN: Final = 2.0
_PATIENCE: Final = 30.0
"""s without an answer until the printer counts as unresponsive."""

_NO_REFUSAL: Final = 8
"""Number of answers to a query that should be rejected; six of them may belong to earlier lines."""

_QUERIES: Final = (b"M105", b"M114")


class Resync:
    """Queries to a printer whose host has gone.

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
        self._invalid_number = last + _AHEAD
        self._rejected: int | None = None
        self._answers = 0
        self._n_answered = 0  # number of answered queries
        self._due = -inf
        self._sent = False
        self._last_heard: float | None = None
        self._partial = b""

    def queries(self) -> tuple[tuple[int, bytes], ...]:
        """Return the queries that follow once `line` is known, with their line numbers."""
        line = self.line
        return () if line is None else tuple((line + 1 + i, query) for i, query in enumerate(_QUERIES))

    def send(self, now: float) -> bytes:
        """Return the bytes to write now; may be empty."""
        if self._last_heard is None:
            self._last_heard = now
        if self.done or now < self._due:
            return b""
        if now >= self._last_heard + _PATIENCE:
            self._fail("the printer does not answer")
            return b""
        self._due = now + _AGAIN
        self._sent = self.line is not None
        if self.line is None:
            return b"\n%s\n" % frame(self._invalid_number, b"M105")
        return b"\n%s\n" % frame(*self.queries()[self._n_answered])

    def wakeup(self) -> float | None:
        """Return when to call `send` even if nothing arrives, s; None if done."""
        return None if self.done else max(self._due, 0.0)

    def receive(self, data: bytes, now: float) -> None:
        """Process received bytes."""
        *lines, self._partial = (self._partial + data).split(b"\n")
        self._partial = self._partial[-1024:]
        for line in lines:
            for reply in replies.read_reply(line.rstrip(b"\r")):
                if not self.done:
                    self._process(reply, now)

    def _process(self, reply: replies.Reply, now: float) -> None:
        if isinstance(reply, replies.Garbled):
            return
        if not isinstance(reply, Temperature) or reply.waiting:  # temperature reports come without a query
            self._last_heard = now
        self._check_end(reply)
        if isinstance(reply, replies.Resend | replies.LineError):
            self._on_rejection(reply.number if isinstance(reply, replies.Resend) else reply.wanted, now)
        elif isinstance(reply, replies.Ok):
            self._on_ok(reply, now)
        elif isinstance(reply, Busy | Temperature):
            self._on_report(reply, now)
        elif isinstance(reply, replies.Position) and self._n_answered == 1:
            self.position = (reply.x, reply.y, reply.z)

    def _check_end(self, reply: replies.Reply) -> None:
        """Fail if the printer has restarted or stopped."""
        if isinstance(reply, replies.Started):
            self._fail("it was reset")
        elif isinstance(reply, replies.Stopped):
            self._fail(f"it has stopped: {reply.text}")

    def _on_report(self, reply: Busy | Temperature, now: float) -> None:
        """Record a temperature report or a busy message."""
        if isinstance(reply, Temperature):
            self.temperature = reply
        if isinstance(reply, Busy) or reply.waiting:
            self._postpone(now)

    def _postpone(self, now: float) -> None:
        """Postpone the next query while the printer is busy, so that its buffer does not fill up."""
        if self.line is not None and self._sent:
            self._due = max(self._due, now + _AGAIN)

    def _on_rejection(self, wanted: int, now: float) -> None:
        if self.line is None:
            if wanted == self._rejected:
                self.line = wanted - 1
                self._due = now + _QUIET
            self._rejected = wanted
            return
        first = self.line + 1
        if wanted == first + self._n_answered + 1:
            self._answered(now)  # the answer was lost
        elif wanted == first + self._n_answered:
            self._due = now + _QUIET  # an earlier rejection was repeated, or the query was lost
        else:
            self._fail(f"it requests line {wanted} after line {first + self._n_answered}")

    def _on_ok(self, ok: replies.Ok, now: float) -> None:
        if self.line is None:
            # Some answers may belong to earlier queries. Firmware that never rejects ignores line numbers.
            self._answers += ok.heat
            if ok.heat:  # the printer answers, so the next query can follow soon
                self._due = min(self._due, now + _QUIET)
            if self._answers >= _NO_REFUSAL and self._rejected is None:
                self._fail("its firmware does not check line numbers")
            return
        if (self._n_answered == 0 and ok.heat) or (
            self._n_answered == 1 and not ok.heat and self.position is not None
        ):
            self._answered(now)

    def _answered(self, now: float) -> None:
        self._n_answered += 1
        self._sent = False
        self._due = now
        if self._n_answered >= len(_QUERIES):
            self.done = True

    def _fail(self, reason: str) -> None:
        self.reason = reason
        self.done = True
