"""Sections -> Walls -> Toolpaths: loops that follow the contours, from the outside inward."""

from __future__ import annotations

import numpy as np

from printer_slicer import bead
from printer_slicer.geometry import offset, offset_open
from printer_slicer.model import Areas, Role, Sections, Toolpaths, Walls
from printer_slicer.profile import Profile

__all__ = ["lay_walls", "perimeter_paths"]

# Loops whose two sides would come closer than this share of the spacing would lay plastic twice in one place.
_CLOSEST = 0.6


def lay_walls(sections: Sections, profile: Profile) -> Walls:
    """Centre lines of `quality.perimeters` loops around every section, and the area left inside them.

    The outermost bead's side lies on the contour; each further centre line is one spacing (which depends on the layer's
    own height) inside the one before. Loops too narrow for a bead on either side are left out.
    """
    height = sections.plan.height
    width = bead.layer_widths(sections.plan.n_layers, profile.width_of_first_layer, profile.extrusion_width)
    gap = bead.spacing(width, height)
    loops: list[Areas] = []
    lost = np.zeros(sections.plan.n_layers)
    inside, step = sections.solid, width / 2
    for _ in range(profile.quality.perimeters):
        loop = offset_open(offset(inside, -step), gap * _CLOSEST / 2)
        # What lies within the last bead's inner side but is not reached by this bead's outer side stays empty. Pointed
        # joins put back a little more than round tools would take away; that is no loss.
        room = offset(inside, -gap / 2) if loops else inside
        lost += np.maximum(room.area() - offset(loop, gap / 2 if loops else width / 2).area(), 0.0)
        loops.append(loop)
        inside, step = loop, gap
    if loops:
        inside = offset(loops[-1], -gap / 2)
    return Walls(sections.plan, width, tuple(loops), inside, lost)


def perimeter_paths(walls: Walls) -> Toolpaths:
    """One closed path per loop; the deeper ones come first within each layer."""
    layer, role, width, xy, size = [], [], [], [], []
    for depth, loop in reversed(list(enumerate(walls.loops))):
        layer.append(loop.ring_layer)
        role.append(np.full(loop.n_rings, Role.INNER_PERIMETER if depth else Role.OUTER_PERIMETER))
        width.append(walls.width[loop.ring_layer])
        xy.append(loop.xy)
        size.append(np.diff(loop.ring_start))
    return Toolpaths.gathered(
        walls.plan,
        xy=np.concatenate([np.zeros((0, 2)), *xy]),
        size=np.concatenate([np.zeros(0, np.int64), *size]),
        layer=np.concatenate([np.zeros(0, np.int64), *layer]),
        role=np.concatenate([np.zeros(0, np.int64), *role]),
        width=np.concatenate([np.zeros(0), *width]),
        closed=True,
    )
