"""Supports: the plan of their layers, and their areas by layer."""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Float, Int, frozen_array
from printer_slicer.geometry import Areas
from printer_slicer.model.layers import LayerPlan
from printer_slicer.repr_svg import SvgRepr
from printer_slicer.values import Struct, field, force_setattr

__all__ = ["Bare", "SupportPlan", "Supports"]


class SupportPlan(Struct, frozen=True, eq=False):
    """The layers of supports, which have heights of their own, and the layers that carry overhangs.

    Attributes:
        layers: the layers of supports. `layers.base` is given where a layer is missing between two others.
        carrier: (L,) for each layer of the part, the support layer on whose top its overhang rests; -1: none.
        gap: (L,) distance from the top of that support layer to the bottom of the overhang, mm; nan: none.
    """

    layers: LayerPlan
    carrier: Int
    gap: Float

    def __post_init__(self) -> None:
        force_setattr(self, "carrier", frozen_array(self.carrier, np.int64, (-1,)))
        force_setattr(self, "gap", frozen_array(self.gap, np.float64, (len(self.carrier),)))


class Bare(Struct, frozen=True):
    """A place that hangs and gets no support.

    Attributes:
        x, y, z: its middle and its lower side, mm.
        area: mm².
        reason: why, as a sentence without a full stop.
        is_island: whether the piece begins in the air.
    """

    x: float
    y: float
    z: float
    area: float
    reason: str
    is_island: bool = False


class Supports(SvgRepr, Struct, frozen=True, eq=False):
    """The areas of supports by support layer; areas of a layer do not overlap.

    Attributes:
        plan: the layers.
        base: filled with wide lines, or hollow where `hollow` covers it.
        interface: closed layers under overhangs.
        floor: closed layers on the part.
        joists: (lines as areas) single lines that carry the roof between the tips of trees.
        hollow: the part of `base` that is printed as loops only: branches of trees.
        branches: (B, 8) z, x, y and radius of the lower end, then of the upper end of each piece of a branch, mm.
        bare: places without support.
        interface_angle: (R,) radians for each ring of `interface`: direction of its lines, across the joists below; nan
            where any direction will do.
    """

    plan: SupportPlan
    base: Areas
    interface: Areas
    floor: Areas
    joists: Areas
    hollow: Areas
    branches: Float = field(default_factory=lambda: np.zeros((0, 8)))
    bare: tuple[Bare, ...] = ()
    interface_angle: Float = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        force_setattr(self, "branches", frozen_array(self.branches, np.float64, (-1, 8)))
        n_rings = self.interface.n_rings
        angle = self.interface_angle if len(self.interface_angle) else np.full(n_rings, np.nan)
        force_setattr(self, "interface_angle", frozen_array(angle, np.float64, (n_rings,)))

    def __repr__(self) -> str:
        volume = float(self.area.area() @ self.plan.layers.height)
        return f"<Supports: {self.plan.layers.n_layers} layers, {volume:.4g} mm3 with gaps between lines>"

    @property
    def area(self) -> Areas:
        """All areas of each support layer."""
        return Areas.merged([self.base, self.interface, self.floor, self.joists])

    @property
    def drawable(self) -> Areas:
        """All areas, which a picture of the supports shows."""
        return self.area
