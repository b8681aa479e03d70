"""Make loops and middle lines in areas, inside a contour or between other extrusions."""

from __future__ import annotations

import numpy as np

from printer_slicer import bead
from printer_slicer.arrays import Bool, Float, Int, consecutive
from printer_slicer.geometry import Areas, ConnectedAreas
from printer_slicer.model import LayerPlan, Toolpaths, reorder_ragged
from printer_slicer.perimeters.beading import Beading
from printer_slicer.perimeters.fixed_width import fixed_width_loops
from printer_slicer.perimeters.simplification import points_to_keep
from printer_slicer.perimeters.variable_width import NarrowFill, fill_narrow_areas
from printer_slicer.profile import Profile
from printer_slicer.roles import Role
from printer_slicer.values import Struct

__all__ = ["FillResult", "fill_narrow", "fill_pieces", "make_loops"]

_BORDER_TOLERANCE = 0.025  # mm; borders between extrusions are hidden and may be simplified by this
_POINT_TOLERANCE = 0.004  # mm, tolerance of removed points
_INSET = 1e-3  # mm; remaining areas lie this far inside, so that rounding cannot move them over the outlines
_MIN_STRIP_RATIO = 0.5  # of the narrowest spacing; thinner strips between loops stay empty


class FillResult(Struct, frozen=True, eq=False):
    """The result of filling areas.

    Attributes:
        paths: open or closed paths, with their widths.
        rest: the remaining areas.
        lost: (L,) mm² that are too thin for any extrusion.
    """

    paths: Toolpaths
    rest: Areas
    lost: Float


def make_loops(
    areas: Areas, plan: LayerPlan, profile: Profile, loops: int, *, outermost: bool = True
) -> FillResult:
    """Make loops around areas, of variable width where these are narrow; equal layers are computed once.

    Args:
        areas: clean areas.
        plan: the layers.
        profile: printer and quality.
        loops: number of loops.
        outermost: whether the outlines are contours. If not, they are borders of other extrusions and may be
            simplified, and one more line is placed between all loops where it fits.
    """
    width = bead.layer_widths(plan.n_layers, profile.width_of_first_layer, profile.extrusion_width)
    first = areas.find_first_equal_layers(width, plan.height)
    areas = areas.of_layers(first)
    gap = bead.spacing(width, plan.height)
    varying, has_middle = profile.quality.varying_walls, not outermost
    least = (
        np.full(plan.n_layers, profile.thinnest_feature)
        if outermost
        else _least_thickness(plan.height, profile)
    )
    margin = (width - gap) / 2 if outermost else np.full(plan.n_layers, _INSET)
    count = _make_beading(
        (width, plan.height), profile, loops=loops, has_middle=has_middle, margin=margin, thinnest=least
    )
    given = areas if varying and (loops or has_middle) else Areas.empty(plan.n_layers)
    narrow = fill_narrow_areas(given, count, 0.0 if outermost else _BORDER_TOLERANCE)
    wide = areas.of_layers(~narrow.layers)
    ordinary, inside, lost = fixed_width_loops(wide, width if outermost else gap, gap, loops)
    role = Role.EXTERNAL_PERIMETER if outermost else Role.PERIMETER
    own = np.arange(plan.n_layers)
    paths = [
        _make_loop_paths(plan, ordinary, width, role),
        _make_varying_paths(plan, own, narrow, role, Role.PERIMETER)[0],
    ]
    result = FillResult(Toolpaths.joined(plan, paths), inside.merge(narrow.inside), lost + narrow.lost)
    return result if (first == own).all() else _copy_layers(result, first)


def _copy_layers(made: FillResult, source: Int) -> FillResult:
    """Give each layer the result of the layer `source` (L,), which has the same height."""
    paths, layers = made.paths, np.arange(len(source))
    bounds = np.searchsorted(paths.layer, np.append(layers, len(source)))
    count = np.diff(bounds)[source]
    chosen = consecutive(bounds[source], count)
    (xy, width), size = reorder_ragged((paths.xy, paths.width), np.diff(paths.start), chosen)
    copies = Toolpaths.gathered(
        paths.plan,
        xy=xy,
        size=size,
        layer=np.repeat(layers, count),
        role=paths.role[chosen],
        width=width,
        closed=paths.closed[chosen],
    )
    return FillResult(copies, made.rest.copy_layers(source), made.lost[source])


def fill_narrow(
    areas: Areas, plan: LayerPlan, profile: Profile, *, beads: int = 1, role: Role = Role.PERIMETER
) -> FillResult:
    """Fill the narrow places of areas that lie between other extrusions, with extrusions of variable width.

    Args:
        areas: clean areas; their outlines are the borders of the extrusions around them.
        plan: the layers.
        profile: printer and quality.
        beads: most extrusions side by side; wider places remain.
        role: role of the paths.
    """
    own = np.arange(plan.n_layers)
    narrow = fill_narrow_areas(areas, _beading_between(plan, own, profile, beads), _BORDER_TOLERANCE)
    rest = areas.of_layers(~narrow.layers).merge(narrow.inside)
    return FillResult(_make_varying_paths(plan, own, narrow, role, role)[0], rest, narrow.lost)


def fill_pieces(
    pieces: ConnectedAreas, role: Int, plan: LayerPlan, profile: Profile, *, beads: int
) -> tuple[Toolpaths, Int]:
    """Fill pieces as `fill_narrow` fills areas; pieces may touch each other, and each has its own role (P,).

    Returns:
        The paths, and the piece (M,) of each path.
    """
    narrow = fill_narrow_areas(
        pieces.areas, _beading_between(plan, pieces.layer, profile, beads), _BORDER_TOLERANCE
    )
    return _make_varying_paths(plan, pieces.layer, narrow, role, role)


def _beading_between(plan: LayerPlan, layer: Int, profile: Profile, beads: int) -> Beading:
    """Return the beading of areas on layers (E,) that lie between other extrusions."""
    width = bead.layer_widths(plan.n_layers, profile.width_of_first_layer, profile.extrusion_width)[layer]
    height = plan.height[layer]
    hair, least = np.full(len(layer), _INSET), _least_thickness(height, profile)
    size = width, height
    return _make_beading(
        size, profile, loops=beads // 2, has_middle=beads % 2 == 1, margin=hair, thinnest=least
    )


def _least_thickness(height: Float, profile: Profile) -> Float:
    """Return the thickness (E,) of the thinnest strips to fill, mm."""
    narrowest = np.maximum(profile.bead_widths[0], height)
    return _MIN_STRIP_RATIO * bead.spacing(narrowest, height)


def _make_beading(
    size: tuple[Float, Float],
    profile: Profile,
    *,
    loops: int,
    has_middle: bool,
    margin: Float,
    thinnest: Float,
) -> Beading:
    """Make the rules for the number of beads by thickness; `size` holds the usual width and height (E,) of beads."""
    width, height = size
    spacing = bead.spacing(width, height)
    low, high = profile.bead_widths
    narrowest, widest = (
        bead.spacing(np.maximum(limit, height), height)
        for limit in (np.minimum(low, width), np.maximum(high, width))
    )
    return Beading(loops, has_middle, spacing, width - spacing, margin, narrowest, widest, thinnest)


def _make_loop_paths(plan: LayerPlan, loops: list[Areas], width: Float, outermost: Role) -> Toolpaths:
    """Return one closed path per ring; inner loops come first within each layer."""
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


def _make_varying_paths(
    plan: LayerPlan, entry_layer: Int, narrow: NarrowFill, outermost: int | Int, inner: int | Int
) -> tuple[Toolpaths, Int]:
    """Return loops and lines of variable width, inner ones first in each entry, and the entry (M,) of each path.

    Args:
        plan: the layers.
        entry_layer: (E,) ascending, layer of each filled entry.
        narrow: the loops and lines.
        outermost: role of the loops along outlines, one or (E,).
        inner: role of the other loops and of lines, one or (E,).
    """
    rings, lines = narrow.rings, narrow.lines
    entry = np.concatenate([rings.layer, lines.layer])
    depth = np.concatenate([rings.level, lines.depth])
    size = np.concatenate([rings.size, lines.size])
    xy, width = np.concatenate([rings.xy, lines.xy]), np.concatenate([rings.width, lines.width])
    height = np.repeat(plan.height[entry_layer[entry]], size)
    width = np.round(np.maximum(width, height), 3)  # as written to the file
    closed: Bool = np.concatenate([np.ones(len(rings.size), np.bool_), lines.closed])
    kept = points_to_keep(xy, width, size, closed, _POINT_TOLERANCE)
    xy, width, size = (
        xy[kept],
        width[kept],
        np.bincount(np.repeat(np.arange(len(size)), size)[kept], minlength=len(size)),
    )
    order = np.lexsort((-depth, entry))
    (x, y, width), size = reorder_ragged((*xy.T, width), size, order)
    entry = entry[order]
    roles = [np.broadcast_to(role, len(entry_layer))[entry] for role in (inner, outermost)]
    paths = Toolpaths.gathered(
        plan,
        xy=np.column_stack([x, y]),
        size=size,
        layer=entry_layer[entry],
        role=np.where(depth[order] > 0, *roles),
        width=width,
        closed=closed[order],
    )
    return paths, entry
