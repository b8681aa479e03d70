"""A firmware planner with limited look-ahead, over arrays: the same times as `rules.Lookahead` with a full queue.

The exit speed of a block is fixed when the block starts. It is the highest speed from which the machine can still take
every known corner and stop after the last known block, limited to what the block can reach. The first condition is a
minimum over the next few blocks, computed for all blocks at once in one pass per queue place. The second is
`vectorized.accumulate_with_limit`.
"""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Float
from printer_slicer.motion.vectorized import Blocks, accumulate_with_limit, compute_ramp_times

__all__ = ["compute_lookahead_seconds"]


def compute_lookahead_seconds(
    blocks: Blocks, corners: Float, known_ahead: int, entry: float
) -> tuple[Float, Float]:
    """Return the time of each block, if the planner knows `known_ahead` more blocks when the block starts.

    Args:
        blocks: B blocks without a stop in between.
        corners: (B,) squared speed that the corner at the start of each block allows; the first one is ignored.
        known_ahead: number of known blocks after the one that starts.
        entry: squared speed at the start of the first block.

    Returns:
        For all blocks but the last `known_ahead`: the time (n,), s, and the squared speed at the end (n,), (mm/s)².
    """
    count = len(corners) - known_ahead
    if count <= 0:
        return np.zeros(0), np.zeros(0)
    gains = 2.0 * blocks.acceleration * blocks.length
    reach = _find_reachable_squares(corners, gains, known_ahead, count)
    # The first block may start at any speed, so one step from 0 to that speed is put in front.
    squares = accumulate_with_limit(np.append(entry, reach), np.append(entry, gains[:count]))
    seconds = compute_ramp_times(blocks.take_slice(np.s_[:count]), squares, np.full(count, np.inf))
    return seconds, squares[1:]


def _find_reachable_squares(corners: Float, gains: Float, known_ahead: int, count: int) -> Float:
    """Return the highest squared exit speeds (count,) at which the known corners and a stop after them are possible."""
    best, braking = np.full(count, np.inf), np.zeros(count)
    # The search for a block ends when its braking distance alone allows more than the best speed found so far.
    on = np.arange(count)
    for step in range(1, known_ahead + 1):
        ahead = on + step
        found = np.minimum(best[on], braking[on] + corners[ahead])
        gone = braking[on] + gains[ahead]
        best[on], braking[on] = found, gone
        on = on[gone < found]
        if not len(on):
            break
    return np.asarray(np.minimum(best, braking))
