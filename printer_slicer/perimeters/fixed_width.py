"""Perimeter loops of one width, where sections are wide enough for all of them."""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Float
from printer_slicer.geometry import Areas, offset, offset_open

__all__ = ["fixed_width_loops"]

# Loops whose two sides come closer than this share of the spacing would overlap.
_CLOSEST_RATIO = 0.6
_MITRE_LIMIT = 4.65  # corners down to 25° keep their points


def fixed_width_loops(solid: Areas, width: Float, gap: Float, count: int) -> tuple[list[Areas], Areas, Float]:
    """Return the centre lines of `count` loops, the area inside them, and the area (L,) mm² that stays empty.

    Each centre line is one spacing inside the previous one. Loops are left out where they are too narrow.

    Args:
        solid: clean areas.
        width: (L,) mm, extrusion width.
        gap: (L,) mm, spacing.
        count: number of loops.
    """
    loops: list[Areas] = []
    lost = np.zeros(solid.n_layers)
    inside, step = solid, width / 2
    for _ in range(count):
        loop = offset_open(offset(inside, -step), gap * _CLOSEST_RATIO / 2, _MITRE_LIMIT)
        # The area between the inner side of the last extrusion and the outer side of this one stays empty. Mitred
        # joins restore slightly more than the opening removes; that is not a loss.
        room = offset(inside, -gap / 2) if loops else inside
        lost += np.maximum(room.area() - offset(loop, gap / 2 if loops else width / 2).area(), 0.0)
        loops.append(loop)
        inside, step = loop, gap
    return loops, offset(loops[-1], -gap / 2) if loops else solid, lost
