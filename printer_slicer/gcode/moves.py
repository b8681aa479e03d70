"""What a file makes the machine do: its moves, and the time they take."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from printer_slicer.arrays import Bool, Float, Int
from printer_slicer.motion.rules import Axes, MotionLimits
from printer_slicer.motion.vectorized import RequestedMoves, Stopwatch

__all__ = ["Moves", "Timer", "accelerations", "changed_limits"]


@dataclass(frozen=True, slots=True, eq=False)
class Moves:
    """The moves of a file.

    Attributes:
        end: (K, 3) position at the end of each move, mm.
        delta: (K, 4) x, y, z, e of each move, mm.
        speed: (K,) as the file asks, mm/s.
        acceleration: (K,) as the file set it by then, mm/s²; nan where it did not.
        line: (K,) index of the command that made it.
        tool: (K,) number of the tool in use.
        stop: (K,) whether the machine stands still after it.
        dwell_seconds: asked for with G4.
        changes: changes of the machine's limits: (first move they hold for, kind, axis -> value).
        rested: whether the machine stands still before the first, where these are a piece of more.
    """

    end: Float
    delta: Float
    speed: Float
    acceleration: Float
    line: Int
    tool: Int
    stop: Bool
    dwell_seconds: float
    changes: tuple[tuple[int, str, Mapping[str, float]], ...] = ()
    rested: bool = False

    def seconds(self, limits: MotionLimits) -> float:
        """Time for all moves and dwells; homing and heating are not counted."""
        timer = Timer(limits)
        timer.add(self)
        return timer.seconds()

    def heights(self) -> list[float]:
        """z at which plastic is laid while moving in x or y, mm, in order of the first time."""
        lays = (self.delta[:, 3] > 0) & (self.delta[:, :2] != 0).any(axis=1)
        return list(dict.fromkeys(np.round(self.end[lays, 2], 4).tolist()))


class Timer:
    """Time of moves that come piece by piece, and of dwells; homing and heating are not counted.

    Args:
        limits: of the machine before the first piece.
    """

    def __init__(self, limits: MotionLimits) -> None:
        self._limits = limits
        self._watch = Stopwatch(limits)
        self._dwells = 0.0

    def add(self, moves: Moves) -> None:
        """The next piece. MotionLimits change rarely, and then the machine mostly stands: from rest to rest."""
        self._dwells += moves.dwell_seconds
        if moves.rested:
            self._watch.rest()
        begin = 0
        for first, kind, values in moves.changes:
            self._run(moves, begin, first)
            self._watch.rest()
            begin, self._limits = first, changed_limits(self._limits, kind, values)
            self._watch.limits = self._limits
        self._run(moves, begin, len(moves.speed))

    def seconds(self) -> float:
        """Of all pieces, the machine being at rest behind the last."""
        return self._dwells + self._watch.rest()

    def _run(self, moves: Moves, first: int, last: int) -> None:
        """Some of the moves, all within the same limits."""
        if last <= first:
            return
        some, limits = slice(first, last), self._limits
        delta = moves.delta[some]
        acceleration = accelerations(delta, moves.acceleration[some], limits)
        self._watch.add(RequestedMoves(delta, moves.speed[some], acceleration, moves.stop[some]))


def accelerations(delta: Float, wanted: Float, limits: MotionLimits) -> Float:
    """(K,) mm/s²: `wanted` (K,), and the machine's own where that is nan; delta (K, 4), mm."""
    travels = (delta[:, :3] != 0).any(axis=1)
    laying = np.where(travels, limits.acceleration, limits.retract_acceleration)
    usual = np.where(delta[:, 3] != 0, laying, limits.travel_acceleration)
    return np.asarray(np.where(np.isnan(wanted), usual, wanted))


def changed_limits(limits: MotionLimits, kind: str, values: Mapping[str, float]) -> MotionLimits:
    """The limits after M201, M203 or M205, a change of `Moves.changes`."""

    def merged(axes: Axes) -> Axes:
        """The limits of all axes, new ones for those that are named."""
        x, y, z, e = (values.get(letter, old) for letter, old in zip("XYZE", axes, strict=True))
        return x, y, z, e

    if kind == "M201":
        return replace(limits, max_acceleration=merged(limits.max_acceleration))
    if kind == "M203":
        return replace(limits, max_speed=merged(limits.max_speed))
    if kind == "M205":
        deviation = values.get("J", limits.junction_deviation)
        return replace(limits, jerk=merged(limits.jerk), junction_deviation=deviation)
    return limits
