"""Sections -> Walls: loops that follow the contours, from the outside inward, and beads amid narrow places.

Where a section is wide, loops of one width lie one spacing apart (`ordinary`). Where it is too narrow for them all,
their number and their widths follow the thickness (`narrow`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from printer_slicer import bead
from printer_slicer.geometry import Areas, Bool, Float
from printer_slicer.model import LayerPlan, Role, Sections, Toolpaths, Walls, reordered
from printer_slicer.perimeters.beading import Beading
from printer_slicer.perimeters.narrow import Narrow, fill_narrow_places
from printer_slicer.perimeters.ordinary import ordinary_loops
from printer_slicer.perimeters.thinning import kept_points
from printer_slicer.profile import Profile

__all__ = ["NarrowFill", "fill_narrow", "lay_walls"]

_SIMPLER = 0.03  # mm; the borders of strips between beads are nobody's outline
_EVEN = 0.004  # mm by which points may be off that are spared
_HAIR = 1e-3  # mm; what is left lies this far inside, so that it is known on which side of the outlines it is
_LEAST_STRIP = 0.5  # of the narrowest bead's spacing; thinner strips between loops are left open


def lay_walls(sections: Sections, profile: Profile) -> Walls:
    """`quality.perimeters` loops around every section, and the area left inside them.

    The outermost bead's side lies on the contour. Layers that are wide everywhere have loops of one width; on others
    the beads fill the narrow places from side to side.
    """
    plan, loops = sections.plan, profile.quality.perimeters
    width = np.full(plan.n_layers, profile.extrusion_width)
    gap = bead.spacing(width, plan.height)
    if not loops:
        return Walls(plan, width, _loops(plan, [], width), sections.solid, np.zeros(plan.n_layers))
    feature = np.full(plan.n_layers, profile.thinnest_feature)
    beads = _beading(plan, profile, loops=loops, amid=False, margin=(width - gap) / 2, thinnest=feature)
    narrow = fill_narrow_places(sections.solid, beads)
    wide = sections.solid.select(~narrow.layers[sections.solid.ring_layer])
    ordinary, inside, lost = ordinary_loops(wide, width, gap, loops)
    strips = fill_narrow(inside.merge(narrow.inside), plan, profile)
    paths = [strips.paths, _loops(plan, ordinary, width), _varying(plan, narrow)]
    return Walls(plan, width, Toolpaths.joined(plan, paths), strips.rest, lost + narrow.lost + strips.lost)


@dataclass(frozen=True, slots=True, eq=False)
class NarrowFill:
    """What `fill_narrow` makes of areas.

    Attributes:
        paths: beads, open or closed, with their widths.
        rest: what is wide.
        lost: (L,) mm² too thin for any bead.
    """

    paths: Toolpaths
    rest: Areas
    lost: Float


def fill_narrow(
    areas: Areas, plan: LayerPlan, profile: Profile, *, beads: int = 1, role: Role = Role.INNER_PERIMETER
) -> NarrowFill:
    """Beads of varying width where areas between other beads are too narrow for anything else, and what is left.

    Args:
        areas: clean areas; their outlines are where the shares of the beads around them end.
        plan: the layers.
        profile: printer and quality.
        beads: places with room for more side by side are left.
        role: of the paths.
    """
    hair = np.full(plan.n_layers, _HAIR)
    least = _LEAST_STRIP * bead.spacing(np.maximum(profile.bead_widths[0], plan.height), plan.height)
    count = _beading(plan, profile, loops=beads // 2, amid=beads % 2 == 1, margin=hair, thinnest=least)
    narrow = fill_narrow_places(areas, count, _SIMPLER)
    rest = areas.select(~narrow.layers[areas.ring_layer]).merge(narrow.inside)
    return NarrowFill(_varying(plan, narrow, role), rest, narrow.lost)


def _beading(
    plan: LayerPlan, profile: Profile, *, loops: int, amid: bool, margin: Float, thinnest: Float
) -> Beading:
    """How many beads lie across an area, by its thickness."""
    height, width = plan.height, profile.extrusion_width
    spacing = bead.spacing(width, height)
    narrowest, widest = (bead.spacing(np.maximum(limit, height), height) for limit in profile.bead_widths)
    return Beading(loops, amid, spacing, width - spacing, margin, narrowest, widest, thinnest)


def _loops(plan: LayerPlan, loops: list[Areas], width: Float) -> Toolpaths:
    """One closed path per ring; the deeper ones come first within each layer."""
    layer, role, widths, xy, size = [], [], [], [], []
    for depth, loop in reversed(list(enumerate(loops))):
        layer.append(loop.ring_layer)
        role.append(np.full(loop.n_rings, Role.INNER_PERIMETER if depth else Role.OUTER_PERIMETER))
        widths.append(width[loop.ring_layer])
        xy.append(loop.xy)
        size.append(np.diff(loop.ring_start))
    return Toolpaths.gathered(
        plan,
        xy=np.concatenate([np.zeros((0, 2)), *xy]),
        size=np.concatenate([np.zeros(0, np.int64), *size]),
        layer=np.concatenate([np.zeros(0, np.int64), *layer]),
        role=np.concatenate([np.zeros(0, np.int64), *role]),
        width=np.concatenate([np.zeros(0), *widths]),
        closed=True,
    )


def _varying(plan: LayerPlan, narrow: Narrow, role: Role | None = None) -> Toolpaths:
    """Loops and lines of varying width, the deeper ones first within each layer; perimeters if no role is given."""
    rings, lines = narrow.rings, narrow.lines
    layer = np.concatenate([rings.layer, lines.layer])
    depth = np.concatenate([rings.level, lines.depth])
    size = np.concatenate([rings.size, lines.size])
    xy, width = np.concatenate([rings.xy, lines.xy]), np.concatenate([rings.width, lines.width])
    width = np.round(np.maximum(width, np.repeat(plan.height[layer], size)), 3)  # what the file will say
    closed: Bool = np.concatenate([np.ones(len(rings.size), np.bool_), lines.closed])
    kept = kept_points(xy, width, size, closed, _EVEN)
    xy, width, size = (
        xy[kept],
        width[kept],
        np.bincount(np.repeat(np.arange(len(size)), size)[kept], minlength=len(size)),
    )
    outer, inner = (Role.OUTER_PERIMETER, Role.INNER_PERIMETER) if role is None else (role, role)
    order = np.lexsort((-depth, layer))
    (x, y, width), size = reordered((*xy.T, width), size, order)
    return Toolpaths.gathered(
        plan,
        xy=np.column_stack([x, y]),
        size=size,
        layer=layer[order],
        role=np.where(depth[order] > 0, inner, outer),
        width=width,
        closed=closed[order],
    )
