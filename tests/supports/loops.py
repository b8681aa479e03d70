"""The beads of hollow branches as simple loops, and which stretches of them have no bead below."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from printer_slicer.arrays import Float
from printer_slicer.geometry import (
    Areas,
    Polylines,
    clip_lines,
    difference,
    intersection,
    normalize,
    offset,
    offset_open,
    union,
)
from printer_slicer.model import Supports

__all__ = ["draw_plastic", "find_hanging_stretches"]

_THICK = 1.5  # mm; thicker branches get a second loop


def draw_plastic(supports: Supports, width: float = 0.45) -> Areas:
    """What beads cover: one loop around branches, two around thick ones; the rest is closed."""
    hollow = supports.hollow
    loop = difference(hollow, offset(hollow, -width))
    second = difference(hollow, offset(hollow, -2 * width))
    loops = union(loop, intersection(second, offset(offset_open(hollow, _THICK), width)))
    closed = difference(supports.base, hollow)
    return normalize(Areas.merged([loops, closed, supports.interface, supports.joists]))


def find_hanging_stretches(supports: Supports, part: Areas, width: float = 0.45) -> tuple[Float, Float]:
    """Lengths of the stretches of outer loops of which less than half the width lies over plastic, and all loops', mm.

    Args:
        supports: of which the loops are.
        part: what else carries, by support layer.
        width: of the loops.
    """
    lines = offset(supports.hollow, -width / 2)
    size = np.diff(lines.ring_start)
    rings = [np.append(np.arange(a, b), a) for a, b in pairwise(lines.ring_start.tolist())]
    again = np.concatenate([np.zeros(0, np.int64), *rings])
    loops = Polylines.of(lines.xy[again], size + 1, lines.ring_layer)
    carried = union(draw_plastic(supports, width).shift_layers(1), part)
    air = difference(offset(supports.hollow, width), carried).of_layers(np.arange(1, part.n_layers))
    return clip_lines(air, loops).length(), loops.length()
