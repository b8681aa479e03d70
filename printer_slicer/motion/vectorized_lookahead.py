"""A firmware planner with limited look-ahead, over arrays: the same times as `rules.Lookahead` with a full queue.

The exit speed of a block is fixed when the block starts. It is the highest speed from which the machine can still take
every known corner and stop after the last known block, limited to what the block can reach. The first condition is a
minimum over the next few blocks, computed for all blocks at once in one pass per queue place. The second is
`vectorized.running_least`.
"""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Float
from printer_slicer.motion.vectorized import Blocks, ramp_times, running_least

__all__ = ["lookahead_seconds"]


def lookahead_seconds(blocks: Blocks, corners: Float, seen: int, entry: float) -> tuple[Float, Float]:
    """Return the time of each block that starts while the planner knows `seen` blocks after it.

    Args:
        blocks: B blocks without a stop in between.
        corners: (B,) squared speed allowed at the start of each; the first is ignored.
        seen: number of known blocks after the one that starts.
        entry: squared speed at the start of the first.

    Returns:
        (B - seen,) s, and squared speeds at the end of these blocks, (mm/s)²; empty if there are fewer blocks.
    """
    count = len(corners) - seen
    if count <= 0:
        return np.zeros(0), np.zeros(0)
    gains = 2.0 * blocks.acceleration * blocks.length
    reach = _reachable(corners, gains, seen, count)
    # The first block may start at any speed, so one step from 0 to that speed is put in front.
    squares = running_least(np.append(entry, reach), np.append(entry, gains[:count]))
    seconds = ramp_times(blocks.part(np.s_[:count]), squares, np.full(count, np.inf))
    return seconds, squares[1:]


def _reachable(corners: Float, gains: Float, seen: int, count: int) -> Float:
    """Return the highest squared exit speeds (count,) that allow the next `seen` corners, and a stop after them."""
    best, braking = np.full(count, np.inf), np.zeros(count)
    # A block is done when its braking distance alone allows more than the best found; soon nearly all are.
    on = np.arange(count)
    for step in range(1, seen + 1):
        ahead = on + step
        found = np.minimum(best[on], braking[on] + corners[ahead])
        gone = braking[on] + gains[ahead]
        best[on], braking[on] = found, gone
        on = on[gone < found]
        if not len(on):
            break
    return np.asarray(np.minimum(best, braking))
