"""Handle all resend requests that belong to one transmission error.

If k lines are in flight behind the damaged line, firmware with flow control rejects each of them too and sends 1 + k
requests. Firmware that empties its buffer sends one request. So the streamer waits for all requests, or until none has
arrived for a moment, and then goes back once. The number of the expected line arrives twice, in the error and in
the request. An unexpected number counts only if both agree, or if it is repeated.

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

_QUIET_TIME: Final = 0.2
"""Time without another request after which none is expected, s; longer than the latency of common ports."""

_MAX_WAIT: Final = 2 * _QUIET_TIME
"""Maximum time from the first request until going back, s, because some firmware repeats its request endlessly."""

_MAX_IDENTICAL: Final = 10


class ResendDecision(Enum):
    """Decision about a resend request."""

    GO_BACK = "go back"
    PROBE = "probe"
    LOST_COUNT = "lost count"


class ResendBurst:
    """Resend requests that belong to the current transmission error.

    Attributes:
        requested_line: line to go back to, None if there is no error.
        deadline: time at which to go back at the latest, s.
        claimed_line: line named by an error whose resend request has not arrived yet.
        ignore_next_ok: whether the next ok belongs to a rejected line.
    """

    def __init__(self) -> None:
        self.requested_line: int | None = None
        self.claimed_line: int | None = None
        self.deadline = inf
        self.ignore_next_ok = False
        self._latest_deadline = inf
        self._unconfirmed: int | None = None
        self._n_missing = 0
        self._last_finished: int | None = None
        self._n_identical = 0

    def on_error(self, expected_line: int, now: float) -> None:
        """Handle an error report that names the expected line; a resend request should follow."""
        first, self.claimed_line = not self.is_active, expected_line
        self._extend_deadline(now, first=first)

    def _extend_deadline(self, now: float, *, first: bool) -> None:
        """Wait longer for further resend requests, up to a limit that counts from the first request."""
        self._latest_deadline = now + _MAX_WAIT if first else self._latest_deadline
        self.deadline = min(now + _QUIET_TIME, self._latest_deadline)

    def use_claimed_line(self, history: SendHistory, now: float) -> ResendDecision:
        """Treat the line that the error report named as requested: the resend request itself was lost."""
        assert self.claimed_line is not None
        number, self.claimed_line = self.claimed_line, None
        return self.on_request(number, history, now)

    def on_request(self, number: int, history: SendHistory, now: float) -> ResendDecision:
        """Handle a resend request for line `number`; the printer sends an ok after the request."""
        first = not self.is_active
        claimed_line, self.claimed_line = self.claimed_line, None
        self.ignore_next_ok = True
        decision = self._choose_decision(number, claimed_line, history)
        self._unconfirmed = number if decision is ResendDecision.PROBE else None
        if decision is ResendDecision.GO_BACK:
            if number != self.requested_line:
                self.requested_line = number
                self._n_missing = max(history.cursor - number, 1)
            self._n_missing -= 1
        self._extend_deadline(now, first=first)
        return decision

    def _choose_decision(self, number: int, claimed_line: int | None, history: SendHistory) -> ResendDecision:
        """Return what to do about a resend request for line `number`, by the table of this module."""
        if claimed_line is not None and claimed_line != number:
            return ResendDecision.PROBE
        if history.accepted < number <= history.cursor:
            return ResendDecision.GO_BACK
        if claimed_line is None and number != self._unconfirmed:
            return ResendDecision.PROBE
        return (
            ResendDecision.GO_BACK
            if history.proven < number <= history.next_number
            else ResendDecision.LOST_COUNT
        )

    @property
    def is_active(self) -> bool:
        """Return whether a transmission error must be handled before anything else is sent."""
        return self.requested_line is not None or self.claimed_line is not None

    def on_accepted(self, accepted: int) -> None:
        """Drop requests for lines up to `accepted`, because the printer has accepted these lines."""
        self._unconfirmed = None
        if self.requested_line is not None and self.requested_line <= accepted:
            self._reset()

    def is_settled(self, now: float) -> bool:
        """Return whether all resend requests of this error have arrived, or the deadline has passed."""
        complete = self.claimed_line is None and self._n_missing <= 0 and not self.ignore_next_ok
        return complete or now >= self.deadline

    def finish(self) -> bool:
        """Forget the error before the streamer goes back; return False after too many identical requests."""
        self._n_identical = self._n_identical + 1 if self.requested_line == self._last_finished else 1
        self._last_finished = self.requested_line
        self._reset()
        return self._n_identical < _MAX_IDENTICAL

    def _reset(self) -> None:
        """Forget the current transmission error."""
        self.requested_line = None
        self.ignore_next_ok = False
        self.deadline = self._latest_deadline = inf
        self._n_missing = 0
