"""Loops and middle beads of areas, whatever lies around them: a contour, or other beads."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from printer_slicer import bead
from printer_slicer.geometry import Areas, Bool, Float
from printer_slicer.model import LayerPlan, Role, Toolpaths, reordered
from printer_slicer.perimeters.beading import Beading
from printer_slicer.perimeters.narrow import Narrow, fill_narrow_places
from printer_slicer.perimeters.ordinary import ordinary_loops
from printer_slicer.perimeters.thinning import kept_points
from printer_slicer.profile import Profile

__all__ = ["Filled", "fill_narrow", "shell"]

_SIMPLER = 0.025  # mm; the borders of strips between beads are nobody's outline
_EVEN = 0.004  # mm by which points may be off that are spared
_HAIR = 1e-3  # mm; what is left lies this far inside, so that it is known on which side of the outlines it is
_LEAST_STRIP = 0.5  # of the narrowest bead's spacing; thinner strips between loops are left open


@dataclass(frozen=True, slots=True, eq=False)
class Filled:
    """What was made of areas.

    Attributes:
        paths: beads, open or closed, with their widths.
        rest: what they leave.
        lost: (L,) mm² too thin for any bead.
    """

    paths: Toolpaths
    rest: Areas
    lost: Float


def shell(areas: Areas, plan: LayerPlan, profile: Profile, loops: int, *, outermost: bool = True) -> Filled:
    """Loops around areas, of varying width where those are narrow.

    Args:
        areas: clean areas.
        plan: the layers.
        profile: printer and quality.
        loops: how many; none if 0.
        outermost: whether the outlines are contours; else they are where the shares of other beads end, and may be
            simplified; one more bead lies amid all loops where there is room for no more.
    """
    width = bead.layer_widths(plan.n_layers, profile.width_of_first_layer, profile.extrusion_width)
    gap = bead.spacing(width, plan.height)
    varying, amid = profile.quality.varying_walls, not outermost
    least = np.full(plan.n_layers, profile.thinnest_feature) if outermost else _least(plan, profile)
    margin = (width - gap) / 2 if outermost else np.full(plan.n_layers, _HAIR)
    count = _beading(plan, profile, loops=loops, amid=amid, margin=margin, thinnest=least)
    given = areas if varying and (loops or amid) else Areas.empty(plan.n_layers)
    narrow = fill_narrow_places(given, count, 0.0 if outermost else _SIMPLER)
    wide = areas.of_layers(~narrow.layers)
    ordinary, inside, lost = ordinary_loops(wide, width if outermost else gap, gap, loops)
    role = Role.OUTER_PERIMETER if outermost else Role.INNER_PERIMETER
    paths = [_loops(plan, ordinary, width, role), _varying(plan, narrow, role)]
    return Filled(Toolpaths.joined(plan, paths), inside.merge(narrow.inside), lost + narrow.lost)


def fill_narrow(
    areas: Areas, plan: LayerPlan, profile: Profile, *, beads: int = 1, role: Role = Role.INNER_PERIMETER
) -> Filled:
    """Beads of varying width where areas between other beads are too narrow for anything else, and what is left.

    Args:
        areas: clean areas; their outlines are where the shares of the beads around them end.
        plan: the layers.
        profile: printer and quality.
        beads: places with room for more side by side are left.
        role: of the paths.
    """
    hair, least = np.full(plan.n_layers, _HAIR), _least(plan, profile)
    count = _beading(plan, profile, loops=beads // 2, amid=beads % 2 == 1, margin=hair, thinnest=least)
    narrow = fill_narrow_places(areas, count, _SIMPLER)
    rest = areas.of_layers(~narrow.layers).merge(narrow.inside)
    return Filled(_varying(plan, narrow, role, role), rest, narrow.lost)


def _least(plan: LayerPlan, profile: Profile) -> Float:
    """(L,) mm; thinner strips between beads are left open."""
    narrowest = np.maximum(profile.bead_widths[0], plan.height)
    return _LEAST_STRIP * bead.spacing(narrowest, plan.height)


def _beading(
    plan: LayerPlan, profile: Profile, *, loops: int, amid: bool, margin: Float, thinnest: Float
) -> Beading:
    """How many beads lie across an area, by its thickness."""
    height = plan.height
    width = bead.layer_widths(plan.n_layers, profile.width_of_first_layer, profile.extrusion_width)
    spacing = bead.spacing(width, height)
    low, high = profile.bead_widths
    narrowest, widest = (
        bead.spacing(np.maximum(limit, height), height)
        for limit in (np.minimum(low, width), np.maximum(high, width))
    )
    return Beading(loops, amid, spacing, width - spacing, margin, narrowest, widest, thinnest)


def _loops(plan: LayerPlan, loops: list[Areas], width: Float, outermost: Role) -> Toolpaths:
    """One closed path per ring; the deeper ones come first within each layer."""
    layer, role, widths, xy, size = [], [], [], [], []
    for depth, loop in reversed(list(enumerate(loops))):
        layer.append(loop.ring_layer)
        role.append(np.full(loop.n_rings, Role.INNER_PERIMETER if depth else outermost))
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


def _varying(
    plan: LayerPlan, narrow: Narrow, outermost: Role, inner: Role = Role.INNER_PERIMETER
) -> Toolpaths:
    """Loops and lines of varying width, the deeper ones first within each layer."""
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
    order = np.lexsort((-depth, layer))
    (x, y, width), size = reordered((*xy.T, width), size, order)
    return Toolpaths.gathered(
        plan,
        xy=np.column_stack([x, y]),
        size=size,
        layer=layer[order],
        role=np.where(depth[order] > 0, inner, outermost),
        width=width,
        closed=closed[order],
    )
