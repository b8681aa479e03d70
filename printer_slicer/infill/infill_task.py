"""Interface of infill patterns: the task they get and the lines they return."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from printer_slicer.arrays import Float, Int, frozen_array
from printer_slicer.geometry import Areas, Polylines, hatch
from printer_slicer.model import Regions
from printer_slicer.values import Struct, force_setattr

__all__ = ["InfillTask", "Pattern", "line_families"]


class InfillTask(Struct, frozen=True, eq=False):
    """Areas to fill with lines of one pattern, as E entries; an entry is filled with extrusions of one height.

    Attributes:
        area: E entries, where centre lines may lie.
        spacing: mm; the pattern needs the same total length as parallel lines at this distance.
        bead: mm between the centre lines of extrusions side by side.
        inset: mm from the border of the area to fill to `area`.
        angle: radians, direction of the pattern.
        z: (E,) mm, middle of the extrusions. Patterns depend on it, so that they line up over layers of any height.
        height: (E,) mm, of the extrusions.
        turn: (E,) counter for patterns that alternate between directions.
        layer: (E,) the layer in which the entry is printed.
        regions: all regions, for patterns that need the surroundings.
        slope: mm by which a line may overhang the one below, per mm of height.
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
            force_setattr(self, name, frozen_array(getattr(self, name), np.float64, (n,)))
        for name in ("turn", "layer"):
            force_setattr(self, name, frozen_array(getattr(self, name), np.int64, (n,)))


# Returns lines within the area of a task, and (E,) ratio of their length to the wanted length at this z.
Pattern = Callable[[InfillTask], tuple[Polylines, Float]]


def line_families(task: InfillTask, directions: Float, phases: Float) -> tuple[Polylines, Float]:
    """Return several sets of parallel lines that share the density.

    Args:
        task: areas to fill.
        directions: (n,) radians, relative to the direction of the pattern.
        phases: (n, E) offset of each set, in spacings of the set.
    """
    step = len(directions) * task.spacing
    parts = [
        Polylines.hatched(hatch(task.area, angle=task.angle + direction, spacing=step, phase=phase % 1.0))
        for direction, phase in zip(directions.tolist(), phases, strict=True)
    ]
    return Polylines.joined(parts), np.ones(len(task.z))
