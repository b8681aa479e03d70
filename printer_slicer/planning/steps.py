"""Heights as whole numbers of z steps, so that sums of layer heights are exact."""

from __future__ import annotations

import numpy as np

from printer_slicer.errors import PlanError
from printer_slicer.model import Int, LayerPlan, Mesh
from printer_slicer.profile import Profile

__all__ = ["Steps", "fill"]


class Steps:
    """Converts between mm and the z steps of the printer.

    Attributes:
        size: mm in one step.
        lowest, highest: the printer's limits, in steps.
        part: height of the part rounded up to a whole step, in steps.
        first: the first layer's height in steps, 0 where the planner may choose.
    """

    def __init__(self, mesh: Mesh, profile: Profile) -> None:
        self.size = profile.printer.z_step
        self._height = mesh.height
        self.lowest = int(np.ceil(profile.printer.min_layer / self.size - 1e-6))
        self.highest = int(np.floor(profile.printer.max_layer / self.size + 1e-6))
        # A part may rise over the last whole step by less than half a step: that much is the machine's resolution.
        self.part = max(self.of(mesh.height), 1)
        self.first = self.of(profile.quality.first_layer_height)
        if self.part < self.lowest:
            raise PlanError(
                f"{mesh.name}: {mesh.height:.4g} mm high, thinner than the thinnest layer of "
                f"{profile.printer.name!r} ({profile.printer.min_layer:g} mm)",
                remedy="is the part in another unit? otherwise scale it up or lower printer.min_layer",
            )

    def of(self, height: float) -> int:
        """The nearest number of steps to a height in mm."""
        return round(height / self.size)

    def plan(self, heights: Int, planner: str) -> LayerPlan:
        """The plan of layers with these heights in steps."""
        top = np.round(np.cumsum(heights) * self.size, 7)
        bottom = np.concatenate([[0.0], top[:-1]])
        # A last layer that rises over the part is cut in the middle of the material it does contain.
        return LayerPlan(top, (bottom + np.minimum(top, max(self._height, float(bottom[-1])))) / 2, planner)


def fill(total: int, step: int, lowest: int, highest: int) -> Int:
    """Layer heights that fill `total` exactly with layers of `step`, all in z steps.

    What is left over becomes one layer at the end; if it is too thin for the printer, the last layer takes it or
    shares with it. A total under `lowest` is one layer of `lowest`.
    """
    if total <= 0:
        return np.zeros(0, np.int64)
    count, rest = divmod(total, step)
    heights = [step] * count
    if rest >= lowest or (rest and not count):
        heights.append(max(rest, lowest))
    elif rest:
        last = heights.pop() + rest
        if last <= highest:
            heights.append(last)
        elif last >= 2 * lowest:
            heights += [last - last // 2, last // 2]
        else:  # neither one layer nor two: rise over the part rather than miss it
            heights += [step, lowest]
    return np.array(heights, np.int64)
