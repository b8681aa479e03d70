"""Widen sections by the areas that contoured extrusions fill."""

from __future__ import annotations

from typing import Final

import numpy as np

from printer_slicer.contouring.tops import Tops, list_reached_layers
from printer_slicer.geometry import (
    Areas,
    close_gaps,
    difference,
    normalize,
    offset,
    offset_open,
    simplify,
    union,
)
from printer_slicer.geometry.slab_projection import project_pieces
from printer_slicer.model import ContourRule
from printer_slicer.values import Struct

__all__ = ["ReachedAreas", "find_reached_areas"]

_SLIVER: Final = 0.01  # mm; half the width of slivers that are removed


class ReachedAreas(Struct, frozen=True, eq=False):
    """Areas of each layer that contoured extrusions fill although the surface is below the cut.

    Attributes:
        lower: where the surface is below the cut, but an extrusion may be as low.
        surface: all shallow surfaces in the layer and above it within the slope of one extrusion.
        margin: distance from steep surfaces within which no extrusion is lowered, mm.
    """

    lower: Areas
    surface: Areas
    margin: float

    def add_to(self, solid: Areas, resolution: float) -> Areas:
        """Return solid areas with these, without the gaps, slivers and many points that this makes along their borders.

        Left out are strips beside other surfaces, because extrusions there are as high as the layer.
        """
        changed = self.lower.used
        before = solid.of_layers(changed)
        level = offset_open(difference(before, self.surface), _SLIVER)
        lower = difference(self.lower, offset(level, self.margin))
        joined = close_gaps(union(before, lower), _SLIVER + resolution)
        joined = offset_open(joined, _SLIVER)
        return solid.of_layers(~changed).merge(normalize(simplify(joined, resolution)))


def find_reached_areas(tops: Tops, rule: ContourRule) -> ReachedAreas:
    """Find the areas of each layer that contoured extrusions fill although the surface is below the cut.

    A section at the cut ends where the surface is half a layer high. A contoured extrusion may be as low as
    `min_height` of the rule, so the section takes in everything where the surface is higher than half of that.

    Args:
        tops: from `find_tops`.
        rule: least height and width of extrusions.
    """
    plan = tops.plan
    low = np.minimum(plan.bottom + rule.min_height / 2, plan.cut)
    facet, layer = tops.facet[tops.followed], tops.layer[tops.followed]
    lower = normalize(project_pieces(tops.corners[facet], layer, low, plan.cut))
    around, layer = list_reached_layers(tops.corners, tops.slope, plan, rule, 1.0)
    used = lower.used[layer]
    high = plan.top + rule.width * rule.find_max_slopes(plan.height)
    surface = normalize(project_pieces(tops.corners[around[used]], layer[used], plan.bottom, high))
    return ReachedAreas(lower, surface, rule.width / 2)
