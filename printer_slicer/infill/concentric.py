"""Concentric infill: loops parallel to the outline, for flexible parts and for smooth thin walls."""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Bool, Float
from printer_slicer.geometry import Areas, Polylines, clip_outlines, difference, offset
from printer_slicer.infill.infill_task import InfillTask

__all__ = ["concentric_lines"]

_SHORTEST_LOOP = 3.0  # extrusion widths; smaller loops would be blobs
_MIN_CUT_AREA = 0.01  # mm², least area that internal bridges take from the loops


def concentric_lines(task: InfillTask) -> tuple[Polylines, Float]:
    """Return loops 0.5, 1.5, 2.5 ... spacings inside the outline.

    Internal bridges cut the loops but do not move them, because other bridges rest on the loops.
    """
    outline, cut = task.area, np.zeros(task.area.n_layers, np.bool_)
    if outline.n_layers == task.regions.plan.n_layers:  # each layer by itself
        outline = offset(task.regions.internal_infill, -task.inset).of_layers(task.area.used)
        cut = difference(outline, task.area).area() > _MIN_CUT_AREA
    loops, loop = [], offset(outline, -task.spacing / 2)
    while loop.n_rings:
        loops += _cut_loops(loop.select(loop.ring_length() > _SHORTEST_LOOP * task.bead), task.area, cut)
        loop = offset(loop, -task.spacing)
    return Polylines.joined(loops or [Polylines.around(loop)]), np.ones(len(task.z))


def _cut_loops(loops: Areas, area: Areas, is_cut: Bool) -> list[Polylines]:
    """Return the loops as lines; on layers with `is_cut` (L,), clip them to the area."""
    whole = Polylines.around(loops.of_layers(~is_cut))
    if not is_cut.any():
        return [whole]
    some = loops.of_layers(is_cut)
    xy, size, ring, closed = clip_outlines(some, area)
    ends = np.full((len(size), 2), -1)
    return [whole, Polylines(xy, np.append(0, np.cumsum(size)), some.ring_layer[ring], ends, closed)]
