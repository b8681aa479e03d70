"""The moves of a G-code file, and the time they take."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from printer_slicer.arrays import Bool, Float, Int
from printer_slicer.motion.durations import RequestedMoves, Stopwatch, compute_durations
from printer_slicer.motion.rules import Axes, MotionLimits
from printer_slicer.values import Struct, replace

__all__ = ["Moves", "Timer", "apply_limit_change", "choose_accelerations"]


class Moves(Struct, frozen=True, eq=False):
    """The moves of a file.

    Attributes:
        end: (K, 3) position at the end of each move, mm.
        delta: (K, 4) x, y, z, e of each move, mm.
        speed: (K,) requested speed, mm/s.
        acceleration: (K,) acceleration set by the file, mm/s²; nan if the file has not set one.
        line: (K,) index of the command of each move.
        tool: (K,) number of the active tool.
        stop: (K,) whether the machine stands still after the move.
        dwell_seconds: total time of G4.
        changes: changes of the machine's limits: (first move they apply to, kind, axis -> value).
        starts_at_rest: whether the machine stands still before the first move of this piece.
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
    starts_at_rest: bool = False

    def seconds(self, limits: MotionLimits) -> float:
        """Return the time of all moves and dwells, s, without homing and heating."""
        timer = Timer(limits)
        timer.add(self)
        return timer.seconds()

    def durations(self, limits: MotionLimits) -> Float:
        """Return the time of each move (K,), s, without dwells, homing and heating.

        Args:
            limits: limits of the machine before the first move; the machine rests where the file changes them.
        """
        seconds, begin = np.zeros(len(self.speed)), 0
        for first, kind, values in (*self.changes, (len(self.speed), "", {})):
            some = slice(begin, first)
            delta, stop = self.delta[some], self.stop[some]
            acceleration = choose_accelerations(delta, self.acceleration[some], limits)
            seconds[some] = compute_durations(
                delta, self.speed[some], limits, stop_after=stop, acceleration=acceleration
            )
            begin, limits = first, apply_limit_change(limits, kind, values)
        return seconds

    def heights(self) -> list[float]:
        """Return the z values of extrusions that move in x or y, mm, in order of first use."""
        lays = (self.delta[:, 3] > 0) & (self.delta[:, :2] != 0).any(axis=1)
        return list(dict.fromkeys(np.round(self.end[lays, 2], 4).tolist()))


class Timer:
    """Adds up the time of moves given in pieces, including dwells but not homing and heating.

    Args:
        limits: limits of the machine before the first piece.
    """

    def __init__(self, limits: MotionLimits) -> None:
        self._limits = limits
        self._watch = Stopwatch(limits)
        self._dwells = 0.0

    def add(self, moves: Moves) -> None:
        """Add the next piece; where limits change, the machine is assumed to stand still."""
        self._dwells += moves.dwell_seconds
        if moves.starts_at_rest:
            self._watch.stop_and_sum()
        begin = 0
        for first, kind, values in moves.changes:
            self._add_range(moves, begin, first)
            self._watch.stop_and_sum()
            begin, self._limits = first, apply_limit_change(self._limits, kind, values)
            self._watch.limits = self._limits
        self._add_range(moves, begin, len(moves.speed))

    def seconds(self) -> float:
        """Return the time of all pieces, s; the machine comes to rest after the last one."""
        return self._dwells + self._watch.stop_and_sum()

    def _add_range(self, moves: Moves, first: int, last: int) -> None:
        """Add moves that share the same limits."""
        if last <= first:
            return
        some, limits = slice(first, last), self._limits
        delta = moves.delta[some]
        acceleration = choose_accelerations(delta, moves.acceleration[some], limits)
        self._watch.add(RequestedMoves(delta, moves.speed[some], acceleration, moves.stop[some]))


def choose_accelerations(delta: Float, wanted: Float, limits: MotionLimits) -> Float:
    """Return the acceleration of each move (K,), mm/s²: `wanted` (K,), or the machine's where `wanted` is nan.

    Args:
        delta: (K, 4) x, y, z, e of each move, mm.
        wanted: (K,) accelerations that the file sets, mm/s².
        limits: limits of the machine.
    """
    travels = (delta[:, :3] != 0).any(axis=1)
    laying = np.where(travels, limits.acceleration, limits.retract_acceleration)
    usual = np.where(delta[:, 3] != 0, laying, limits.travel_acceleration)
    return np.asarray(np.where(np.isnan(wanted), usual, wanted))


def apply_limit_change(limits: MotionLimits, kind: str, values: Mapping[str, float]) -> MotionLimits:
    """Return the limits after M201, M203 or M205; `kind` and `values` are from an entry of `Moves.changes`."""

    def merge_axes(axes: Axes) -> Axes:
        """Return the limits of all axes, with new values for the named ones."""
        x, y, z, e = (values.get(letter, old) for letter, old in zip("XYZE", axes, strict=True))
        return x, y, z, e

    if kind == "M201":
        return replace(limits, max_acceleration=merge_axes(limits.max_acceleration))
    if kind == "M203":
        return replace(limits, max_speed=merge_axes(limits.max_speed))
    if kind == "M205":
        deviation = values.get("J", limits.junction_deviation)
        return replace(limits, jerk=merge_axes(limits.jerk), junction_deviation=deviation)
    return limits
