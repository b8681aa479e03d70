"""One error on the wire, however many requests to send again it causes.

With k lines in flight behind the bad one, firmware with flow control refuses each of them too (1 + k
requests); firmware that empties its buffer asks once. So the streamer waits until all are there, or a moment
has passed without one, and goes back once. The number of a refused line is said twice, in the error and in
the request: only when both agree, or the same is said again, is a surprising number believed.

    request names a line          in flight, next   accepted   certainly accepted, never made
    alone                         go back           ask        ask
    error agrees, or said twice   go back           go back    the printer has lost count
    error disagrees               ask               ask        ask
"""

from __future__ import annotations

from enum import Enum
from math import inf
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from printer_slicer.stream.send_history import SendHistory

__all__ = ["ResendBurst", "ResendDecision"]

_SETTLE: Final = 0.2
"""s without another request after which none is expected: longer than the latency of any usual port."""

_LONGEST: Final = 2 * _SETTLE
"""s from the first request to going back: firmware that asks again and again must not be waited for until it stops."""

_MOST_IDENTICAL: Final = 10


class ResendDecision(Enum):
    """What to make of a request."""

    GO_BACK = "go back"
    ASK = "ask"
    LOST_COUNT = "lost count"


class ResendBurst:
    """The requests since the last good answer.

    Attributes:
        wanted: line to go back to, None while there is no error.
        until: when to go back at the latest, s.
        claim: line named by an error whose request has not come yet.
        swallow: whether the next ok belongs to a refusal.
    """

    def __init__(self) -> None:
        self.wanted: int | None = None
        self.claim: int | None = None
        self.until = inf
        self.swallow = False
        self._latest = inf
        self._doubted: int | None = None
        self._missing = 0
        self._last: int | None = None
        self._identical = 0

    def error(self, wanted: int, now: float) -> None:
        """An error names the wanted line; the request proper comes next, unless it gets lost."""
        first, self.claim = not self.active, wanted
        self._wait(now, first=first)

    def _wait(self, now: float, *, first: bool) -> None:
        """Wait a moment for more, but not for ever."""
        self._latest = now + _LONGEST if first else self._latest
        self.until = min(now + _SETTLE, self._latest)

    def unrequested(self, ledger: SendHistory, now: float) -> ResendDecision:
        """Take the claim for the request that should have followed it, with nothing to confirm it."""
        assert self.claim is not None
        number, self.claim = self.claim, None
        return self.request(number, ledger, now)

    def request(self, number: int, ledger: SendHistory, now: float) -> ResendDecision:
        """The printer asks for `number`; its ok is still to come."""
        first = not self.active
        claim, self.claim = self.claim, None
        self.swallow = True
        verdict = self._judge(number, claim, ledger)
        self._doubted = number if verdict is ResendDecision.ASK else None
        if verdict is ResendDecision.GO_BACK:
            if number != self.wanted:
                self.wanted = number
                self._missing = max(ledger.cursor - number, 1)
            self._missing -= 1
        self._wait(now, first=first)
        return verdict

    def _judge(self, number: int, claim: int | None, ledger: SendHistory) -> ResendDecision:
        if claim is not None and claim != number:
            return ResendDecision.ASK
        if ledger.accepted < number <= ledger.cursor:
            return ResendDecision.GO_BACK
        if claim is None and number != self._doubted:
            return ResendDecision.ASK
        return ResendDecision.GO_BACK if ledger.proven < number <= ledger.top else ResendDecision.LOST_COUNT

    @property
    def active(self) -> bool:
        """Whether there is an error to settle before anything else is sent."""
        return self.wanted is not None or self.claim is not None

    def calm(self, accepted: int) -> None:
        """Lines up to `accepted` were accepted after all: no doubt is left from before."""
        self._doubted = None
        if self.wanted is not None and self.wanted <= accepted:
            self._forget()

    def ready(self, now: float) -> bool:
        """Whether all requests of this error are there, or no more of them is expected."""
        complete = self.claim is None and self._missing <= 0 and not self.swallow
        return complete or now >= self.until

    def end(self) -> bool:
        """Forget the error, the streamer goes back now; False when it was told the same too often."""
        self._identical = self._identical + 1 if self.wanted == self._last else 1
        self._last = self.wanted
        self._forget()
        return self._identical < _MOST_IDENTICAL

    def _forget(self) -> None:
        self.wanted = None
        self.swallow = False
        self.until = self._latest = inf
        self._missing = 0
