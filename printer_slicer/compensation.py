"""Offset the outlines of sections to compensate for dimensional errors of the printer.

Filament shrinks, bulges, and is squeezed out on the bed (elephant foot). Outlines are offset by the measured errors.
"""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Float
from printer_slicer.geometry import (
    Areas,
    difference,
    find_enclosing_rings,
    normalize,
    offset,
    offset_open,
    union,
)
from printer_slicer.model import Sections
from printer_slicer.profile import Profile
from printer_slicer.values import replace

__all__ = ["compensate"]


def compensate(sections: Sections, profile: Profile) -> Sections:
    """Offset outlines by `quality.xy_compensation`, `hole_compensation` and `elephant_foot`.

    Places narrower than the elephant-foot inset plus one extrusion get no inset, because they need their contact with
    the bed.
    """
    quality, plan = profile.quality, sections.plan
    solid = sections.solid
    if quality.xy_compensation or quality.hole_compensation:
        solid = _offset_outlines(solid, quality.xy_compensation, quality.hole_compensation)
    if quality.elephant_foot:
        fading = max(quality.elephant_foot_height, float(plan.height[0]))
        inset = quality.elephant_foot * np.maximum(1 - plan.bottom / fading, 0.0)
        solid = _inset_areas(solid, inset, profile.extrusion_width)
    return sections if solid is sections.solid else replace(sections, solid=solid)


def _offset_outlines(solid: Areas, outward: float, holes_by: float) -> Areas:
    """Grow outer outlines by `outward` mm, and holes by `holes_by` mm."""
    is_outer = solid.ring_area() > 0
    outer, holes = solid.select(is_outer), solid.select(~is_outer)
    if not outer.n_rings:
        return solid
    # Each outer ring and its holes get a layer of their own, so that islands inside a hole stay separate.
    owner = find_enclosing_rings(outer, holes.xy[holes.ring_start[:-1]], holes.ring_layer)
    alone = Areas(outer.xy, outer.ring_start, np.arange(outer.n_rings), outer.n_rings)
    order = np.argsort(owner, kind="stable")
    order = order[owner[order] >= 0]
    own = _reverse_rings(holes, order)
    voids = Areas(own.xy, own.ring_start, owner[order], outer.n_rings)
    islands = difference(offset(alone, outward), offset(voids, holes_by))
    together = Areas(islands.xy, islands.ring_start, outer.ring_layer[islands.ring_layer], solid.n_layers)
    return normalize(together)


def _reverse_rings(rings: Areas, order: np.ndarray[tuple[int, ...], np.dtype[np.int64]]) -> Areas:
    """Return the rings in the given order, each reversed, all on one layer."""
    points = [rings.ring(i)[::-1] for i in order.tolist()]
    size = np.array([0, *map(len, points)], np.int64)
    return Areas(
        np.concatenate([np.zeros((0, 2)), *points]), np.cumsum(size), np.zeros(len(points), np.int64), 1
    )


def _inset_areas(solid: Areas, inset: Float, width: float) -> Areas:
    """Shrink areas by an inset (L,), mm, except where they are narrower than the inset plus one extrusion."""
    here = inset > 0
    low = solid.of_layers(here)
    thin = difference(low, offset_open(low, inset + width / 2))
    return union(offset(low, -inset), thin).merge(solid.of_layers(~here))
