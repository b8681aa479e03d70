"""Loops and middle beads of areas, whatever lies around them: a contour, or other beads."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from printer_slicer import bead
from printer_slicer.arrays import Bool, Float, Int
from printer_slicer.geometry import Areas, Pieces
from printer_slicer.model import LayerPlan, Toolpaths, reorder_ragged
from printer_slicer.perimeters.beading import Beading
from printer_slicer.perimeters.narrow import Narrow, fill_narrow_places
from printer_slicer.perimeters.ordinary import ordinary_loops
from printer_slicer.perimeters.thinning import kept_points
from printer_slicer.profile import Profile
from printer_slicer.roles import Role

__all__ = ["Filled", "fill_narrow", "fill_pieces", "shell"]

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
    least = np.full(plan.n_layers, profile.thinnest_feature) if outermost else _least(plan.height, profile)
    margin = (width - gap) / 2 if outermost else np.full(plan.n_layers, _HAIR)
    count = _beading((width, plan.height), profile, loops=loops, amid=amid, margin=margin, thinnest=least)
    given = areas if varying and (loops or amid) else Areas.empty(plan.n_layers)
    narrow = fill_narrow_places(given, count, 0.0 if outermost else _SIMPLER)
    wide = areas.of_layers(~narrow.layers)
    ordinary, inside, lost = ordinary_loops(wide, width if outermost else gap, gap, loops)
    role = Role.EXTERNAL_PERIMETER if outermost else Role.PERIMETER
    own = np.arange(plan.n_layers)
    paths = [_loops(plan, ordinary, width, role), _varying(plan, own, narrow, role, Role.PERIMETER)[0]]
    return Filled(Toolpaths.joined(plan, paths), inside.merge(narrow.inside), lost + narrow.lost)


def fill_narrow(
    areas: Areas, plan: LayerPlan, profile: Profile, *, beads: int = 1, role: Role = Role.PERIMETER
) -> Filled:
    """Beads of varying width where areas between other beads are too narrow for anything else, and what is left.

    Args:
        areas: clean areas; their outlines are where the shares of the beads around them end.
        plan: the layers.
        profile: printer and quality.
        beads: places with room for more side by side are left.
        role: of the paths.
    """
    own = np.arange(plan.n_layers)
    narrow = fill_narrow_places(areas, _amid_others(plan, own, profile, beads), _SIMPLER)
    rest = areas.of_layers(~narrow.layers).merge(narrow.inside)
    return Filled(_varying(plan, own, narrow, role, role)[0], rest, narrow.lost)


def fill_pieces(
    pieces: Pieces, role: Int, plan: LayerPlan, profile: Profile, *, beads: int
) -> tuple[Toolpaths, Int]:
    """The same for areas one by one, which may touch each other; `role` (P,) of each is that of its beads.

    Returns:
        The paths, and (M,) the piece that each lies in.
    """
    narrow = fill_narrow_places(pieces.areas, _amid_others(plan, pieces.layer, profile, beads), _SIMPLER)
    return _varying(plan, pieces.layer, narrow, role, role)


def _amid_others(plan: LayerPlan, layer: Int, profile: Profile, beads: int) -> Beading:
    """How many beads lie across areas on layers (E,) between other beads."""
    width = bead.layer_widths(plan.n_layers, profile.width_of_first_layer, profile.extrusion_width)[layer]
    height = plan.height[layer]
    hair, least = np.full(len(layer), _HAIR), _least(height, profile)
    size = width, height
    return _beading(size, profile, loops=beads // 2, amid=beads % 2 == 1, margin=hair, thinnest=least)


def _least(height: Float, profile: Profile) -> Float:
    """(E,) mm; thinner strips between beads are left open."""
    narrowest = np.maximum(profile.bead_widths[0], height)
    return _LEAST_STRIP * bead.spacing(narrowest, height)


def _beading(
    size: tuple[Float, Float], profile: Profile, *, loops: int, amid: bool, margin: Float, thinnest: Float
) -> Beading:
    """How many beads lie across an area, by its thickness; `size` is their usual width and height (E,)."""
    width, height = size
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
        role.append(np.full(loop.n_rings, Role.PERIMETER if depth else outermost))
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
    plan: LayerPlan, home: Int, narrow: Narrow, outermost: int | Int, inner: int | Int
) -> tuple[Toolpaths, Int]:
    """Loops and lines of varying width, the deeper ones first within each entry, and (M,) the entry of each.

    Args:
        plan: the layers.
        home: (E,) ascending, the layer of each entry that was filled.
        narrow: what it was filled with.
        outermost: role of the beads along outlines, of all or (E,) by entry.
        inner: of the others.
    """
    rings, lines = narrow.rings, narrow.lines
    entry = np.concatenate([rings.layer, lines.layer])
    depth = np.concatenate([rings.level, lines.depth])
    size = np.concatenate([rings.size, lines.size])
    xy, width = np.concatenate([rings.xy, lines.xy]), np.concatenate([rings.width, lines.width])
    height = np.repeat(plan.height[home[entry]], size)
    width = np.round(np.maximum(width, height), 3)  # what the file will say
    closed: Bool = np.concatenate([np.ones(len(rings.size), np.bool_), lines.closed])
    kept = kept_points(xy, width, size, closed, _EVEN)
    xy, width, size = (
        xy[kept],
        width[kept],
        np.bincount(np.repeat(np.arange(len(size)), size)[kept], minlength=len(size)),
    )
    order = np.lexsort((-depth, entry))
    (x, y, width), size = reorder_ragged((*xy.T, width), size, order)
    entry = entry[order]
    roles = [np.broadcast_to(role, len(home))[entry] for role in (inner, outermost)]
    paths = Toolpaths.gathered(
        plan,
        xy=np.column_stack([x, y]),
        size=size,
        layer=home[entry],
        role=np.where(depth[order] > 0, *roles),
        width=width,
        closed=closed[order],
    )
    return paths, entry
