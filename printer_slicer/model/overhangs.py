"""Overhangs: the areas of a part with nothing below them, layer by layer."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, distinct, frozen_array
from printer_slicer.geometry import Areas, intersection
from printer_slicer.model.layers import LayerPlan
from printer_slicer.model.supports import UnsupportedPlace
from printer_slicer.repr_svg import SvgRepr
from printer_slicer.values import Struct, force_setattr, replace

__all__ = ["Overhangs"]


class Overhangs(SvgRepr, Struct, frozen=True, eq=False):
    """The areas of each layer with nothing below them, except bridges and small patches.

    Attributes:
        plan: the layers of the part.
        area: overhangs of each layer that need a support.
        ring_patch: (R,) patch of each ring of `area`, from 0. Pieces in neighbouring layers that touch are one patch.
        islands: the lowest piece of each body that stands on nothing, and of each tail; they are part of `area`.
        bridged: overhangs whose bridge lines are supported at both ends.
        is_flat: (L,) whether this layer alone contains much of a patch, as under a horizontal face.
        blocked: islands that get no support because a support blocker covers them.
        idle_enforcers: connected support enforcers without an overhang, so that they have no effect.
        idle_blockers: connected support blockers within which nothing would get a support.
    """

    plan: LayerPlan
    area: Areas
    ring_patch: Int
    islands: Areas
    bridged: Areas
    is_flat: Bool
    blocked: tuple[UnsupportedPlace, ...] = ()
    idle_enforcers: tuple[UnsupportedPlace, ...] = ()
    idle_blockers: tuple[UnsupportedPlace, ...] = ()

    def __post_init__(self) -> None:
        force_setattr(self, "ring_patch", frozen_array(self.ring_patch, np.int64, (self.area.n_rings,)))
        force_setattr(self, "is_flat", frozen_array(self.is_flat, np.bool_, (self.plan.n_layers,)))

    def __repr__(self) -> str:
        if not self.area.n_rings:
            return "<Overhangs: none>"
        area, islands = float(self.area.area().sum()), len(np.unique(self.islands.ring_layer))
        return f"<Overhangs: {self.n_patches} patches, {area:.4g} mm2, islands in {islands} layers>"

    @classmethod
    def joined(cls, parts: Sequence[Overhangs]) -> Overhangs:
        """Combine the overhangs of several objects."""
        if len(parts) == 1:
            return parts[0]
        plan = LayerPlan.union([part.plan for part in parts])
        layers = [plan.find_tops(part.plan.top) for part in parts]
        is_flat = np.zeros(plan.n_layers, np.bool_)
        for part, layer in zip(parts, layers, strict=True):
            is_flat[layer[part.is_flat]] = True
        first = np.cumsum([0, *(part.n_patches for part in parts)])
        patch = np.concatenate([part.ring_patch + n for part, n in zip(parts, first[:-1], strict=True)])
        order = np.argsort(
            np.concatenate([layer[part.area.ring_layer] for part, layer in zip(parts, layers, strict=True)]),
            kind="stable",
        )
        stacks = {
            name: Areas.merged(
                [
                    getattr(part, name).on_layers(layer, plan.n_layers)
                    for part, layer in zip(parts, layers, strict=True)
                ]
            )
            for name in ("area", "islands", "bridged")
        }
        blocked = tuple(place for part in parts for place in part.blocked)
        enforcers = tuple(place for part in parts for place in part.idle_enforcers)
        blockers = tuple(place for part in parts for place in part.idle_blockers)
        return cls(
            plan,
            ring_patch=patch[order],
            is_flat=is_flat,
            blocked=blocked,
            idle_enforcers=enforcers,
            idle_blockers=blockers,
            **stacks,
        )

    @property
    def n_patches(self) -> int:
        """Number of patches."""
        return int(self.ring_patch.max(initial=-1)) + 1

    @property
    def drawable(self) -> Areas:
        """The areas, which a picture of the overhangs shows."""
        return self.area

    def take_patches(self, chosen: Bool) -> Overhangs:
        """Return the overhangs of some patches, given by a mask (n_patches,), which keep their order."""
        number = np.cumsum(chosen) - 1
        keep = chosen[self.ring_patch]
        area = self.area.select(keep)
        return replace(
            self,
            area=area,
            ring_patch=number[self.ring_patch[keep]],
            islands=intersection(self.islands, area) if self.islands.n_rings else self.islands,
        )

    def of_layers(self, here: Bool) -> Overhangs:
        """Keep the overhangs in the layers for which `here` (L,) is true."""
        keep = here[self.area.ring_layer]
        patch = distinct(self.ring_patch[keep])
        return replace(
            self,
            area=self.area.select(keep),
            ring_patch=np.searchsorted(patch, self.ring_patch[keep]),
            islands=self.islands.of_layers(here),
            bridged=self.bridged.of_layers(here),
            is_flat=self.is_flat & here,
        )

    def patch_areas(self) -> Float:
        """Return the area of each patch, summed over its layers, mm²."""
        areas = np.bincount(self.ring_patch, self.area.ring_area(), minlength=self.n_patches)
        return areas.astype(np.float64)
