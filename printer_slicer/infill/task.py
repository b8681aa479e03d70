"""What a pattern of sparse infill is given, and what it gives."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from printer_slicer.arrays import Float, Int, frozen_array
from printer_slicer.geometry import Areas, Polylines, hatch
from printer_slicer.model import Regions

__all__ = ["Pattern", "Task", "families"]


@dataclass(frozen=True, slots=True, eq=False)
class Task:
    """Areas to be filled with lines of one pattern. An entry (E of them) is what is filled by beads of one height.

    Attributes:
        area: where the centre lines may lie, E entries.
        spacing: mm: the pattern shall have as much line as parallel lines this far apart.
        bead: mm between the centre lines of beads that lie side by side.
        inset: mm by which `area` lies inside what is to be filled.
        angle: radians, the direction of the pattern.
        z: (E,) mm, the middle of what the beads fill; patterns are functions of it, so that they line up through layers
            of any height.
        height: (E,) mm, of the beads.
        turn: (E,) which of the pattern's directions is due, for patterns that take turns.
        layer: (E,) the layer of the regions in which the entry is printed.
        regions: what is around the sparse areas, for patterns that look at it.
        slope: by how many mm a line may lean out over the one below for each mm of height.
    """

    area: Areas
    spacing: float
    bead: float
    inset: float
    angle: float
    z: Float
    height: Float
    turn: Int
    layer: Int
    regions: Regions
    slope: float

    def __post_init__(self) -> None:
        n = self.area.n_layers
        for name in ("z", "height"):
            object.__setattr__(self, name, frozen_array(getattr(self, name), np.float64, (n,)))
        for name in ("turn", "layer"):
            object.__setattr__(self, name, frozen_array(getattr(self, name), np.int64, (n,)))


# What a task asks for -> lines within its area, and (E,) how much more line than asked for the pattern has at that z.
Pattern = Callable[[Task], tuple[Polylines, Float]]


def families(task: Task, directions: Float, phases: Float) -> tuple[Polylines, Float]:
    """Families of parallel lines that share the density.

    Args:
        task: what to fill.
        directions: (n,) radians from the direction of the pattern.
        phases: (n, E) of the rows, in spacings of the family.
    """
    step = len(directions) * task.spacing
    parts = [
        Polylines.hatched(hatch(task.area, angle=task.angle + direction, spacing=step, phase=phase % 1.0))
        for direction, phase in zip(directions.tolist(), phases, strict=True)
    ]
    return Polylines.joined(parts), np.ones(len(task.z))
