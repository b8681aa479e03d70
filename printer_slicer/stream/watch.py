"""When silence has lasted too long.

Three clues, from weak to strong: the patience for the line whose answer is due, less what the printer has never needed
of it where motion is short; what it has shown of its habit to say that it is busy; a sign that something was lost
(remains of an answer, `wait`). They only decide when to ask, never what happened: that is the printer's to say.
"""

from __future__ import annotations

from math import inf, isfinite
from typing import TYPE_CHECKING, Final

from printer_slicer.stream.patience import MARGIN

if TYPE_CHECKING:
    from printer_slicer.stream.ledger import NumberedLine

__all__ = ["Watch"]

_USUAL_KEEPALIVE: Final = 2.0
_LONGEST_KEEPALIVE: Final = 10.0
"""s between two reports of being busy."""

_MISSED: Final = 2.5
"""Intervals without a report after which a printer that reports is not busy."""

_NEXT_REPORT: Final = 1.25
"""Intervals after a report in which the next one, or the answer, comes."""

_HESITATE: Final = 0.3
"""s between a sign of loss and the question: the answer may still be on its way."""

_ON_ITS_WAY: Final = 0.5

_SHORT: Final = 2.0
"""Timeout, s, up to which motion counts as short: the planner soon runs empty, and the nozzle stops on the part."""

_EXPERIENCE: Final = 100
"""Acknowledgements of such lines after which the response time of the printer counts as known."""

_SLOWER: Final = 3.0
"""An acknowledgement counts as lost after this multiple of the slowest response time so far."""

_AT_LEAST: Final = 0.25
"""Minimum timeout beyond the motion, s: some printers redraw a display meanwhile."""

_ASK_AGAIN: Final = 1.0
_ASK_AGAIN_LONGEST: Final = 8.0
_MOST_QUESTIONS: Final = 6
"""The first one fits into the receive buffer behind the lines in flight; the others may not, if nothing was lost and
the printer has stopped reading, but then there is nobody to be told anything."""


class Watch:
    """The clock over the lines in flight.

    Attributes:
        asked: questions since the last answer.
    """

    def __init__(self, give_up: float) -> None:
        self.asked = 0
        self._give_up = give_up
        self._heard = -inf
        self._busy: float | None = None
        self._quiet = inf
        self._gap = 0.0
        self._hint = inf
        self._asked_first = inf
        self._asked_last = inf
        self._answers, self._slowest = 0, 0.0

    def learn(self, oldest: NumberedLine, now: float) -> None:
        """Record how much longer than its motion the acknowledgement of `oldest` took."""
        if self.asked or isfinite(self._hint) or oldest.patience > _SHORT:
            return
        waited = now - max(oldest.sent, self._heard)
        self._answers += 1
        self._slowest = max(self._slowest, waited - max(oldest.patience - MARGIN, 0.0) / 2)

    def answered(self, now: float, *, settled: bool = False) -> None:
        """An answer came; `settled` when no doubt is left about which lines arrived."""
        self._heard = now
        self._busy = None
        self.asked = 0
        if settled:
            self._hint = inf

    def busy(self, now: float) -> None:
        """The printer says that it is busy: it lives, and it is in the habit of saying so."""
        gap = now - self._busy if self._busy is not None else _USUAL_KEEPALIVE
        gap = min(max(gap, _USUAL_KEEPALIVE), _LONGEST_KEEPALIVE)
        # It may have been told to report less often: believe the longest gap.
        self._quiet = max(_MISSED * gap, self._quiet if isfinite(self._quiet) else 0.0)
        self.answered(now)
        self._busy = now
        self._gap = gap

    def idle(self, oldest: NumberedLine, now: float) -> None:
        """The printer says that it has nothing to do, while `oldest` waits for its answer."""
        # Said just before the line arrived it means nothing.
        if now - oldest.sent >= _ON_ITS_WAY:
            self.suspect(now)

    def suspect(self, now: float) -> None:
        """Something was lost: ask soon."""
        self._hint = min(self._hint, now + _HESITATE)

    def due(self, oldest: NumberedLine) -> float:
        """When to ask, or to ask again, while `oldest` waits for its answer, s; infinite for never."""
        if not self.asked:
            return min(self._overdue(oldest), self._hint)
        pause = min(_ASK_AGAIN * 2 ** (self.asked - 1), _ASK_AGAIN_LONGEST)
        again = self._asked_last + pause if self.asked < _MOST_QUESTIONS else inf
        return min(again, self._last_chance(oldest))

    def given_up(self, oldest: NumberedLine, now: float) -> bool:
        """Whether it has been asked long enough."""
        return self.asked > 0 and now >= self._last_chance(oldest)

    def _overdue(self, oldest: NumberedLine) -> float:
        """When the answer should have come."""
        # What has just said that it is busy says so again before it is worth asking.
        patience = self._patience(oldest)
        patience = patience if self._busy is None else max(patience, _NEXT_REPORT * self._gap)
        return max(oldest.sent, self._heard) + min(patience, self._quiet)

    def _patience(self, oldest: NumberedLine) -> float:
        """Return the timeout for the acknowledgement of `oldest`, s; for short motion from its response time."""
        if self._answers < _EXPERIENCE or not MARGIN <= oldest.patience <= _SHORT:
            return oldest.patience
        margin = min(max(_SLOWER * self._slowest, _AT_LEAST), MARGIN)
        return oldest.patience - MARGIN + margin

    def _last_chance(self, oldest: NumberedLine) -> float:
        """When questions have remained unanswered for too long. A busy printer may not read them at all."""
        return max(self._asked_first, self._overdue(oldest)) + self._give_up

    def ask(self, now: float) -> None:
        """A question goes out."""
        if not self.asked:
            self._asked_first = now
        self.asked += 1
        self._asked_last = now
        self._hint = inf
