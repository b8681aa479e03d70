"""A firmware planner with limited look-ahead, over arrays: the same times as `rules.Lookahead` with a full queue.

The exit speed of a block is fixed when the block starts. It is the highest speed from which the machine can still take
every known corner and stop after the last known block, limited to what the block can reach. The first condition is a
minimum over the next few blocks, computed for all blocks at once in one pass per queue place. The second is
`vectorized.accumulate_limited`.
"""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Float
from printer_slicer.motion.vectorized import Blocks, accumulate_limited, ramp_times

__all__ = ["lookahead_seconds"]


def lookahead_seconds(blocks: Blocks, corners: Float, known_ahead: int, entry: float) -> tuple[Float, Float]:
    """Return the time of each block, if the planner knows `known_ahead` more blocks when the block starts.

    Args:
        blocks: B blocks without a stop in between.
        corners: (B,) squared speed allowed at the start of each; the first is ignored.
        known_ahead: number of known blocks after the one that starts.
        entry: squared speed at the start of the first.

    Returns:
        (B - seen,) s, and squared speeds at the end of these blocks, (mm/s)²; empty if there are fewer blocks.
    """
    count = len(corners) - known_ahead
    if count <= 0:
        return np.zeros(0), np.zeros(0)
    gains = 2.0 * blocks.acceleration * blocks.length
    reach = _reachable_squares(corners, gains, known_ahead, count)
    # The first block may start at any speed, so one step from 0 to that speed is put in front.
    squares = accumulate_limited(np.append(entry, reach), np.append(entry, gains[:count]))
    seconds = ramp_times(blocks.part(np.s_[:count]), squares, np.full(count, np.inf))
    return seconds, squares[1:]


def _reachable_squares(corners: Float, gains: Float, known_ahead: int, count: int) -> Float:
    """Return the highest squared exit speeds (count,) at which the known corners and a stop after them are possible."""
    best, braking = np.full(count, np.inf), np.zeros(count)
    # A block is done when its braking distance alone allows more than the best found; soon nearly all are.
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
