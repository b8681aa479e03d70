"""Time out missing acknowledgements: when to probe a silent printer, and when to give up on it.

Three clues count, from weak to strong: the response timeout of the oldest line in flight, shortened for short moves by
measured response times; the interval at which the printer reports that it is busy; and signs of a loss, such as a
damaged answer or `wait`. They only decide when to probe. The answer to the probe decides what was lost.
"""

from __future__ import annotations

from collections import deque
from math import hypot, inf, isfinite
from typing import TYPE_CHECKING, Final

from printer_slicer.gcode.commands import TABLE, Effect, find_codes
from printer_slicer.gcode.state import Move
from printer_slicer.motion.rules import compute_ramp_time, make_block

if TYPE_CHECKING:
    from collections.abc import Mapping

    from printer_slicer.motion.rules import MotionLimits
    from printer_slicer.stream.send_history import NumberedLine

__all__ = ["MARGIN", "AckTimer", "ResponseTimeout"]

_DEFAULT_KEEPALIVE: Final = 2.0
_MAX_KEEPALIVE: Final = 10.0
"""Expected and maximum interval between two busy reports, s."""

_MISSED_REPORTS: Final = 2.5
"""Number of missed report intervals after which the printer no longer counts as busy."""

_NEXT_REPORT_INTERVALS: Final = 1.25
"""Number of report intervals within which the next report or the answer arrives."""

_PROBE_DELAY: Final = 0.3
"""Delay between a sign of loss and the probe, s: the answer may still arrive."""

_TRANSIT_TIME: Final = 0.5
"""Time after sending a line within which an idle report may have been sent before the line arrived, s."""

_SHORT_TIMEOUT: Final = 2.0
"""Longest timeout of a short motion, s. The planner then soon runs empty, and the nozzle stops on the part."""

_MIN_MEASUREMENTS: Final = 100
"""Number of acknowledged lines with short motion after which the response time of the printer counts as known."""

_SLOWEST_MULTIPLE: Final = 3.0
"""Multiple of the slowest response time so far after which an acknowledgement counts as lost."""

_MIN_MARGIN: Final = 0.25
"""Minimum timeout in addition to the motion, s: some printers redraw a display before they answer."""

_PROBE_INTERVAL: Final = 1.0
_MAX_PROBE_INTERVAL: Final = 8.0
"""Interval between the first two probes and maximum interval, s; it doubles each time."""

_MAX_PROBES: Final = 6
"""Maximum number of probes. The first fits into the receive buffer behind the lines in flight. Further probes may not
fit if the printer has stopped reading, but then it does not answer anyway."""


class AckTimer:
    """Timer for the acknowledgement of the oldest line in flight.

    Args:
        give_up: s until a printer that answers no probe counts as unresponsive.

    Attributes:
        probes: number of probes since the last answer.
    """

    def __init__(self, give_up: float) -> None:
        self.probes = 0
        self._give_up_seconds = give_up
        self._last_answer_at = -inf
        self._last_busy_at: float | None = None
        self._busy_timeout = inf
        self._busy_interval = 0.0
        self._loss_probe_at = inf
        self._first_probe_at = inf
        self._last_probe_at = inf
        self._n_measurements, self._slowest_response = 0, 0.0

    def learn_response_time(self, oldest: NumberedLine, now: float) -> None:
        """Learn how fast the printer answers from the ok of `oldest` at `now`; motion does not count."""
        if self.probes or isfinite(self._loss_probe_at) or oldest.timeout > _SHORT_TIMEOUT:
            return
        waited = now - max(oldest.sent, self._last_answer_at)
        self._n_measurements += 1
        self._slowest_response = max(self._slowest_response, waited - max(oldest.timeout - MARGIN, 0.0) / 2)

    def on_answer(self, now: float, *, is_conclusive: bool = False) -> None:
        """Restart the timeout, because the printer has answered.

        Args:
            now: time, s.
            is_conclusive: whether the answer shows reliably which lines arrived.
        """
        self._last_answer_at = now
        self._last_busy_at = None
        self.probes = 0
        if is_conclusive:
            self._loss_probe_at = inf

    def on_busy(self, now: float) -> None:
        """Restart the timeout at a busy report, and learn the interval between busy reports."""
        interval = now - self._last_busy_at if self._last_busy_at is not None else _DEFAULT_KEEPALIVE
        interval = min(max(interval, _DEFAULT_KEEPALIVE), _MAX_KEEPALIVE)
        # The report interval may have been changed: use the longest one.
        self._busy_timeout = max(
            _MISSED_REPORTS * interval, self._busy_timeout if isfinite(self._busy_timeout) else 0.0
        )
        self.on_answer(now)
        self._last_busy_at = now
        self._busy_interval = interval

    def on_idle(self, oldest: NumberedLine, now: float) -> None:
        """Schedule a probe, because the printer reports that it is idle without acknowledging `oldest`."""
        # A report sent just before the line arrived means nothing.
        if now - oldest.sent >= _TRANSIT_TIME:
            self.schedule_probe(now)

    def schedule_probe(self, now: float) -> None:
        """Schedule a probe soon, because a line or its answer was probably lost."""
        self._loss_probe_at = min(self._loss_probe_at, now + _PROBE_DELAY)

    def next_probe_at(self, oldest: NumberedLine) -> float:
        """Return when to send the next probe if `oldest` stays unacknowledged, s; infinite for never."""
        if not self.probes:
            return min(self._find_overdue_time(oldest), self._loss_probe_at)
        pause = min(_PROBE_INTERVAL * 2 ** (self.probes - 1), _MAX_PROBE_INTERVAL)
        again = self._last_probe_at + pause if self.probes < _MAX_PROBES else inf
        return min(again, self._find_give_up_time(oldest))

    def is_unresponsive(self, oldest: NumberedLine, now: float) -> bool:
        """Return whether the printer has answered no probe for too long."""
        return self.probes > 0 and now >= self._find_give_up_time(oldest)

    def _find_overdue_time(self, oldest: NumberedLine) -> float:
        """Return when the acknowledgement of `oldest` becomes overdue, s."""
        # A busy printer reports again before a probe makes sense.
        timeout = self._compute_timeout(oldest)
        timeout = (
            timeout
            if self._last_busy_at is None
            else max(timeout, _NEXT_REPORT_INTERVALS * self._busy_interval)
        )
        return max(oldest.sent, self._last_answer_at) + min(timeout, self._busy_timeout)

    def _compute_timeout(self, oldest: NumberedLine) -> float:
        """Return how long the acknowledgement of `oldest` may take, s.

        For short motion, this time follows from the measured response time.
        """
        if self._n_measurements < _MIN_MEASUREMENTS or not MARGIN <= oldest.timeout <= _SHORT_TIMEOUT:
            return oldest.timeout
        margin = min(max(_SLOWEST_MULTIPLE * self._slowest_response, _MIN_MARGIN), MARGIN)
        return oldest.timeout - MARGIN + margin

    def _find_give_up_time(self, oldest: NumberedLine) -> float:
        """Return when the printer counts as unresponsive, s; later if it is too busy to read the probes."""
        return max(self._first_probe_at, self._find_overdue_time(oldest)) + self._give_up_seconds

    def on_probe(self, now: float) -> None:
        """Record that a probe is sent at `now`, s."""
        if not self.probes:
            self._first_probe_at = now
        self.probes += 1
        self._last_probe_at = now
        self._loss_probe_at = inf


_PLANNER_MOVES: Final = 64
"""Number of moves in the largest planner of any firmware; a larger value only prolongs the timeout."""

MARGIN: Final = 0.85
"""Timeout for everything except motion, s, if the motion limits are known.

It is short, so that a lost newline costs less than a second, but long enough for a board that redraws its display."""

_WIDE_MARGIN: Final = 30.0
"""Timeout for everything except motion, s, if the motion limits are unknown. It covers acceleration, too."""

_IMMEDIATE: Final = frozenset({b"M105", b"M115"})
_IMMEDIATE_TIMEOUT: Final = 3.0
"""Timeout of the commands in `_IMMEDIATE`, s: they only report values, so they wait for nothing."""

_LOWEST_Z_SPEED: Final = 2.0
"""Assumed speed of z, mm/s: firmware limits it, whatever speed the file requests."""

_LOWEST_INITIAL_SPEED: Final = 5.0
"""Assumed speed before the first feed rate, mm/s: lower than the initial speed of any firmware."""

_MACRO_TIME: Final = 1800.0
"""Timeout of a macro, s; a macro may heat the printer."""

_TOOL_CHANGE_TIME: Final = 600.0
"""Timeout of a tool change, s; the printer may move and heat the tool."""

_EMPTIES_PLANNER: Final = find_codes(Effect.WAITS) - find_codes(Effect.WAITS_FOR_HEAT)
"""Commands that wait until the planner is empty. A wait for heaters may return while moves are still planned."""


class ResponseTimeout:
    """Computes how long each new command may take, s, from the ok of the previous line to its own ok.

    An `ok` for a move means that it has a place in the planner. So the printer delays it until the oldest planned move
    ends, which takes at most as long as the longest recent move. Other commands may wait until all moves have ended.
    With the limits of the machine, the time of a move is the time from rest to rest, an upper bound. Without them it is
    twice the nominal time, and all margins are wide. Commands that heat, home, probe or wait for a user have separate
    timeouts.

    Args:
        limits: motion limits of the machine, None if unknown.
    """

    def __init__(self, limits: MotionLimits | None = None) -> None:
        self._limits = limits
        self._margin = _WIDE_MARGIN if limits is None else MARGIN
        self._slowdown = 1.0
        self._planned: deque[float] = deque(maxlen=_PLANNER_MOVES)

    def estimate_timeout(self, word: bytes, values: Mapping[bytes, float], move: Move | None) -> float:
        """Return how long the ok of a parsed command may take, s, and remember the command.

        Args:
            word: command word such as `G1`; empty: a macro, which may do anything.
            values: its parameters.
            move: its move, None if it moves nothing.
        """
        if move is not None:
            if (
                duration := self._find_max_duration(move) * self._slowdown
            ):  # a move of zero length is not planned
                self._planned.append(duration)
            # Twice, because firmware that splits a move waits for the previous move and for its own pieces.
            return 2 * max(self._planned, default=0.0) + self._margin
        if word in _IMMEDIATE:
            return _IMMEDIATE_TIMEOUT
        if word == b"M220" and values.get(b"S", 0.0) > 0.0:
            self._slowdown = 100.0 / values[b"S"]
        longest = sum(self._planned) + self._margin
        if word in _EMPTIES_PLANNER:
            self._planned.clear()
        if word == b"G4":
            return longest + values.get(b"S", 0.0) + values.get(b"P", 0.0) / 1000.0
        return longest + _find_max_execution_time(word)

    def _find_max_duration(self, move: Move) -> float:
        """Return the longest time that a move may take, s."""
        speed = move.speed or _LOWEST_INITIAL_SPEED
        if self._limits is None:
            x, y, z, e = move.delta
            return 2 * max(max(hypot(x, y, z), abs(e)) / speed, abs(z) / _LOWEST_Z_SPEED)
        block = make_block(self._limits, move.delta, speed)
        return compute_ramp_time(block.length, 0.0, block.speed, 0.0, block.acceleration) if block else 0.0


def _find_max_execution_time(word: bytes) -> float:
    """Return the longest time that a command may take, s. A larger value only delays probes, not the job."""
    if not word:
        return _MACRO_TIME
    row = TABLE.get(word)
    return row.seconds if row else _TOOL_CHANGE_TIME if word[:1] == b"T" else 0.0
