"""Two crossing sets of lines on every layer: strong in both directions at each height."""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Float
from printer_slicer.geometry import Polylines
from printer_slicer.infill.task import Task, families

__all__ = ["grid_lines"]


def grid_lines(task: Task) -> tuple[Polylines, Float]:
    """A square grid that keeps its place from layer to layer, so that its walls stand on each other."""
    return families(task, np.array([0.0, np.pi / 2]), np.zeros((2, len(task.z))))
