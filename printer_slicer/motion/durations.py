"""Compute the times of moves in batches, which bounds the memory for long programs.

Letters in shapes: K moves.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING

import numpy as np

from printer_slicer.arrays import Bool, Float
from printer_slicer.motion.vectorized import SpeedProfile, plan_speeds
from printer_slicer.values import Struct

if TYPE_CHECKING:
    from printer_slicer.motion.blocks import MotionLimits

__all__ = [
    "MOVES_PER_BATCH",
    "RequestedMoves",
    "Stopwatch",
    "compute_durations",
    "compute_durations_of_batches",
]

MOVES_PER_BATCH = 1 << 16
"""Moves of a long program whose speeds are planned together; it bounds the memory."""


class RequestedMoves(Struct, frozen=True, eq=False):
    """Requested moves, as the arguments of `compute_durations`.

    Attributes:
        delta: (K, 4) mm.
        speed: (K,) mm/s.
        acceleration: (K,) mm/s², or None.
        stop: (K,) whether the machine stops after the move, or None if it never does.
    """

    delta: Float
    speed: Float
    acceleration: Float | None
    stop: Bool | None

    def take_slice(self, which: slice) -> RequestedMoves:
        """Return a slice of the moves."""
        return RequestedMoves(
            self.delta[which],
            self.speed[which],
            None if self.acceleration is None else self.acceleration[which],
            None if self.stop is None else self.stop[which],
        )

    def append_moves(self, moves: RequestedMoves) -> RequestedMoves:
        """Return these moves followed by `moves`, which has the same optional columns."""
        acceleration, stop = self.acceleration, self.stop
        if acceleration is not None and moves.acceleration is not None:
            acceleration = np.concatenate([acceleration, moves.acceleration])
        if stop is not None and moves.stop is not None:
            stop = np.concatenate([stop, moves.stop])
        return RequestedMoves(
            np.concatenate([self.delta, moves.delta]),
            np.concatenate([self.speed, moves.speed]),
            acceleration,
            stop,
        )


def compute_durations(
    delta: Float,
    speed: Float,
    limits: MotionLimits,
    *,
    stop_after: Bool | None = None,
    acceleration: Float | None = None,
) -> Float:
    """Return the time of each move on a machine with unlimited look-ahead.

    A firmware looks ahead only `limits.planner_blocks` moves and is slower for very short moves; `rules.Lookahead`
    models that.

    Args:
        delta: (K, 4) travel in x, y, z, e, mm. Zero moves take no time and make no corner.
        speed: (K,) requested speed, mm/s along x, y, z; along e if only e moves.
        limits: motion limits of the machine.
        stop_after: (K,) whether the machine stops after the move; it always stops after the last.
        acceleration: (K,) requested acceleration, mm/s², instead of the three accelerations of `limits`.

    Returns:
        (K,) s.
    """
    moves = RequestedMoves(delta, speed, acceleration, stop_after)
    batches = (
        moves.take_slice(slice(first, first + MOVES_PER_BATCH))
        for first in range(0, len(delta), MOVES_PER_BATCH)
    )
    return compute_durations_of_batches(batches, len(delta), limits)


def compute_durations_of_batches(
    batches: Iterable[RequestedMoves], n_moves: int, limits: MotionLimits
) -> Float:
    """Return the times (n_moves,) of moves that are given in consecutive batches, s, as `compute_durations` does."""
    seconds, done = np.zeros(n_moves), 0
    for some in _list_final_times(batches, limits):
        seconds[done : done + len(some)] = some
        done += len(some)
    return seconds


def _list_final_times(batches: Iterable[RequestedMoves], limits: MotionLimits) -> Iterator[Float]:
    """Yield the times of moves as soon as they are final."""
    planner = _BatchPlanner(limits)
    for moves in batches:
        yield planner.add(moves)
    yield planner.stop()


class _BatchPlanner:
    """Computes the times of moves that arrive in batches, on a machine with unlimited look-ahead.

    The time of a move depends on later moves only up to the point where the machine could stop before the last known
    move. Times before that point are final: they are returned and their moves dropped. The other moves are kept.

    Args:
        limits: motion limits of the machine; may be replaced while it rests.
    """

    def __init__(self, limits: MotionLimits) -> None:
        self.limits = limits
        self._waiting: RequestedMoves | None = None
        self._entry = (0.0, 0.0)

    @property
    def n_waiting(self) -> int:
        """Number of moves whose time is not final yet."""
        return len(self._waiting.speed) if self._waiting else 0

    def add(self, moves: RequestedMoves) -> Float:
        """Add moves; return the times (n,), s, of the next moves in order that no later move can change."""
        moves = self._waiting.append_moves(moves) if self._waiting else moves
        planned = self._plan(moves)
        known = planned.count_final()
        n_moves = int(planned.moving[known]) if known else 0
        if known:
            smooth = planned.smoothed.squares[known] if planned.smoothed else 0.0
            self._entry = float(planned.squares[known]), float(smooth)
        self._waiting = moves.take_slice(np.s_[n_moves:])
        return planned.move_times(n_moves, known)

    def stop(self) -> Float:
        """Stop the machine after the last move; return the times (n,) of the moves that were not final yet, s."""
        moves = self._waiting
        planned = self._plan(moves) if moves else None
        self._waiting, self._entry = None, (0.0, 0.0)
        return planned.move_times(len(moves.speed), len(planned.moving)) if moves and planned else np.zeros(0)

    def _plan(self, moves: RequestedMoves) -> SpeedProfile:
        """Plan the speeds of the moves that are not final, as if no more moves followed."""
        return plan_speeds(
            moves.delta,
            moves.speed,
            self.limits,
            stop_after=moves.stop,
            acceleration=moves.acceleration,
            entry=self._entry,
        )


class Stopwatch:
    """Adds up the time of moves that arrive in batches, on a machine with unlimited look-ahead.

    Args:
        limits: motion limits of the machine.
    """

    def __init__(self, limits: MotionLimits) -> None:
        self._planner = _BatchPlanner(limits)
        self._seconds = 0.0

    @property
    def limits(self) -> MotionLimits:
        """Motion limits of the machine; may be replaced while it rests."""
        return self._planner.limits

    @limits.setter
    def limits(self, limits: MotionLimits) -> None:
        """Replace the limits."""
        self._planner.limits = limits

    @property
    def n_waiting(self) -> int:
        """Number of moves whose time is not final yet."""
        return self._planner.n_waiting

    def add(self, moves: RequestedMoves) -> None:
        """Add moves; sum up the times that no later move can change."""
        self._seconds += float(self._planner.add(moves).sum())

    def stop_and_sum(self) -> float:
        """Stop the machine after the last move; return the total time of all moves so far, s."""
        self._seconds += float(self._planner.stop().sum())
        return self._seconds
