"""Grid infill: two crossing sets of lines on every layer."""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Float
from printer_slicer.geometry import Polylines
from printer_slicer.infill.infill_task import InfillTask, line_families

__all__ = ["grid_lines"]


def grid_lines(task: InfillTask) -> tuple[Polylines, Float]:
    """Return a square grid, the same on every layer."""
    return line_families(task, np.array([0.0, np.pi / 2]), np.zeros((2, len(task.z))))
