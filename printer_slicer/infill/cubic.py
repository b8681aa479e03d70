"""Cubic infill: cubes standing on a corner, equally stiff in all directions."""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Float
from printer_slicer.geometry import Polylines
from printer_slicer.infill.infill_task import InfillTask, line_families

__all__ = ["cubic_lines"]


def cubic_lines(task: InfillTask) -> tuple[Polylines, Float]:
    """Return sections through three sets of orthogonal planes whose space diagonal is vertical.

    The normals lean 54.7° from the vertical, so lines move by z / √2: they overhang the lines below by 0.71 mm per mm
    of height.
    """
    moved = task.z / (np.sqrt(2.0) * 3 * task.spacing)
    # The normals are 120° apart; the normal of the second set points the other way.
    phases = np.outer([-1.0, 1.0, -1.0], moved)
    return line_families(task, np.deg2rad([0.0, 60.0, 120.0]), phases)
