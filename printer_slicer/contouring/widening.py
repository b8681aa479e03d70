"""Widen sections by the areas that contoured extrusions fill."""

from __future__ import annotations

from typing import Final

import numpy as np

from printer_slicer.arrays import Int
from printer_slicer.contouring.tops import NARROW_REACH, Tops, list_reached_layers
from printer_slicer.geometry import (
    Areas,
    close_gaps,
    difference,
    intersection,
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
_LEVEL_RISE: Final = 0.01  # mm over the width of an extrusion; what rises less is level


class ReachedAreas(Struct, frozen=True, eq=False):
    """Areas of each layer that contoured extrusions fill although the surface is below the cut.

    Attributes:
        lower: where the surface is below the cut, but an extrusion may be as low.
        level: those of them that are almost horizontal.
        surface: all shallow surfaces in the layer and above it within the slope of one extrusion.
        margin: distance from steep surfaces within which no extrusion is lowered on a slope, mm.
    """

    lower: Areas
    level: Areas
    surface: Areas
    margin: float

    def add_to(self, solid: Areas, resolution: float) -> Areas:
        """Return solid areas with these, without the gaps, slivers and many points that this makes along their borders.

        Left out are strips beside other surfaces, because extrusions on a slope there are as high as the layer. On a
        horizontal surface, extrusions are low up to a steep one. Only a gap remains, so that they go along this border.
        """
        gap = _SLIVER + resolution  # is closed on each side
        changed = self.lower.used
        before = solid.of_layers(changed)
        high = offset_open(difference(before, self.surface), _SLIVER)
        around = offset(high, self.margin)
        lower = difference(self.lower, around)
        beside = intersection(self.level, around)
        if beside.n_rings:
            lower = union(lower, difference(beside, offset(high, 2 * gap + _SLIVER)))
        joined = close_gaps(union(before, lower), gap)
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
    plan, followed = tops.plan, np.flatnonzero(tops.followed)
    lower = _find_below_cut(tops, followed, rule)
    is_level = tops.slope[tops.facet[followed]] * rule.width < _LEVEL_RISE
    level = _find_below_cut(tops, followed[is_level], rule)
    around, layer = list_reached_layers(tops.corners, tops.slope, plan, rule, 1.0)
    used = lower.used[layer]
    high = plan.top + rule.width * rule.find_max_slopes(plan.height)
    surface = normalize(project_pieces(tops.corners[around[used]], layer[used], plan.bottom, high))
    return ReachedAreas(lower, level, surface, rule.width / 2)


def _find_below_cut(tops: Tops, some: Int, rule: ContourRule) -> Areas:
    """Return where the surface is below the cut and an extrusion may be as low, but not around level places.

    Args:
        tops: the facets.
        some: (n,) indices of reached layers and their facets.
        rule: least height of extrusions.
    """
    plan = tops.plan
    low = np.minimum(plan.bottom + rule.min_height / 2, plan.cut)
    areas = normalize(project_pieces(tops.corners[tops.facet[some]], tops.layer[some], low, plan.cut))
    if not tops.rule.level_places:
        return areas
    place = np.array(sorted(tops.rule.level_places))
    top, xy = place[:, 0] + tops.base, place[:, 1:]
    known = plan.has_tops(top)
    layer, xy = plan.find_tops(top[known]), xy[known]
    around = Areas.from_boxes(xy - NARROW_REACH, xy + NARROW_REACH, layer, areas.n_layers)
    return difference(areas, normalize(around))
