"""Loops of one width, where sections are wide enough for all of them."""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Float
from printer_slicer.geometry import Areas, offset, offset_open

__all__ = ["ordinary_loops"]

# Loops whose two sides would come closer than this share of the spacing would lay plastic twice in one place.
_CLOSEST = 0.6
_SHARPEST = 4.65  # corners down to 25° keep their points


def ordinary_loops(solid: Areas, width: Float, gap: Float, count: int) -> tuple[list[Areas], Areas, Float]:
    """Centre lines of `count` loops, the area left inside them, and (L,) mm² that stays empty.

    Each centre line is one spacing inside the one before. Loops too narrow for a bead on either side are left out.

    Args:
        solid: clean areas.
        width: (L,) mm of the beads.
        gap: (L,) mm, their spacing.
        count: how many loops.
    """
    loops: list[Areas] = []
    lost = np.zeros(solid.n_layers)
    inside, step = solid, width / 2
    for _ in range(count):
        loop = offset_open(offset(inside, -step), gap * _CLOSEST / 2, _SHARPEST)
        # What lies within the last bead's inner side but is not reached by this bead's outer side stays empty. Pointed
        # joins put back a little more than round tools would take away; that is no loss.
        room = offset(inside, -gap / 2) if loops else inside
        lost += np.maximum(room.area() - offset(loop, gap / 2 if loops else width / 2).area(), 0.0)
        loops.append(loop)
        inside, step = loop, gap
    return loops, offset(loops[-1], -gap / 2) if loops else solid, lost
