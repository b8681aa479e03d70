"""Rectilinear infill: parallel lines, turned by 90° from layer to layer."""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Float
from printer_slicer.geometry import Polylines, hatch
from printer_slicer.infill.infill_task import InfillTask

__all__ = ["rectilinear_lines"]


def rectilinear_lines(task: InfillTask) -> tuple[Polylines, Float]:
    """Return parallel lines; all lines of one direction lie directly above each other."""
    angle = np.asarray(task.angle + np.pi / 2 * (task.turn % 2), np.float64)
    return Polylines.hatched(hatch(task.area, angle=angle, spacing=task.spacing)), np.ones(len(task.z))
