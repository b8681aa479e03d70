"""Timeouts of acknowledgements: when to probe a silent printer, and when to give up.

Three clues count, from weak to strong: the response timeout of the oldest line in flight, shortened for short moves by
measured response times; how regularly the printer reports that it is busy; and signs of a loss, such as the remains of
an answer or `wait`. They only decide when to probe. The answer to the probe decides what was lost.
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
"""s between two busy reports."""

_MISSED: Final = 2.5
"""Number of missed report intervals after which the printer no longer counts as busy."""

_NEXT_REPORT: Final = 1.25
"""Number of intervals after a report in which the next report or the answer arrives."""

_HESITATE: Final = 0.3
"""s between a sign of loss and the probe: the answer may still arrive."""

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
"""Maximum number of probes. The first fits into the receive buffer behind the lines in flight. Further ones may not if
the printer has stopped reading, but then it does not answer anyway."""


class AckTimer:
    """Timer for the acknowledgement of the oldest line in flight.

    Args:
        give_up: s until a printer that answers no probe counts as unresponsive.

    Attributes:
        probes: number of probes since the last answer.
    """

    def __init__(self, give_up: float) -> None:
        self.probes = 0
        self._give_up = give_up
        self._heard = -inf
        self._busy: float | None = None
        self._quiet = inf
        self._gap = 0.0
        self._hint = inf
        self._asked_first = inf
        self._asked_last = inf
        self._answers, self._slowest = 0, 0.0

    def learn_response_time(self, oldest: NumberedLine, now: float) -> None:
        """Record how much longer than its motion the acknowledgement of `oldest` took."""
        if self.probes or isfinite(self._hint) or oldest.timeout > _SHORT:
            return
        waited = now - max(oldest.sent, self._heard)
        self._answers += 1
        self._slowest = max(self._slowest, waited - max(oldest.timeout - MARGIN, 0.0) / 2)

    def on_answer(self, now: float, *, settled: bool = False) -> None:
        """Handle an answer; `settled`: it shows reliably which lines arrived."""
        self._heard = now
        self._busy = None
        self.probes = 0
        if settled:
            self._hint = inf

    def on_busy(self, now: float) -> None:
        """Handle a busy report, and learn the interval of such reports."""
        gap = now - self._busy if self._busy is not None else _USUAL_KEEPALIVE
        gap = min(max(gap, _USUAL_KEEPALIVE), _LONGEST_KEEPALIVE)
        # The report interval may have been changed: use the longest one.
        self._quiet = max(_MISSED * gap, self._quiet if isfinite(self._quiet) else 0.0)
        self.on_answer(now)
        self._busy = now
        self._gap = gap

    def on_idle(self, oldest: NumberedLine, now: float) -> None:
        """Handle an idle report while `oldest` waits for its acknowledgement."""
        # A report sent just before the line arrived means nothing.
        if now - oldest.sent >= _ON_ITS_WAY:
            self.expect_loss(now)

    def expect_loss(self, now: float) -> None:
        """Probe soon, because something was lost."""
        self._hint = min(self._hint, now + _HESITATE)

    def due(self, oldest: NumberedLine) -> float:
        """Return when to probe, or to probe again, while `oldest` is unacknowledged, s; infinite for never."""
        if not self.probes:
            return min(self._overdue(oldest), self._hint)
        pause = min(_ASK_AGAIN * 2 ** (self.probes - 1), _ASK_AGAIN_LONGEST)
        again = self._asked_last + pause if self.probes < _MOST_QUESTIONS else inf
        return min(again, self._last_chance(oldest))

    def has_given_up(self, oldest: NumberedLine, now: float) -> bool:
        """Return whether the printer has been unresponsive for too long."""
        return self.probes > 0 and now >= self._last_chance(oldest)

    def _overdue(self, oldest: NumberedLine) -> float:
        """Return when the acknowledgement is overdue, s."""
        # A busy printer reports again before a probe makes sense.
        timeout = self._timeout(oldest)
        timeout = timeout if self._busy is None else max(timeout, _NEXT_REPORT * self._gap)
        return max(oldest.sent, self._heard) + min(timeout, self._quiet)

    def _timeout(self, oldest: NumberedLine) -> float:
        """Return the timeout for the acknowledgement of `oldest`, s; for short motion from its response time."""
        if self._answers < _EXPERIENCE or not MARGIN <= oldest.timeout <= _SHORT:
            return oldest.timeout
        margin = min(max(_SLOWER * self._slowest, _AT_LEAST), MARGIN)
        return oldest.timeout - MARGIN + margin

    def _last_chance(self, oldest: NumberedLine) -> float:
        """Return when to give up, s. A busy printer may not read the probes at all."""
        return max(self._asked_first, self._overdue(oldest)) + self._give_up

    def on_probe(self, now: float) -> None:
        """Record that a probe is sent."""
        if not self.probes:
            self._asked_first = now
        self.probes += 1
        self._asked_last = now
        self._hint = inf


_PLANNER: Final = 64
"""Number of moves in the largest planner of any firmware; a larger value only prolongs the timeout."""

MARGIN: Final = 0.85
"""s for everything except motion, if the machine is known. A lost newline costs less than a second, and a board that
redraws its display is not probed."""

_WIDE_MARGIN: Final = 30.0
"""The same, s, if the machine is unknown: it covers acceleration and actual speeds."""

_AT_ONCE: Final = frozenset({b"M105", b"M115"})
_SOON: Final = 3.0
"""s for these: they only read, so they wait for nothing."""

_SLOWEST_Z: Final = 2.0
"""mm/s; firmware holds z back whatever the file asks for."""

_UNNAMED_SPEED: Final = 5.0
"""mm/s; lower than the initial speed of any firmware."""

_MACRO: Final = 1800.0
"""s for a macro, which may heat."""

_TOOL_CHANGE: Final = 600.0
"""s; the printer may change and heat a tool."""

_EMPTIES_PLANNER: Final = commands_that(Effect.WAITS) - commands_that(Effect.WAITS_FOR_HEAT)
"""Commands that wait until the planner is empty. A wait for heaters may return while moves are still planned."""


class ResponseTimeout:
    """Computes the maximum time, s, from the acceptance of the previous line to the ok of each new command.

    An `ok` for a move means that it has a place in the planner. So the printer delays it until the oldest planned move
    ends, which takes at most as long as the longest recent move. Other commands may wait until all moves have ended.
    With the limits of the machine, the time of a move is the time from rest to rest, an upper bound. Without them it is
    twice the nominal time, and all margins are wide. Commands that heat, home, probe or wait for a user have times of
    their own.

    Args:
        limits: motion limits of the machine, None if unknown.
    """

    def __init__(self, limits: MotionLimits | None = None) -> None:
        self._limits = limits
        self._margin = _WIDE_MARGIN if limits is None else MARGIN
        self._slowdown = 1.0
        self._planned: deque[float] = deque(maxlen=_PLANNER)

    def estimate(self, word: bytes, values: Mapping[bytes, float], move: Move | None) -> float:
        """Return the timeout of a parsed command, s.

        Args:
            word: command word such as `G1`; empty: a macro, which may do anything.
            values: its parameters.
            move: its move, None if it moves nothing.
        """
        if move is not None:
            if duration := self._duration(move) * self._slowdown:  # a move of zero length is not planned
                self._planned.append(duration)
            # Twice, because firmware that splits a move waits for the previous move and for its own pieces.
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
        """Return an upper bound of the time of a move, s."""
        speed = move.speed or _UNNAMED_SPEED
        if self._limits is None:
            x, y, z, e = move.delta
            return 2 * max(max(hypot(x, y, z), abs(e)) / speed, abs(z) / _SLOWEST_Z)
        block = make_block(self._limits, move.delta, speed)
        return ramp_time(block.length, 0.0, block.speed, 0.0, block.acceleration) if block else 0.0


def _own_seconds(word: bytes) -> float:
    """Return the maximum execution time of a command, s. A larger value only delays a probe, never the job."""
    if not word:
        return _MACRO
    row = TABLE.get(word)
    return row.seconds if row else _TOOL_CHANGE if word[:1] == b"T" else 0.0
