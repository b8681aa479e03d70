"""Sections + Walls -> Regions: what is inside the walls, by how far below and above it there is air.

Shell thicknesses are in mm. On layers of uneven height the layers within reach are a range of z, a different number for
each layer; their common area comes from a table of intersections over 1, 2, 4, ... layers.
"""

from __future__ import annotations

import numpy as np

from printer_slicer.bridges import bridge_angles
from printer_slicer.geometry import difference, intersection, offset, offset_open, union, window_intersection
from printer_slicer.model import Areas, Float, Int, LayerPlan, Regions, Sections, Walls
from printer_slicer.profile import Profile

__all__ = ["classify"]

_SMALLEST = 1e-6  # mm: heights that differ by less are the same


def classify(sections: Sections, walls: Walls, profile: Profile) -> Regions:
    """The inside of the walls, divided by purpose.

    A point is solid when, going up (down) from its layer, air begins within `quality.top_thickness`
    (`quality.bottom_thickness`). The bed is a surface too.
    """
    plan, inside, solid = sections.plan, walls.inside, sections.solid
    quality = profile.quality
    above = _missing(inside, solid, *_window_above(plan, quality.top_thickness))
    below = _missing(inside, solid, *_window_below(plan, quality.bottom_thickness))
    open_above = _missing(inside, solid, *_window_above(plan, min(quality.top_thickness, _SMALLEST)))
    open_below = _missing(inside, solid, *_window_below(plan, min(quality.bottom_thickness, _SMALLEST)))
    shell = _anchored(union(above, below), inside, walls.width)
    if quality.infill_density >= 1:
        shell = inside
    down = _anchored(open_below, inside, walls.width)
    up = difference(_anchored(open_above, inside, walls.width), down)
    return Regions(
        plan,
        bottom_skin=down.select(down.ring_layer == 0),
        bridge=down.select(down.ring_layer > 0),
        top_skin=up,
        solid=difference(difference(shell, down), up),
        sparse=difference(inside, shell),
        bridge_angle=bridge_angles(down, _below(solid), walls.width, np.deg2rad(quality.infill_angle_deg)),
    )


def _below(solid: Areas) -> Areas:
    """For each layer the section of the layer below; nothing under the first."""
    own = np.arange(solid.n_layers)
    return window_intersection(solid, own - 1, own)


def _window_above(plan: LayerPlan, thickness: float) -> tuple[Int, Int]:
    """For each layer the layers above whose bottom is less than `thickness` over its top; none for thickness 0."""
    first = np.arange(plan.n_layers) + 1
    last = np.searchsorted(plan.bottom, plan.top + thickness - _SMALLEST / 2)
    # Air over the last layer: what lies within reach of the top has a window that leaves the stack.
    near_top = plan.top + thickness - _SMALLEST / 2 > plan.top[-1]
    return first, np.where(near_top & (thickness > 0), plan.n_layers + 1, last).astype(np.int64)


def _window_below(plan: LayerPlan, thickness: float) -> tuple[Int, Int]:
    """For each layer the layers below whose top is less than `thickness` under its bottom; the bed ends the stack."""
    last = np.arange(plan.n_layers)
    first = np.searchsorted(plan.top, plan.bottom - thickness + _SMALLEST / 2, side="right")
    near_bed = plan.bottom - thickness + _SMALLEST / 2 < 0
    return np.where(near_bed & (thickness > 0), -1, first).astype(np.int64), last


def _missing(inside: Areas, solid: Areas, first: Int, last: Int) -> Areas:
    """What of `inside` is not covered by all layers of its window; nothing where the window is empty."""
    idle = last <= first
    own = np.arange(inside.n_layers)
    cover = window_intersection(solid, np.where(idle, own, first), np.where(idle, own + 1, last))
    return difference(inside.select(~idle[inside.ring_layer]), cover.select(~idle[cover.ring_layer]))


def _anchored(area: Areas, inside: Areas, width: Float) -> Areas:
    """`area` without slivers that no bead fits in, grown by two beads so that its lines end on something."""
    return intersection(offset(offset_open(area, width / 4), 2 * width), inside)
