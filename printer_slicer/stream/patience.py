"""How long the answer to a line may take if nothing is wrong.

An `ok` for a move means "has a place in the planner". So the printer keeps the host waiting until the oldest
planned move ends: at most as long as the longest of the last moves takes. Other commands may wait until all
of them have ended. With the limits of the machine a move's time is that from rest to rest, which is longest;
without them it is twice the nominal time, and everything else is generous too.

Commands that heat, home, probe or wait for a person take their own time.
"""

from __future__ import annotations

from collections import deque
from math import hypot
from typing import TYPE_CHECKING, Final

from printer_slicer.gcode.commands import TABLE, Effect, commands_that
from printer_slicer.gcode.state import Move
from printer_slicer.motion.rules import make_block, ramp_time

if TYPE_CHECKING:
    from collections.abc import Mapping

    from printer_slicer.motion.rules import MotionLimits

__all__ = ["MARGIN", "Patience"]

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


class Patience:
    """Gives each new command, in order, the longest time until its ok, in s.

    The time counts from when the line before it is accepted.
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
