"""The perimeters of all layers, and the area inside them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from printer_slicer.arrays import Bool, Float, frozen_array
from printer_slicer.geometry import Areas
from printer_slicer.model.layers import LayerPlan
from printer_slicer.model.paths import Toolpaths
from printer_slicer.repr_svg import SvgRepr
from printer_slicer.values import Struct, force_setattr

__all__ = ["Walls"]


class Walls(SvgRepr, Struct, frozen=True, eq=False):
    """The perimeters, and the area inside them.

    Attributes:
        plan: the layers.
        width: (L,) nominal extrusion width of the perimeters of each layer, mm.
        paths: loops, and open paths along the middle of narrow places; within a layer inner perimeters come first.
        inside: the area to be filled with infill.
        lost: (L,) mm² of each section, outside and between perimeters, that stays empty because it is too narrow for
            an extrusion.
    """

    plan: LayerPlan
    width: Float
    paths: Toolpaths
    inside: Areas
    lost: Float

    def __post_init__(self) -> None:
        for name in ("width", "lost"):
            force_setattr(self, name, frozen_array(getattr(self, name), np.float64, (self.plan.n_layers,)))

    @property
    def drawable(self) -> object:
        """The perimeters, which are what `draw` shows of the walls."""
        return self.paths

    def __repr__(self) -> str:
        return f"<Walls: {self.plan.n_layers} layers, {self.paths.n_paths} perimeters>"

    def on_plan(self, plan: LayerPlan) -> Walls:
        """Return the walls on the layers of another plan; layers are matched by their tops."""
        if plan is self.plan:
            return self
        layer = plan.find_tops(self.plan.top)
        width, lost = np.zeros((2, plan.n_layers))
        width[layer] = self.width
        lost[layer] = self.lost * (self.plan.height / plan.height[layer])  # the same volume
        return Walls(plan, width, self.paths.on_plan(plan), self.inside.on_layers(layer, plan.n_layers), lost)

    def of_layers(self, layers: Bool) -> Walls:
        """Return only the walls of the layers of a mask (L,); on the others there is nothing."""
        paths = self.paths.take(np.flatnonzero(layers[self.paths.layer]))
        return Walls(
            self.plan, self.width, paths, self.inside.of_layers(layers), np.where(layers, self.lost, 0.0)
        )

    def without_paths(self) -> Walls:
        """Return only the widths and the lost area, to release memory."""
        none = self.paths.take(np.zeros(0, np.int64))
        return Walls(self.plan, self.width, none, Areas.empty(self.plan.n_layers), self.lost)

    @classmethod
    def joined(cls, parts: Sequence[Walls]) -> Walls:
        """Combine the walls of several objects, or of several groups of layers."""
        if len(parts) == 1:
            return parts[0]
        plan = LayerPlan.union([part.plan for part in parts])
        parts = [part.on_plan(plan) for part in parts]
        first = parts[0]
        return cls(
            plan,
            np.max([part.width for part in parts], axis=0) if plan is not first.plan else first.width,
            Toolpaths.joined(first.plan, [part.paths for part in parts]),
            Areas.merged([part.inside for part in parts]),
            np.sum([part.lost for part in parts], axis=0),
        )
