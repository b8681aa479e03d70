"""Sections -> Sections: outlines moved against what the printer does to them.

Plastic shrinks, bulges, and is squeezed out at the bed. Each is met by moving outlines by what was measured.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from printer_slicer.arrays import Float
from printer_slicer.geometry import Areas, difference, normalize, offset, offset_open, rings_around, union
from printer_slicer.model import Sections
from printer_slicer.profile import Profile

__all__ = ["compensate"]


def compensate(sections: Sections, profile: Profile) -> Sections:
    """The sections with outlines moved by `quality.xy_compensation`, `hole_compensation` and `elephant_foot`.

    What is narrower than a bead and the inset together keeps its width at the bed: it must hold on to something.
    """
    quality, plan = profile.quality, sections.plan
    solid = sections.solid
    if quality.xy_compensation or quality.hole_compensation:
        solid = _moved(solid, quality.xy_compensation, quality.hole_compensation)
    if quality.elephant_foot:
        fading = max(quality.elephant_foot_height, float(plan.height[0]))
        inset = quality.elephant_foot * np.maximum(1 - plan.bottom / fading, 0.0)
        solid = _inset(solid, inset, profile.extrusion_width)
    return sections if solid is sections.solid else replace(sections, solid=solid)


def _moved(solid: Areas, outward: float, holes_by: float) -> Areas:
    """Areas with their outer outlines grown by `outward` mm and their holes by `holes_by` mm."""
    is_outer = solid.ring_area() > 0
    outer, holes = solid.select(is_outer), solid.select(~is_outer)
    if not outer.n_rings:
        return solid
    # Every outer ring, with the holes in it, on a layer of its own: what lies in a hole is not part of it.
    owner = rings_around(outer, holes.xy[holes.ring_start[:-1]], holes.ring_layer)
    alone = Areas(outer.xy, outer.ring_start, np.arange(outer.n_rings), outer.n_rings)
    order = np.argsort(owner, kind="stable")
    order = order[owner[order] >= 0]
    own = _turned(holes, order)
    voids = Areas(own.xy, own.ring_start, owner[order], outer.n_rings)
    islands = difference(offset(alone, outward), offset(voids, holes_by))
    together = Areas(islands.xy, islands.ring_start, outer.ring_layer[islands.ring_layer], solid.n_layers)
    return normalize(together)


def _turned(rings: Areas, order: np.ndarray[tuple[int, ...], np.dtype[np.int64]]) -> Areas:
    """Rings in another order, each the other way around, all on one layer."""
    points = [rings.ring(i)[::-1] for i in order.tolist()]
    size = np.array([0, *map(len, points)], np.int64)
    return Areas(
        np.concatenate([np.zeros((0, 2)), *points]), np.cumsum(size), np.zeros(len(points), np.int64), 1
    )


def _inset(solid: Areas, inset: Float, width: float) -> Areas:
    """Areas shrunk by an inset (L,) where they are wider than that and a bead; nothing is done where it is 0."""
    here = inset > 0
    low = solid.of_layers(here)
    thin = difference(low, offset_open(low, inset + width / 2))
    return union(offset(low, -inset), thin).merge(solid.of_layers(~here))
