"""Supports: the plan of their layers, and their areas by layer."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from printer_slicer.arrays import Float, Int, frozen_array
from printer_slicer.geometry import Areas
from printer_slicer.model.layers import LayerPlan
from printer_slicer.repr_svg import SvgRepr
from printer_slicer.values import Struct, field, force_setattr, replace

__all__ = ["SupportPlan", "Supports", "UnsupportedPlace"]


class SupportPlan(Struct, frozen=True, eq=False):
    """The layers of supports, which have heights of their own, and the layers that carry overhangs.

    Attributes:
        layers: the layers of supports. `layers.base` is given where a layer is missing between two others.
        carrier: (L,) for each layer of the part, the support layer on whose top its overhang rests; -1: none.
        gap: (L,) distance from the top of that support layer to the bottom of the overhang, mm; nan: none.
        flat_gap_error: largest difference between the gap under a horizontal surface and the setting, mm.
    """

    layers: LayerPlan
    carrier: Int
    gap: Float
    flat_gap_error: float = 0.0

    def __post_init__(self) -> None:
        force_setattr(self, "carrier", frozen_array(self.carrier, np.int64, (-1,)))
        force_setattr(self, "gap", frozen_array(self.gap, np.float64, (len(self.carrier),)))

    @classmethod
    def joined(cls, parts: Sequence[SupportPlan], plans: Sequence[LayerPlan]) -> SupportPlan:
        """Combine plans with the same support layers; `plans` are the layers of the objects.

        Where objects have overhangs in the same layer, the one with the smallest gap counts.
        """
        if len(parts) == 1:
            return parts[0]
        plan = LayerPlan.union(plans)
        carrier, gap = np.full(plan.n_layers, -1), np.full(plan.n_layers, np.nan)
        for part, own in zip(parts, plans, strict=True):
            layer = plan.find_tops(own.top)
            nearer = (part.carrier >= 0) & ~(part.gap >= gap[layer])
            carrier[layer[nearer]], gap[layer[nearer]] = part.carrier[nearer], part.gap[nearer]
        return cls(parts[0].layers, carrier, gap, max(part.flat_gap_error for part in parts))


class UnsupportedPlace(Struct, frozen=True):
    """A place of an overhang that gets no support.

    Attributes:
        x, y, z: its middle and its lower side, mm.
        area: mm².
        reason: why, as a sentence without a full stop.
        is_island: whether the piece has nothing below it.
        free_distance: largest distance sideways from a point of the place to the nearest support, or to the part below
            the place, mm; 0 if it was not measured.
    """

    x: float
    y: float
    z: float
    area: float
    reason: str
    is_island: bool = False
    free_distance: float = 0.0


class Supports(SvgRepr, Struct, frozen=True, eq=False):
    """The areas of supports by support layer; areas of a layer do not overlap.

    Attributes:
        plan: the layers.
        base: filled with wide lines, or hollow where `hollow` covers it.
        interface: closed layers under overhangs.
        floor: closed layers on the part.
        joists: (lines as areas) single lines between the tips of trees, which carry the interface.
        hollow: the part of `base` that is printed as loops only: branches of trees.
        branches: (B, 8) z, x, y and radius of the lower end, then of the upper end of each piece of a branch, mm.
        unsupported: places without support.
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
    unsupported: tuple[UnsupportedPlace, ...] = ()
    interface_angle: Float = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        force_setattr(self, "branches", frozen_array(self.branches, np.float64, (-1, 8)))
        n_rings = self.interface.n_rings
        angle = self.interface_angle if len(self.interface_angle) else np.full(n_rings, np.nan)
        force_setattr(self, "interface_angle", frozen_array(angle, np.float64, (n_rings,)))

    @classmethod
    def joined(cls, plan: SupportPlan, parts: Sequence[Supports]) -> Supports:
        """Combine supports that have the layers of `plan` and do not overlap."""
        if len(parts) == 1:
            return replace(parts[0], plan=plan)
        stacks = {
            name: Areas.merged([getattr(part, name) for part in parts])
            for name in ("base", "interface", "floor", "joists", "hollow")
        }
        order = np.argsort(np.concatenate([part.interface.ring_layer for part in parts]), kind="stable")
        angle = np.concatenate([part.interface_angle for part in parts])[order]
        return cls(
            plan,
            **stacks,
            branches=np.concatenate([part.branches for part in parts]),
            unsupported=tuple(place for part in parts for place in part.unsupported),
            interface_angle=angle,
        )

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
