"""Trees: branches that grow from the bed, or from the part, to the tips under overhangs."""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Float, Int, consecutive
from printer_slicer.geometry import (
    Areas,
    difference,
    intersection,
    normalize,
    offset,
    offset_open,
    split_connected,
    union,
)
from printer_slicer.geometry.boxes import Boxes
from printer_slicer.geometry.vectors import norm
from printer_slicer.model import Overhangs, Sections, SupportPlan, Supports, UnsupportedPlace
from printer_slicer.profile import Profile
from printer_slicer.supports.blocked_areas import find_blocked_areas, find_gaps_above
from printer_slicer.supports.branch_growth import grow_branches
from printer_slicer.supports.branches import draw_branches, draw_discs, find_closed_discs, round_notches
from printer_slicer.supports.first_segments import FirstSegments, choose_first_segments
from printer_slicer.supports.reach_fields import ReachFields, build_fields
from printer_slicer.supports.roofs import (
    Roofs,
    build_roofs,
    find_shortest_lines,
    find_wide_contacts,
    keep_carried_roofs,
    place_joists,
)
from printer_slicer.supports.smoothing import smooth_branches
from printer_slicer.supports.tips import (
    LOWEST_TIP,
    REACH_IN_Z,
    Tips,
    choose_tips,
    choose_unreached_places,
    join_tips,
    list_island_tips,
    list_joist_tips,
    list_strip_places,
)
from printer_slicer.supports.tree_settings import TreeSettings, read_tree_settings
from printer_slicer.supports.unsupported_places import explain_no_way

__all__ = ["grow_trees"]

_CONTACT_GROWTH = 0.2  # mm, least by which contacts reach beyond the overhang
_MIN_LEFT = 0.5  # of the area that hangs in a layer
_BESIDE_ROOF = 1.0  # mm; strips this near to a roof need no tips
_ATTEMPTS = 5  # rounds of tips, of which the first one is for islands
_MIN_BOTTOM_GAP = (
    0.5  # of the gap; the layers are not planned for ends on the part, which must not be too far above it
)
_NOTCH = 0.15  # mm, smallest radius of corners between branches that touch
_MIN_WIDTH = 0.4  # extrusion widths; narrower rests of branches are left out


def grow_trees(overhangs: Overhangs, plan: SupportPlan, sections: Sections, profile: Profile) -> Supports:
    """Support overhangs by trees.

    Wide overhangs get a roof that lies on joists. Branches begin under joists and under narrow strips, avoid the part,
    become one where they can, and end on the bed, or on the part where that saves much of the way.

    Args:
        overhangs: areas that need supports.
        plan: the layers of supports.
        sections: the part.
        profile: the settings.
    """
    layers, n = plan.layers, plan.layers.n_layers
    empty = Areas.empty(n)
    if not n:
        return Supports(plan, empty, empty, empty, empty, empty)
    settings = read_tree_settings(profile, float(layers.height.max()), float(layers.top[-1]))
    gaps = _MIN_BOTTOM_GAP * settings.bottom_gap, find_gaps_above(plan, settings.gap)
    blocked = find_blocked_areas(sections, layers, settings.xy_gap, gaps, settings.near_gap)
    bed = np.array(profile.printer.corners[0]), np.array(profile.printer.corners[1])
    fields = build_fields(sections, float(layers.top[-1]), bed, settings)
    strips, islands = (
        _find_contacts(area, plan.carrier, blocked, settings) for area in (overhangs.area, overhangs.islands)
    )
    roofs, tips, starts = _plan_roofs(strips, plan, blocked, (fields, sections, settings))
    covered = offset(roofs.contact, _BESIDE_ROOF).copy_layers(np.maximum(plan.carrier, 0))
    rest = difference(strips, covered), difference(islands, covered)
    tips, starts, bare = _plan_tips(rest, (tips, starts), overhangs, plan, (fields, sections, settings))
    forest = smooth_branches(grow_branches(tips.place, starts, fields, settings), fields, settings)
    base = draw_branches(forest.pieces, forest.piece_heights, layers, settings)
    others = roofs.roof.merge(roofs.joist)
    base = _trim_branches(base, blocked, others, settings.width)
    hollow, closed = _find_hollow(base, settings)
    interface = roofs.roof.merge(closed)
    angle = np.append(roofs.find_line_angles(), find_shortest_lines(closed))
    order = np.argsort(np.append(roofs.roof.ring_layer, closed.ring_layer), kind="stable")
    return Supports(
        plan,
        base=difference(base, closed),
        interface=interface,
        floor=empty,
        joists=roofs.joist,
        hollow=hollow,
        branches=forest.pieces,
        unsupported=bare,
        interface_angle=angle[order],
    )


def _trim_branches(base: Areas, blocked: Areas, roofs: Areas, width: float) -> Areas:
    """Return branches without what is blocked, without roofs, and without rests too small for a loop.

    Notches between branches that touch are rounded, except near what is blocked.
    """
    pieces = split_connected(base)
    near = Boxes(*pieces.areas.boxes(), pieces.layer).touches_any(Boxes.of_rings(blocked.merge(roofs)))
    touched, free = (pieces.on_layers(base.n_layers, np.flatnonzero(which)) for which in (near, ~near))
    rest = offset_open(difference(difference(touched, blocked), roofs), _MIN_WIDTH * width)
    rests = split_connected(rest)
    large = rests.on_layers(base.n_layers, np.flatnonzero(rests.areas.area() >= width**2))
    return union(round_notches(free, _NOTCH), large)


def _find_hollow(base: Areas, settings: TreeSettings) -> tuple[Areas, Areas]:
    """Return where branches are printed as loops, and where closed layers, because a loop above would be unsupported.

    In the lowest layer, there are loops in the middle of each foot, below those of the next layer.
    """
    above_bed = base.of_layers(np.arange(1, base.n_layers))
    on_bed = intersection(base.of_layers(np.arange(1)), _find_next(above_bed))
    closed = find_closed_discs(Areas.merged([on_bed, above_bed]), settings.width)
    above_bed = difference(above_bed, closed)
    closed = closed.of_layers(np.arange(1, base.n_layers))  # feet are filled with lines anyway
    on_bed = intersection(on_bed, _find_next(above_bed))
    return Areas.merged([on_bed, above_bed]), closed


def _find_next(areas: Areas) -> Areas:
    """Return the areas of the second layer as those of the lowest one."""
    return areas.shift_layers(-1).of_layers(np.arange(1))


_Room = tuple[ReachFields, Sections, TreeSettings]


def _find_contacts(area: Areas, carrier: Int, blocked: Areas, settings: TreeSettings) -> Areas:
    """Return the areas under overhangs by layer of the part, as far as supports may be there.

    Below a slope, the gap beside the layer before takes much of each strip. Layers that lose more than half of their
    area get contacts that reach farther beyond the overhang.
    """
    area = area.of_layers(carrier >= 0)
    not_here = blocked.copy_layers(np.maximum(carrier, 0))
    contacts = difference(offset(area, _CONTACT_GROWTH), not_here)
    lost = contacts.area() < _MIN_LEFT * area.area()
    if not lost.any():
        return contacts
    more = difference(offset(area.of_layers(lost), settings.xy_gap), not_here.of_layers(lost))
    return union(contacts.of_layers(~lost), more)


def _plan_roofs(
    strips: Areas, plan: SupportPlan, blocked: Areas, room: _Room
) -> tuple[Roofs, Tips, FirstSegments]:
    """Return the roofs that branches can carry, their tips, and the first segments of the branches."""
    fields, sections, settings = room
    wide = find_wide_contacts(strips, plan.carrier, plan.layers.n_layers)
    # Joists lie some layers lower, where the part may be in the way.
    room_below = difference(wide, blocked.shift_layers(settings.interface_layers))
    joists = place_joists(offset_open(room_below, settings.width), settings)
    tips = list_joist_tips(joists, plan.layers.top, settings.interface_layers)
    starts = choose_first_segments(tips.place, fields, sections, settings)
    carried = np.ones(len(joists.of_tip), np.bool_)
    carried[tips.of_joist] = starts.found
    return build_roofs(wide, keep_carried_roofs(joists, carried, settings), blocked, settings), tips, starts


def _plan_tips(
    rest: tuple[Areas, Areas],
    given: tuple[Tips, FirstSegments],
    overhangs: Overhangs,
    plan: SupportPlan,
    room: _Room,
) -> tuple[Tips, FirstSegments, tuple[UnsupportedPlace, ...]]:
    """Add tips under strips and islands, by layer of the part, to those under joists.

    Where no branch reaches a tip, others are tried beside it.

    Returns:
        All tips, the first segments of the branches, and the places that stay without a tip.
    """
    (strips, islands), (tips, starts) = rest, given
    fields, sections, settings = room
    places = list_strip_places(strips, overhangs, plan, settings)
    new = list_island_tips(islands, plan.carrier, plan.layers.top)
    for _ in range(_ATTEMPTS):
        tips = join_tips([tips, new])
        starts = FirstSegments.joined([starts, choose_first_segments(new.place, fields, sections, settings)])
        new = choose_tips(places, tips, starts.found)
        if not new.count:
            break
    bare = choose_unreached_places(places, tips, starts.found)
    reason = explain_no_way(on_bed_only=settings.on_bed_only)
    return tips, starts, _describe_unreached(bare, tips.take(starts.found), strips, plan, reason)


def _describe_unreached(
    bare: Tips, tips: Tips, strips: Areas, plan: SupportPlan, reason: str
) -> tuple[UnsupportedPlace, ...]:
    """Return the places that no branch reaches.

    Args:
        bare: these places.
        tips: those that branches reach.
        strips: areas under overhangs by layer of the part.
        plan: of the supports.
        reason: why no branch reaches them.
    """
    area = _measure_unreached(bare, tips, strips, plan) if bare.count else np.zeros(0)
    rows = zip(bare.place.tolist(), area.tolist(), bare.island.tolist(), strict=True)
    return tuple(UnsupportedPlace(x, y, z, size, reason, is_island) for (x, y, z), size, is_island in rows)


def _measure_unreached(bare: Tips, tips: Tips, strips: Areas, plan: SupportPlan) -> Float:
    """Return the area (B,) of the strips around each unsupported place that have no tip near them, mm²."""
    used = np.flatnonzero(strips.used & (plan.carrier >= 0))
    z = plan.layers.top[plan.carrier[used]]
    reach = float(max(bare.reach.max(), tips.reach.max(initial=0.0)))
    first, last = (np.searchsorted(z, tips.place[:, 2] + by) for by in (-REACH_IN_Z, LOWEST_TIP))
    count = np.maximum(last - first, 0)
    tip, layer = np.repeat(np.arange(tips.count), count), consecutive(first, count)
    order = np.argsort(layer, kind="stable")
    near = draw_discs(tips.place[tip[order], :2], np.full(len(tip), reach), layer[order], len(used))
    pieces = split_connected(difference(strips.copy_layers(used), normalize(near)))
    low, high = pieces.areas.boxes()
    middle = np.column_stack([(low + high) / 2, z[pieces.layer]])
    nearest = np.argmin(norm(bare.place[:, None] - middle), axis=0)
    return np.asarray(np.bincount(nearest, pieces.areas.area(), minlength=bare.count), np.float64)
