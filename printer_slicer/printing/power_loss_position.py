"""Estimate the nozzle position at a power loss from the times of the last acknowledgements.

An `ok` means that the command has a place in the planner. If the printer delays an ok, its planner is full, and the ok
comes when the current move ends. So the time of a delayed ok is the start of a known move. From there the motion model
computes how far the machine moved until the loss.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Sequence
from typing import Final

from printer_slicer.motion.rules import Block, Lookahead, MotionLimits, make_block
from printer_slicer.printing.machine_state import Step

__all__ = ["find_stop_position"]

_FULL_PLANNER_GAP: Final = 0.012
"""Time between two oks from which the planner counts as full, because the link alone is faster, s."""

_TIME_TOLERANCE: Final = 1e-6
_START_DELAY: Final = 0.1
"""Time for which a machine at rest waits for more moves before it starts, s."""


def find_stop_position(
    steps: Sequence[Step],
    accepted: Sequence[tuple[int, float]],
    lost_at: float | None,
    limits: MotionLimits,
    *,
    noticed_at: float | None = None,
) -> tuple[int, float]:
    """Find the move during which the printer stopped, and the fraction of the move's time that had passed.

    Args:
        steps: the last accepted moves, in order, since the machine last stood still.
        accepted: (number of accepted job entries, time in s), ascending.
        lost_at: time at which the printer lost its power, s; None: after it had finished all planned moves.
        limits: limits of the machine.
        noticed_at: time at which the host noticed the restart, s. With a full planner, the printer acknowledges a line
            at the end of each move, so it stopped between the last acknowledgement and this time.

    Returns:
        Index of the move, and the fraction, which is 1 at the end of the move.
    """
    moves = [
        (index, block) for index, step in enumerate(steps) if (block := _make_block(step, limits)) is not None
    ]
    if lost_at is None or not moves:
        return len(steps) - 1, 1.0
    times = _find_acceptance_times([steps[index] for index, _ in moves], accepted)
    blocks = [block for _, block in moves]
    number, fraction = _find_running_block(blocks, times, lost_at, limits)
    last = len(blocks) - max(limits.planner_blocks - 1, 1)
    if noticed_at is not None and number <= last:
        number, fraction = min(_find_running_block(blocks, times, noticed_at, limits), (last, 1.0))
    if number == len(moves):
        return len(steps) - 1, 1.0
    return moves[number][0], fraction


def _find_running_block(
    blocks: Sequence[Block], times: Sequence[float], lost_at: float, limits: MotionLimits
) -> tuple[int, float]:
    """Return the index of the block that runs at `lost_at`, and the fraction of its time that had passed.

    The index is the number of blocks if all have ended.
    """
    places = max(limits.planner_blocks - 1, 1)
    first, began = _find_known_start(times, places) or (0, times[0] + _START_DELAY)
    lookahead = Lookahead(limits)
    pushed = 0
    for index in range(len(blocks)):
        until = (
            index + places if index <= first else max(bisect_left(times, began + _TIME_TOLERANCE), index + 1)
        )
        while pushed < min(until, len(blocks)):
            lookahead.push(blocks[pushed])
            pushed += 1
        seconds = lookahead.pop()
        if index < first:
            continue
        if began + seconds > lost_at:
            return index, max(lost_at - began, 0.0) / seconds
        began += seconds
    return len(blocks), 1.0


def _make_block(step: Step, limits: MotionLimits) -> Block | None:
    """Return the planner block of a move, None if the move has no length; an arc counts as straight."""
    x0, y0, z0 = step.before.place
    x1, y1, z1 = step.after.place
    return make_block(limits, (x1 - x0, y1 - y0, z1 - z0, step.after.e - step.before.e), step.after.speed)


def _find_acceptance_times(steps: Sequence[Step], accepted: Sequence[tuple[int, float]]) -> list[float]:
    """Return when each move was accepted, s; a move from outside the job gets the time of the move before."""
    times: list[float] = []
    for step in steps:
        at = bisect_left(accepted, step.entry + 1, key=lambda one: one[0])
        known = accepted[min(at, len(accepted) - 1)][1] if accepted and step.entry >= 0 else None
        times.append(known if known is not None else times[-1] if times else 0.0)
    return times


def _find_known_start(times: Sequence[float], places: int) -> tuple[int, float] | None:
    """Find the last move with a known start; return its index and start time, s; None if there is none."""
    for index in range(len(times) - 1, places - 1, -1):
        if times[index] - times[index - 1] > _FULL_PLANNER_GAP:
            return index - places + 1, times[index]
    return None
