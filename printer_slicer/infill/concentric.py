"""Loops that follow the outline inward: flexible parts bend evenly, and nothing shows through thin walls."""

from __future__ import annotations

import numpy as np

from printer_slicer.geometry import Float, Polylines, offset
from printer_slicer.infill.task import Task

__all__ = ["concentric_lines"]

_SHORTEST = 3.0  # beads of length: smaller loops are blobs


def concentric_lines(task: Task) -> tuple[Polylines, Float]:
    """Loops half a spacing, one and a half, and so on, inside the outline; above each other where the outlines are."""
    loops, loop = [], offset(task.area, -task.spacing / 2)
    while loop.n_rings:
        loops.append(Polylines.around(loop.select(loop.ring_length() > _SHORTEST * task.bead)))
        loop = offset(loop, -task.spacing)
    if not loops:
        loops = [Polylines.around(loop)]
    return Polylines.joined(loops), np.ones(len(task.z))
