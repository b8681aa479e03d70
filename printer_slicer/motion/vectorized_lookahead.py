"""A planner that knows a few moves ahead, over arrays: what `rules.Lookahead` says block by block while it is full.

A block's exit speed is fixed when it begins. It is the highest from which the machine can keep every later corner it
knows of, and stop behind the last block it knows; and no higher than the block can reach. The first is a minimum over
the next few blocks, found for all blocks at once by one pass for each place of the planner; the second is
`vectorized.running_least`.
"""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Float
from printer_slicer.motion.vectorized import Blocks, ramp_times, running_least

__all__ = ["lookahead_seconds"]


def lookahead_seconds(blocks: Blocks, corners: Float, seen: int, entry: float) -> tuple[Float, Float]:
    """Seconds of each block that begins while the planner knows `seen` blocks behind it.

    Args:
        blocks: B of them, following each other without a stop.
        corners: (B,) squared speed allowed at the start of each; that of the first does not matter.
        seen: known behind a block that begins.
        entry: squared speed at the start of the first.

    Returns:
        (B - seen,) s, and squared speeds at the end of these blocks, (mm/s)²; none where there are fewer blocks.
    """
    count = len(corners) - seen
    if count <= 0:
        return np.zeros(0), np.zeros(0)
    gains = 2.0 * blocks.acceleration * blocks.length
    reach = _reachable(corners, gains, seen, count)
    # The first may begin at any speed: one step from 0 to there is put in front.
    squares = running_least(np.append(entry, reach), np.append(entry, gains[:count]))
    seconds = ramp_times(blocks.part(np.s_[:count]), squares, np.full(count, np.inf))
    return seconds, squares[1:]


def _reachable(corners: Float, gains: Float, seen: int, count: int) -> Float:
    """(count,) see `rules.Lookahead`: best exit that lets the next `seen` corners be kept, and a stop behind them."""
    best, way = np.full(count, np.inf), np.zeros(count)
    # Blocks whose way alone allows more than the best found are done; after a few steps nearly all are.
    on = np.arange(count)
    for step in range(1, seen + 1):
        ahead = on + step
        found = np.minimum(best[on], way[on] + corners[ahead])
        gone = way[on] + gains[ahead]
        best[on], way[on] = found, gone
        on = on[gone < found]
        if not len(on):
            break
    return np.asarray(np.minimum(best, way))
