"""Handle all resend requests of one transmission error as one.

If k lines are in flight behind the damaged line, firmware with flow control rejects each of them too and sends 1 + k
requests. Firmware that empties its buffer sends one request. So the streamer waits for all requests, or until none has
arrived for a moment, and then goes back once. The number of a rejected line arrives twice, in the error and in the
request. An unexpected number is believed only if both agree, or if it is repeated.

    requested line                in flight, next   accepted   certainly accepted, not yet sent
    request alone                 go back           probe      probe
    error agrees, or repeated     go back           go back    the printer has lost count
    error disagrees               probe             probe      probe
"""

from __future__ import annotations

from enum import Enum
from math import inf
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from printer_slicer.stream.send_history import SendHistory

__all__ = ["ResendBurst", "ResendDecision"]

_SETTLE: Final = 0.2
"""s without another request after which none is expected; longer than the latency of common ports."""

_LONGEST: Final = 2 * _SETTLE
"""Maximum time, s, from the first request to going back, because some firmware repeats its request endlessly."""

_MOST_IDENTICAL: Final = 10


class ResendDecision(Enum):
    """How to handle a resend request."""

    GO_BACK = "go back"
    PROBE = "probe"
    LOST_COUNT = "lost count"


class ResendBurst:
    """Resend requests since the last good acknowledgement.

    Attributes:
        wanted: line to go back to, None if there is no error.
        until: time at which to go back at the latest, s.
        claimed_line: line named by an error whose resend request has not arrived yet.
        ignore_next_ok: whether the next ok belongs to a rejected line.
    """

    def __init__(self) -> None:
        self.wanted: int | None = None
        self.claimed_line: int | None = None
        self.until = inf
        self.ignore_next_ok = False
        self._latest = inf
        self._unconfirmed: int | None = None
        self._missing = 0
        self._last: int | None = None
        self._identical = 0

    def on_error(self, wanted: int, now: float) -> None:
        """Handle an error that names the wanted line; its resend request follows unless it is lost."""
        first, self.claimed_line = not self.is_active, wanted
        self._wait(now, first=first)

    def _wait(self, now: float, *, first: bool) -> None:
        """Wait for more requests, up to a limit."""
        self._latest = now + _LONGEST if first else self._latest
        self.until = min(now + _SETTLE, self._latest)

    def use_claimed_line(self, history: SendHistory, now: float) -> ResendDecision:
        """Treat the line named by the error as requested, because the request itself did not arrive."""
        assert self.claimed_line is not None
        number, self.claimed_line = self.claimed_line, None
        return self.on_request(number, history, now)

    def on_request(self, number: int, history: SendHistory, now: float) -> ResendDecision:
        """Handle a resend request for `number`; its ok is still to come."""
        first = not self.is_active
        claimed_line, self.claimed_line = self.claimed_line, None
        self.ignore_next_ok = True
        decision = self._choose_answer(number, claimed_line, history)
        self._unconfirmed = number if decision is ResendDecision.PROBE else None
        if decision is ResendDecision.GO_BACK:
            if number != self.wanted:
                self.wanted = number
                self._missing = max(history.cursor - number, 1)
            self._missing -= 1
        self._wait(now, first=first)
        return decision

    def _choose_answer(self, number: int, claimed_line: int | None, history: SendHistory) -> ResendDecision:
        if claimed_line is not None and claimed_line != number:
            return ResendDecision.PROBE
        if history.accepted < number <= history.cursor:
            return ResendDecision.GO_BACK
        if claimed_line is None and number != self._unconfirmed:
            return ResendDecision.PROBE
        return ResendDecision.GO_BACK if history.proven < number <= history.top else ResendDecision.LOST_COUNT

    @property
    def is_active(self) -> bool:
        """Return whether an error must be handled before anything else is sent."""
        return self.wanted is not None or self.claimed_line is not None

    def on_accepted(self, accepted: int) -> None:
        """Drop requests for lines up to `accepted`, which were accepted after all."""
        self._unconfirmed = None
        if self.wanted is not None and self.wanted <= accepted:
            self._forget()

    def is_settled(self, now: float) -> bool:
        """Return whether all requests of this error have arrived or no more are expected."""
        complete = self.claimed_line is None and self._missing <= 0 and not self.ignore_next_ok
        return complete or now >= self.until

    def finish(self) -> bool:
        """Close the error before going back; return False after too many identical requests."""
        self._identical = self._identical + 1 if self.wanted == self._last else 1
        self._last = self.wanted
        self._forget()
        return self._identical < _MOST_IDENTICAL

    def _forget(self) -> None:
        self.wanted = None
        self.ignore_next_ok = False
        self.until = self._latest = inf
        self._missing = 0
