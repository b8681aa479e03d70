"""Loops that follow the outline inward: flexible parts bend evenly, and nothing shows through thin walls."""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Bool, Float
from printer_slicer.geometry import Areas, Polylines, clip_outlines, difference, offset
from printer_slicer.infill.task import Task

__all__ = ["concentric_lines"]

_SHORTEST = 3.0  # beads of length: smaller loops are blobs
_CUT = 0.01  # mm² taken from the area that the loops were drawn for


def concentric_lines(task: Task) -> tuple[Polylines, Float]:
    """Loops half a spacing, one and a half, and so on, inside the outline; above each other where the outlines are.

    What internal bridges take of the sparse area cuts the loops and does not move them, as other bridges rest on them.
    """
    outline, cut = task.area, np.zeros(task.area.n_layers, np.bool_)
    if outline.n_layers == task.regions.plan.n_layers:  # each layer by itself
        outline = offset(task.regions.sparse, -task.inset).of_layers(task.area.used)
        cut = difference(outline, task.area).area() > _CUT
    loops, loop = [], offset(outline, -task.spacing / 2)
    while loop.n_rings:
        loops += _lines(loop.select(loop.ring_length() > _SHORTEST * task.bead), task.area, cut)
        loop = offset(loop, -task.spacing)
    return Polylines.joined(loops or [Polylines.around(loop)]), np.ones(len(task.z))


def _lines(loops: Areas, area: Areas, cut: Bool) -> list[Polylines]:
    """The loops, on the layers that are cut (L,) the parts of them within the area."""
    whole = Polylines.around(loops.of_layers(~cut))
    if not cut.any():
        return [whole]
    some = loops.of_layers(cut)
    xy, size, ring, closed = clip_outlines(some, area)
    ends = np.full((len(size), 2), -1)
    return [whole, Polylines(xy, np.append(0, np.cumsum(size)), some.ring_layer[ring], ends, closed)]
