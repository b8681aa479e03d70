"""The shallow upper surfaces of a part, and the areas of its layers that they widen."""

from __future__ import annotations

from typing import Final

import numpy as np

from printer_slicer.arrays import Bool, Float, Int
from printer_slicer.geometry.facet_topology import expand_counts
from printer_slicer.model import ContourRule, LayerPlan, Mesh
from printer_slicer.model.layers import SAME_TOP
from printer_slicer.surface.contoured_tops import select_shallow_facets
from printer_slicer.values import Struct, replace

__all__ = [
    "BESIDE_RATIO",
    "LEVEL_REACH",
    "NARROW_REACH",
    "Tops",
    "find_flats_at_tops",
    "find_tops",
    "list_reached_layers",
]

BESIDE_RATIO: Final = 1.5
"""Beside followed surfaces may be surfaces up to this many times as steep."""
LEVEL_REACH: Final = 0.6
"""mm in x and y around a level place, where extrusions stay level."""
NARROW_REACH: Final = 1.5
"""mm in x and y around a level place, where sections are not widened: from there on, extrusions can be low again."""
_ROUNDING: Final = 1e-6  # of tangents
_MIN_REACH: Final = 0.005  # mm; a facet that reaches less far into a layer lies on its border


class Tops(Struct, frozen=True, eq=False):
    """The facets that contoured extrusions follow and those beside them, once for each layer that they reach.

    Attributes:
        plan: the layers.
        rule: which slopes are followed, and where not.
        corners: (T, 3, 3) mm, counter-clockwise as seen from above, in the coordinates of the layers.
        slope: (T,) tangent of the angle between each facet and the horizontal.
        facet: (R,) a facet that reaches into a layer.
        layer: (R,) that layer, ascending.
        followed: (R,) whether extrusions of the layer follow the facet; others are only somewhat steeper than these.
        base: z at which the part begins, mm.
    """

    plan: LayerPlan
    rule: ContourRule
    corners: Float
    slope: Float
    facet: Int
    layer: Int
    followed: Bool
    base: float

    @property
    def is_contoured(self) -> Bool:
        """Mask (L,) of the layers in which extrusions follow facets."""
        result = np.zeros(self.plan.n_layers, np.bool_)
        result[self.layer[self.followed]] = True
        return result

    def are_level(self, xy: Float, layer: Int, reach: float) -> Bool:
        """Return which points (n, 2) of layers (n,) are at most `reach` mm in x and y from a level place there."""
        return self.rule.are_beside_level_places(xy, self.plan.top[layer] - self.base, reach)


def find_tops(mesh: Mesh, plan: LayerPlan, rule: ContourRule, lift: float = 0.0) -> Tops | None:
    """Find the facets that contoured extrusions follow in the layers of a plan; None if there are none.

    The first layer of the part is never contoured.

    Args:
        mesh: the placed part, standing on z = 0.
        plan: the layers.
        rule: which slopes are followed.
        lift: height by which the layers of the part are raised, mm, as on a raft.
    """
    steepest = rule.find_max_slopes(plan.height)
    facet, slope, _ = select_shallow_facets(mesh.triangles, BESIDE_RATIO * float(steepest.max()))
    corners = mesh.triangles[facet] + np.array([0.0, 0.0, lift])
    reaching, layer = list_reached_layers(corners, slope, plan, rule, 0.0)
    kept = ((plan.bottom > lift + SAME_TOP) & rule.find_contoured(plan.top - lift))[layer]
    reaching, layer = reaching[kept], layer[kept]
    followed = slope[reaching] <= steepest[layer] + _ROUNDING
    return Tops(plan, rule, corners, slope, reaching, layer, followed, lift) if followed.any() else None


def find_flats_at_tops(tops: Tops) -> Tops | None:
    """Return the level facets at the tops of layers, with these layers; None if there are none.

    Extrusions need not follow them, but where bodies overlap, they cover lower surfaces in their layer.
    """
    z = tops.corners[..., 2]
    low, high = z.min(axis=1), z.max(axis=1)
    nearest = np.clip(np.searchsorted(tops.plan.top, low - _MIN_REACH), 0, tops.plan.n_layers - 1)
    is_at_top = (high - low < _MIN_REACH) & (np.abs(tops.plan.top[nearest] - high) <= _MIN_REACH)
    facet = np.flatnonzero(is_at_top & tops.is_contoured[nearest])
    if not len(facet):
        return None
    facet = facet[np.argsort(nearest[facet], kind="stable")]
    return replace(tops, facet=facet, layer=nearest[facet], followed=np.ones(len(facet), np.bool_))


def list_reached_layers(
    corners: Float, slope: Float, plan: LayerPlan, rule: ContourRule, margin: float
) -> tuple[Int, Int]:
    """Return pairs of facets and layers, by layer: facets that are followed, or somewhat steeper, and reach into it.

    Args:
        corners: (T, 3, 3) mm, of the facets.
        slope: (T,) their slopes, as tangents.
        plan: the layers.
        rule: which slopes are followed.
        margin: widths of an extrusion by which facets may be beside the layer.
    """
    steepest = rule.find_max_slopes(plan.height)
    beyond = margin * rule.width * steepest
    low, high = corners[..., 2].min(axis=1), corners[..., 2].max(axis=1)
    most = float(beyond.max())
    first = np.searchsorted(plan.top, low - most, side="right")
    # Layers of different objects may overlap, so their bottoms need not ascend.
    last = np.searchsorted(plan.top, high + most + float(plan.height.max()), side="right")
    facet, place = expand_counts(np.maximum(last - first, 0))
    layer = first[facet] + place
    reaches = plan.bottom[layer] - beyond[layer] < high[facet] - _MIN_REACH
    reaches &= plan.top[layer] + beyond[layer] > low[facet] + _MIN_REACH
    reaches &= slope[facet] <= BESIDE_RATIO * steepest[layer] + _ROUNDING
    facet, layer = facet[reaches], layer[reaches]
    order = np.argsort(layer, kind="stable")
    return facet[order], layer[order]
