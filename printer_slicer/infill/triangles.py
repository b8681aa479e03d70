"""Three sets of lines at 60° on every layer: equally stiff in all directions of the layer."""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Float
from printer_slicer.geometry import Polylines
from printer_slicer.infill.task import Task, families

__all__ = ["triangle_lines"]

_APART = 1.5  # beads between the crossings at a corner


def triangle_lines(task: Task) -> tuple[Polylines, Float]:
    """Triangles whose walls stand on each other.

    Lines of all three sets through one point would pile three beads there. One set is moved aside, so that the three
    crossings of a corner lie 1.5 beads apart; where the triangles become so small that this is not possible, hexagons
    with triangles between them have the crossings as far apart as can be.
    """
    # With u, v, w the places across the three directions, v = u + w: the middle set moves by `aside` of their spacing.
    aside = min(0.5, _APART * task.bead * np.sqrt(0.75) / (3 * task.spacing))
    phases = np.outer([0.0, aside, 0.0], np.ones(len(task.z)))
    return families(task, np.deg2rad([0.0, 60.0, 120.0]), phases)
