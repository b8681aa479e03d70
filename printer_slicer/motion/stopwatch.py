"""Time of moves that come in pieces, however many there are: what `durations` gives for all of them at once.

What a move takes depends on what comes behind it, but not on everything: from where the machine could stop before the
last move it knows, all before is certain. Its time is added up and the moves are forgotten; the others wait.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from printer_slicer.motion.whole import Course, course_of

if TYPE_CHECKING:
    from printer_slicer.arrays import Bool, Float
    from printer_slicer.motion.blocks import MotionLimits

__all__ = ["RequestedMoves", "Stopwatch"]


@dataclass(frozen=True, slots=True, eq=False)
class RequestedMoves:
    """Moves as they were asked for: delta (K, 4) in mm, speed (K,), acceleration (K,), whether it stops after (K,)."""

    delta: Float
    speed: Float
    acceleration: Float
    stop: Bool

    def part(self, which: slice) -> RequestedMoves:
        """Some of them."""
        return RequestedMoves(
            self.delta[which], self.speed[which], self.acceleration[which], self.stop[which]
        )

    def then(self, others: RequestedMoves) -> RequestedMoves:
        """These and others behind them."""
        return RequestedMoves(
            np.concatenate([self.delta, others.delta]),
            np.concatenate([self.speed, others.speed]),
            np.concatenate([self.acceleration, others.acceleration]),
            np.concatenate([self.stop, others.stop]),
        )


class Stopwatch:
    """Adds up the time of moves on a machine that looks ahead without end.

    Args:
        limits: of the machine; may be replaced while it rests.
    """

    def __init__(self, limits: MotionLimits) -> None:
        self.limits = limits
        self._seconds = 0.0
        self._waiting: RequestedMoves | None = None
        self._entry = (0.0, 0.0)

    @property
    def waiting(self) -> int:
        """How many moves take a time that is not certain yet."""
        return len(self._waiting.speed) if self._waiting else 0

    def add(self, moves: RequestedMoves) -> None:
        """Some more moves."""
        moves = self._waiting.then(moves) if self._waiting else moves
        course = self._course(moves)
        known = course.certain()
        if known:
            self._seconds += float(course.times(slice(known)).sum())
            smooth = course.smoothed.squares[known] if course.smoothed else 0.0
            self._entry = float(course.squares[known]), float(smooth)
            moves = moves.part(np.s_[int(course.moving[known]) :])
        self._waiting = moves

    def rest(self) -> float:
        """Come to rest behind the last move; seconds of all moves so far."""
        if self._waiting:
            self._seconds += float(self._course(self._waiting).times(slice(None)).sum())
        self._waiting, self._entry = None, (0.0, 0.0)
        return self._seconds

    def _course(self, moves: RequestedMoves) -> Course:
        """What moves behind those whose time is known come to, if none came behind them."""
        return course_of(
            moves.delta,
            moves.speed,
            self.limits,
            stop_after=moves.stop,
            acceleration=moves.acceleration,
            entry=self._entry,
        )
