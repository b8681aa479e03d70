"""How long an answer may take if nothing is wrong, and when silence has lasted too long.

Three clues, from weak to strong: the patience for the line whose answer is due, less what the printer has never needed
of it where motion is short; what it has shown of its habit to say that it is busy; a sign that something was lost
(remains of an answer, `wait`). They only decide when to ask, never what happened: that is the printer's to say.
"""

from __future__ import annotations

from collections import deque
from math import hypot, inf, isfinite
from typing import TYPE_CHECKING, Final

from printer_slicer.gcode.commands import TABLE, Effect, commands_that
from printer_slicer.gcode.state import Move
from printer_slicer.motion.rules import make_block, ramp_time

if TYPE_CHECKING:
    from collections.abc import Mapping

    from printer_slicer.motion.rules import MotionLimits
    from printer_slicer.stream.send_history import NumberedLine

__all__ = ["MARGIN", "AckTimer", "ResponseTimeout"]

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


class AckTimer:
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


_PLANNER: Final = 64
"""Moves in the largest planner of any firmware; more only makes the wait longer."""

MARGIN: Final = 0.85
"""s for everything that is not motion, when the machine is known: a lost newline costs less than a second, and a board
that is busy with its display is not asked."""

_WIDE_MARGIN: Final = 30.0
"""s, when it is not: the acceleration and the true speeds hide in here."""

_AT_ONCE: Final = frozenset({b"M105", b"M115"})
_SOON: Final = 3.0
"""s for these: they only read, so they wait for nothing."""

_SLOWEST_Z: Final = 2.0
"""mm/s; firmware holds z back whatever the file asks for."""

_UNNAMED_SPEED: Final = 5.0
"""mm/s; below what any firmware takes before a file names a speed."""

_MACRO: Final = 1800.0
"""s for a macro, which may heat."""

_TOOL_CHANGE: Final = 600.0
"""s; another tool may be picked up, and heated."""

_EMPTIES_PLANNER: Final = commands_that(Effect.WAITS) - commands_that(Effect.WAITS_FOR_HEAT)
"""A wait for heat ends at once where all is hot, and then moves may still be planned."""


class ResponseTimeout:
    """Gives each new command, in order, the longest time until its ok, in s, from when the line before it is accepted.

    An `ok` for a move means "has a place in the planner". So the printer keeps the host waiting until the oldest
    planned move ends: at most as long as the longest of the last moves takes. Other commands may wait until all of
    them have ended. With the limits of the machine a move's time is that from rest to rest, which is longest; without
    them it is twice the nominal time, and everything else is generous too. Commands that heat, home, probe or wait for
    a person take their own time.
    """

    def __init__(self, limits: MotionLimits | None = None) -> None:
        self._limits = limits
        self._margin = _WIDE_MARGIN if limits is None else MARGIN
        self._slowdown = 1.0
        self._planned: deque[float] = deque(maxlen=_PLANNER)

    def allow(self, word: bytes, values: Mapping[bytes, float], move: Move | None) -> float:
        """Longest wait for the ok of a parsed command, s.

        Args:
            word: such as `G1`; empty: a macro, which may do anything.
            values: its values.
            move: what it moves, None if nothing.
        """
        if move is not None:
            if duration := self._duration(move) * self._slowdown:  # a move of no length is not planned
                self._planned.append(duration)
            # Twice: firmware that cuts a move into pieces waits for the one before and for its own pieces.
            return 2 * max(self._planned, default=0.0) + self._margin
        if word in _AT_ONCE:
            return _SOON
        if word == b"M220" and values.get(b"S", 0.0) > 0.0:
            self._slowdown = 100.0 / values[b"S"]
        longest = sum(self._planned) + self._margin
        if word in _EMPTIES_PLANNER:
            self._planned.clear()
        if word == b"G4":
            return longest + values.get(b"S", 0.0) + values.get(b"P", 0.0) / 1000.0
        return longest + _own_seconds(word)

    def _duration(self, move: Move) -> float:
        """Upper bound of the time of a move, s."""
        speed = move.speed or _UNNAMED_SPEED
        if self._limits is None:
            x, y, z, e = move.delta
            return 2 * max(max(hypot(x, y, z), abs(e)) / speed, abs(z) / _SLOWEST_Z)
        block = make_block(self._limits, move.delta, speed)
        return ramp_time(block.length, 0.0, block.speed, 0.0, block.acceleration) if block else 0.0


def _own_seconds(word: bytes) -> float:
    """Longest time that a command takes by itself, s. Longer is safe: it only delays the question, never the job."""
    if not word:
        return _MACRO
    row = TABLE.get(word)
    return row.seconds if row else _TOOL_CHANGE if word[:1] == b"T" else 0.0
