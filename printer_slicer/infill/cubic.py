"""Cubes that stand on a corner: three sets of lines that move with the height, equally stiff in all directions."""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Float
from printer_slicer.geometry import Polylines
from printer_slicer.infill.task import Task, families

__all__ = ["cubic_lines"]


def cubic_lines(task: Task) -> tuple[Polylines, Float]:
    """Sections at each z through three sets of planes at right angles to each other, a diagonal upright.

    A plane whose normal leans 54.7° from the vertical moves by z / √2 across its lines; so lines lean out over
    those below by 0.71 mm for each mm of height.
    """
    moved = task.z / (np.sqrt(2.0) * 3 * task.spacing)
    # The normals lie 120° apart; that of the second set points the other way.
    phases = np.outer([-1.0, 1.0, -1.0], moved)
    return families(task, np.deg2rad([0.0, 60.0, 120.0]), phases)
