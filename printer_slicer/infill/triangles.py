"""Triangular infill: three sets of lines at 60°, equally stiff in all directions of the layer."""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Float
from printer_slicer.geometry import Polylines
from printer_slicer.infill.infill_task import InfillTask, line_families

__all__ = ["triangle_lines"]

_CROSSING_DISTANCE = 1.5  # extrusion widths between the crossings at a corner


def triangle_lines(task: InfillTask) -> tuple[Polylines, Float]:
    """Return triangles, the same on every layer.

    If the lines of all three sets met in one point, three extrusions would pile up there. One set is shifted, so that
    the three crossings are 1.5 extrusion widths apart. For very small triangles the shift is limited to half a
    spacing, which gives hexagons with triangles between them.
    """
    # With u, v, w the positions across the three directions, v = u + w; the middle set moves by `aside` spacings.
    aside = min(0.5, _CROSSING_DISTANCE * task.bead * np.sqrt(0.75) / (3 * task.spacing))
    phases = np.outer([0.0, aside, 0.0], np.ones(len(task.z)))
    return line_families(task, np.deg2rad([0.0, 60.0, 120.0]), phases)
