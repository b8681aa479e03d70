"""Where the nozzle was when the printer lost its power: the plan that it had then, run by the one model of motion.

An `ok` means "has a place in the planner". A printer that keeps the host waiting has a full planner, and the ok comes
when the running move ends. So the time of such an ok says which move begins at that moment, and from there on the model
tells how far the machine came until the time of the loss.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Sequence
from typing import Final

from printer_slicer.motion.rules import Block, Lookahead, MotionLimits, make_block
from printer_slicer.printing.machine_state import Step

__all__ = ["find_stop_position"]

_WAITED: Final = 0.012
"""s between two oks that the cable alone does not explain."""

_SAME: Final = 1e-6
_START_DELAY: Final = 0.1
"""s that a standing machine waits for more moves."""


def find_stop_position(
    steps: Sequence[Step],
    accepted: Sequence[tuple[int, float]],
    lost: float | None,
    limits: MotionLimits,
    *,
    noticed: float | None = None,
) -> tuple[int, float]:
    """The move that was being made, as its index and the share of its time that had passed.

    Args:
        steps: the last moves that were accepted, in order, and behind whatever the machine last stood still for.
        accepted: (entries of the job accepted, when, s), ascending.
        lost: when the printer was lost, s; None: later than everything that was planned took, so all was made.
        limits: of the machine.
        noticed: when the host noticed the restart, s. A printer with a full planner acknowledges at the end
            of each move: then it stopped before that, and not as early as its last acknowledgement.

    Returns:
        Index and share; the share is 1 at the end of a move.
    """
    made = [(index, block) for index, step in enumerate(steps) if (block := _block(step, limits)) is not None]
    if lost is None or not made:
        return len(steps) - 1, 1.0
    times = _times([steps[index] for index, _ in made], accepted)
    blocks = [block for _, block in made]
    number, share = _running(blocks, times, lost, limits)
    last = len(blocks) - max(limits.planner_blocks - 1, 1)
    if noticed is not None and number <= last:
        number, share = min(_running(blocks, times, noticed, limits), (last, 1.0))
    if number == len(made):
        return len(steps) - 1, 1.0
    return made[number][0], share


def _running(
    blocks: Sequence[Block], times: Sequence[float], lost: float, limits: MotionLimits
) -> tuple[int, float]:
    """Which block was being made, and the share of its time that had passed; as many as there are when all were."""
    places = max(limits.planner_blocks - 1, 1)
    first, began = _anchor(times, places) or (0, times[0] + _START_DELAY)
    lookahead = Lookahead(limits)
    pushed = 0
    for index in range(len(blocks)):
        until = index + places if index <= first else max(bisect_left(times, began + _SAME), index + 1)
        while pushed < min(until, len(blocks)):
            lookahead.push(blocks[pushed])
            pushed += 1
        seconds = lookahead.pop()
        if index < first:
            continue
        if began + seconds > lost:
            return index, max(lost - began, 0.0) / seconds
        began += seconds
    return len(blocks), 1.0


def _block(step: Step, limits: MotionLimits) -> Block | None:
    """The move as the planner has it; an arc counts as the straight line between its ends."""
    x0, y0, z0 = step.before.place
    x1, y1, z1 = step.after.place
    return make_block(limits, (x1 - x0, y1 - y0, z1 - z0, step.after.e - step.before.e), step.after.speed)


def _times(steps: Sequence[Step], accepted: Sequence[tuple[int, float]]) -> list[float]:
    """When each move was accepted, s; what was said between the job's own entries, when its neighbour was."""
    times: list[float] = []
    for step in steps:
        at = bisect_left(accepted, step.entry + 1, key=lambda one: one[0])
        known = accepted[min(at, len(accepted) - 1)][1] if accepted and step.entry >= 0 else None
        times.append(known if known is not None else times[-1] if times else 0.0)
    return times


def _anchor(times: Sequence[float], places: int) -> tuple[int, float] | None:
    """The last move known to have begun at a known time, and that time."""
    for index in range(len(times) - 1, places - 1, -1):
        if times[index] - times[index - 1] > _WAITED:
            return index - places + 1, times[index]
    return None
