"""Finding a printer again that goes on by itself: which line it took last, and where its plan ends.

Nothing that moves is sent, and nothing is begun anew. A question with a number far ahead must be refused, and the
refusal names the line wanted; the oks of lines from before may still be on their way, so the next number then asks for
the temperatures, whose answer comes behind all of them. The last question is where the plan ends.

Bytes in, bytes out, like the streamer; `done` tells when there is a result.
"""

from __future__ import annotations

from math import inf
from typing import Final

from printer_slicer.stream import replies
from printer_slicer.stream.events import AxisPositions, Busy, Temperature
from printer_slicer.stream.framing import frame

__all__ = ["Resync"]

_AHEAD: Final = 100_000
"""Lines ahead of anything that was ever sent."""

_QUIET: Final = 0.3
"""s after the refusal in which repeated ones may still come."""

_AGAIN: Final = 2.0
_PATIENCE: Final = 30.0
"""s without any sign of life."""

_NO_REFUSAL: Final = 8
"""Answers to a question that should have been refused, beyond the six that may come from before."""

_QUESTIONS: Final = (b"M105", b"M114")


class Resync:
    """The questions to a printer that was left.

    Args:
        last: highest line number that may have been used.

    Attributes:
        line: the last line it took before these questions, None until it is known.
        position: where its plan ends, None until told.
        temperature: the last report, None before any.
        reason: why it cannot be told, empty while it may.
        done: whether all is known, or never will be.
    """

    def __init__(self, last: int) -> None:
        self.line: int | None = None
        self.position: AxisPositions | None = None
        self.temperature: Temperature | None = None
        self.reason = ""
        self.done = False
        self._wrong = last + _AHEAD
        self._named: int | None = None
        self._answers = 0
        self._asked = 0  # of the questions, so many are answered
        self._due = -inf
        self._sent = False
        self._heard: float | None = None
        self._partial = b""

    def questions(self) -> tuple[tuple[int, bytes], ...]:
        """The lines that it sends once `line` is known, with their numbers."""
        line = self.line
        return (
            () if line is None else tuple((line + 1 + i, question) for i, question in enumerate(_QUESTIONS))
        )

    def send(self, now: float) -> bytes:
        """What to write now; may be empty."""
        if self._heard is None:
            self._heard = now
        if self.done or now < self._due:
            return b""
        if now >= self._heard + _PATIENCE:
            self._fail("the printer does not answer")
            return b""
        self._due = now + _AGAIN
        self._sent = self.line is not None
        if self.line is None:
            return b"\n%s\n" % frame(self._wrong, b"M105")
        return b"\n%s\n" % frame(*self.questions()[self._asked])

    def wakeup(self) -> float | None:
        """When to call `send` even if nothing arrives."""
        return None if self.done else max(self._due, 0.0)

    def receive(self, data: bytes, now: float) -> None:
        """Take what arrived."""
        *lines, self._partial = (self._partial + data).split(b"\n")
        self._partial = self._partial[-1024:]
        for line in lines:
            for reply in replies.read_reply(line.rstrip(b"\r")):
                if not self.done:
                    self._hear(reply, now)

    def _hear(self, reply: replies.Reply, now: float) -> None:
        if isinstance(reply, replies.Garbled):
            return
        if (
            not isinstance(reply, Temperature) or reply.waiting
        ):  # others come by themselves, whatever is asked
            self._heard = now
        self._end_of(reply)
        if isinstance(reply, replies.Resend | replies.LineError):
            self._on_named(reply.number if isinstance(reply, replies.Resend) else reply.wanted, now)
        elif isinstance(reply, replies.Ok):
            self._on_ok(reply, now)
        elif isinstance(reply, Busy | Temperature):
            self._on_sign(reply, now)
        elif isinstance(reply, replies.Position) and self._asked == 1:
            self.position = (reply.x, reply.y, reply.z)

    def _end_of(self, reply: replies.Reply) -> None:
        """Some answers leave nothing to ask."""
        if isinstance(reply, replies.Started):
            self._fail("it has just started: it was reset")
        elif isinstance(reply, replies.Stopped):
            self._fail(f"it has stopped: {reply.text}")

    def _on_sign(self, reply: Busy | Temperature, now: float) -> None:
        """It lives."""
        if isinstance(reply, Temperature):
            self.temperature = reply
        if isinstance(reply, Busy) or reply.waiting:
            self._busy(now)

    def _busy(self, now: float) -> None:
        """It lives and cannot answer yet: asking again would only fill its buffer."""
        if self.line is not None and self._sent:
            self._due = max(self._due, now + _AGAIN)

    def _on_named(self, wanted: int, now: float) -> None:
        if self.line is None:
            if wanted == self._named:
                self.line = wanted - 1
                self._due = now + _QUIET
            self._named = wanted
            return
        first = self.line + 1
        if wanted == first + self._asked + 1:
            self._answered(now)  # its answer was lost
        elif wanted == first + self._asked:
            self._due = now + _QUIET  # a repeated refusal from before, or the question was lost
        else:
            self._fail(f"it wants line {wanted}, after it wanted line {first + self._asked}")

    def _on_ok(self, ok: replies.Ok, now: float) -> None:
        if self.line is None:
            # Some may answer questions from before; a firmware that answers again and again does not count lines.
            self._answers += ok.heat
            if ok.heat:  # it answers: no need to wait long before the next question
                self._due = min(self._due, now + _QUIET)
            if self._answers >= _NO_REFUSAL and self._named is None:
                self._fail("its firmware does not count lines")
            return
        if (self._asked == 0 and ok.heat) or (self._asked == 1 and not ok.heat and self.position is not None):
            self._answered(now)

    def _answered(self, now: float) -> None:
        self._asked += 1
        self._sent = False
        self._due = now
        if self._asked >= len(_QUESTIONS):
            self.done = True

    def _fail(self, reason: str) -> None:
        self.reason = reason
        self.done = True
