"""Columns: supports that stand straight below overhangs, on the bed or on the part."""

from __future__ import annotations

from collections.abc import Sequence
from math import radians, tan
from typing import Final

import numpy as np

from printer_slicer.arrays import consecutive, distinct
from printer_slicer.geometry import (
    Areas,
    close_gaps,
    difference,
    fits_circle,
    intersection,
    normalize,
    offset,
    offset_open,
    simplify,
    split_connected,
    union,
)
from printer_slicer.geometry.layer_union import unite_layers
from printer_slicer.model import LayerPlan, Overhangs, Sections, SupportPlan, Supports, UnsupportedPlace
from printer_slicer.profile import Profile
from printer_slicer.supports.blocked_areas import find_blocked_areas, find_gaps_above
from printer_slicer.supports.interfaces import divide_columns
from printer_slicer.values import Struct

__all__ = ["find_contacts", "make_columns"]

_CONTACT_GROWTHS: Final = (0.2, 1.0)  # mm, least and most by which contacts reach beyond overhangs
_FLAT_GROWTH: Final = 0.1  # mm, the same below horizontal faces, beside which nothing is blocked
_ISLAND_GROWTH: Final = 1.0  # mm; the first layer of an island may be a dot, but its support must not be one
_NEAR_GAP: Final = 0.2  # mm beside layers of the part that end just below or begin just above
_SMOOTHING: Final = 0.5  # mm; narrower bays than twice this are closed where a contact is added
_RESOLUTION: Final = 0.05  # mm of outlines
_SEEN_SMOOTHING: Final = 1.0  # mm; narrower bays than twice this are closed in the outline seen from above
_STRAIGHTENING: Final = 0.15  # mm; less than half an extrusion, so that extrusions lie on each other
_MAX_STEP: Final = 0.35  # mm of an outline from strip to strip below a slope; larger ones stay
_SLIVER: Final = 0.15  # mm; strips narrower than twice this are dropped
_MAX_SLIMNESS: Final = 10.0  # height by width of a column that need not become wider
_WIDE_ENOUGH: Final = 5.0  # mm; wider columns need not become wider
_WIDENING: Final = tan(radians(5.0))  # mm per mm of height
_WIDENING_STEP: Final = 2.0  # mm of height after which a column becomes wider
_NARROW_DEPTH: Final = 0.55  # mm below the contact of a strip, down to which it may become wide enough
_MIN_LOST: Final = 0.5  # mm²; smaller contacts that are lost are rounding
_ROUNDING: Final = 1e-6  # mm
_GROUND_DEPTH: Final = 0.6  # mm below a support layer, up to which the part carries it
_OUTSIDE_BED: Final = "its support would lie outside the bed"
_NOT_ON_BED: Final = "its support would stand on the part"


def make_columns(overhangs: Overhangs, plan: SupportPlan, sections: Sections, profile: Profile) -> Supports:
    """Support overhangs by columns.

    Args:
        overhangs: areas that need supports.
        plan: the layers of supports.
        sections: the part.
        profile: gaps, foot and interfaces of supports, and the bed.
    """
    quality, layers = profile.quality, plan.layers
    if not layers.n_layers:
        none = Areas.empty(0)
        return Supports(plan, none, none, none, none, none)
    gaps = quality.support_bottom_gap, find_gaps_above(plan, quality.support_gap)
    xy_gap = quality.support_xy_gap
    blocked = find_blocked_areas(sections, layers, xy_gap, gaps, min(_NEAR_GAP, xy_gap))
    # Below a slope, the gap beside the layer before takes much of each strip.
    growth = float(np.clip(xy_gap, *_CONTACT_GROWTHS))
    wanted = find_contacts(overhangs, plan, blocked, growth, quality.support_closing)
    contacts = _clip_to_bed(wanted, profile)
    bare = _list_unreached(wanted, contacts, layers, _OUTSIDE_BED)
    columns = _drop_columns(contacts, blocked, layers)
    if quality.support_on_bed_only:
        columns = _keep_above_bed(columns)
        standing = intersection(contacts, columns)
        bare += _list_unreached(contacts, standing, layers, _NOT_ON_BED)
        contacts = standing
    if quality.support_first_layer_expansion:
        columns = _add_foot(columns, blocked, profile)
    base, interface, floor = divide_columns(
        columns, contacts, _find_ground(sections, layers), quality.support_interface_layers
    )
    none = Areas.empty(layers.n_layers)
    return Supports(plan, base, interface, floor, joists=none, hollow=none, unsupported=bare)


def find_contacts(
    overhangs: Overhangs, plan: SupportPlan, blocked: Areas, growth: float, closing: float
) -> Areas:
    """Return the areas by support layer under overhangs, as far as supports may be there.

    They reach `growth` mm beyond overhanging slopes, and less beyond horizontal faces. Gaps within a patch that are
    narrower than twice `closing` are closed.
    """
    n_layers, area = plan.layers.n_layers, overhangs.area
    carrier = plan.carrier[area.ring_layer]
    key = np.where(carrier >= 0, carrier * overhangs.n_patches + overhangs.ring_patch, -1)
    rings = np.argsort(key, kind="stable")
    rings = rings[key[rings] >= 0]
    keys = distinct(key[rings])
    number = np.searchsorted(keys, key[rings])
    entries = normalize(area.restacked(rings, number, len(keys)))
    slopes = np.bincount(number, ~overhangs.is_flat[area.ring_layer[rings]], len(keys))
    growths = np.where(slopes, growth, min(growth, _FLAT_GROWTH))
    grown = offset(offset(entries, growths + closing), -closing) if len(keys) else entries
    contacts = normalize(grown.on_layers(keys // max(overhangs.n_patches, 1), n_layers))
    own = plan.carrier[overhangs.islands.ring_layer]
    order = np.argsort(own, kind="stable")
    order = order[own[order] >= 0]
    islands = offset(normalize(overhangs.islands.restacked(order, own[order], n_layers)), _ISLAND_GROWTH)
    return difference(union(contacts, islands), blocked)


def _find_ground(sections: Sections, layers: LayerPlan) -> Areas:
    """Return all of the part that ends shortly below each support layer, which a support may stand on."""
    top = sections.plan.top
    first = np.searchsorted(top, layers.bottom - _GROUND_DEPTH)
    count = np.searchsorted(top, layers.bottom + _ROUNDING, side="right") - first
    entry = np.repeat(np.arange(layers.n_layers), count)
    return normalize(sections.solid.copy_layers(consecutive(first, count)).on_layers(entry, layers.n_layers))


def _clip_to_bed(areas: Areas, profile: Profile) -> Areas:
    """Return the areas within the bed."""
    low, high = np.array(profile.printer.corners)
    if not areas.n_rings or ((areas.xy >= low).all() and (areas.xy <= high).all()):
        return areas
    n_layers = areas.n_layers
    size = (n_layers, 1)
    bed = Areas.from_boxes(np.tile(low, size), np.tile(high, size), np.arange(n_layers), n_layers)
    return intersection(areas, bed)


class _Column(Struct):
    """The columns of one layer while they are followed down.

    Attributes:
        area: the columns, as a stack of one layer.
        outline: what their outlines are straightened to, as a stack of one layer.
        z: height above which they were made wide enough, mm.
    """

    area: Areas
    outline: Areas
    z: float


def _drop_columns(contacts: Areas, blocked: Areas, layers: LayerPlan) -> Areas:
    """Return the areas of columns below contacts, by support layer.

    Layers without contacts, in which the same is blocked as in the layer above, are as that layer.
    """
    n_layers, used, own = layers.n_layers, contacts.used, blocked.find_first_equal_layers()
    column = _Column(Areas.empty(1), _find_straight_outline(contacts), float(layers.top[-1]))
    entry, chosen, found = np.zeros(n_layers, np.int64), list[int](), list[tuple[Areas, Areas]]()
    for layer in range(n_layers - 1, -1, -1):
        at = np.array([layer])
        changed = used[layer] or (layer + 1 < n_layers and own[layer] != own[layer + 1])
        if used[layer]:
            area = union(column.area, contacts.copy_layers(at))
            column.area = simplify(close_gaps(area, _SMOOTHING), _RESOLUTION)
        wider = column.area.n_rings > 0 and _widen_slim_columns(column, float(layers.bottom[layer]))
        if changed or wider or not found:
            area = difference(column.area, blocked.copy_layers(at))
            column.area = offset_open(area, _SLIVER)
            chosen.append(layer)
            found.append((column.area, column.outline))
            if float((area.area() - column.area.area()).sum()) > _MIN_LOST:
                column.area = union(
                    column.area, intersection(area, _unite_contacts_above(contacts, layer, layers))
                )
        entry[layer] = len(found) - 1
    area, outline = (_stack(areas) for areas in zip(*found, strict=True))
    return _straighten(area, outline, blocked.copy_layers(np.array(chosen))).copy_layers(entry)


def _unite_contacts_above(contacts: Areas, layer: int, layers: LayerPlan) -> Areas:
    """Return the union of the contacts of a layer and of those shortly above it, as a stack of one layer.

    Each strip below a steep slope may be narrower than an extrusion, but several of them are a column.
    """
    last = int(np.searchsorted(layers.top, layers.top[layer] + _NARROW_DEPTH, side="right"))
    recent = contacts.copy_layers(np.arange(layer, last))
    return normalize(recent.on_layers(np.zeros(last - layer, np.int64), 1))


def _stack(areas: Sequence[Areas]) -> Areas:
    """Return stacks of one layer as one stack."""
    return Areas.concatenate(
        [one.on_layers(np.array([layer]), len(areas)) for layer, one in enumerate(areas)], len(areas)
    )


def _find_straight_outline(contacts: Areas) -> Areas:
    """Return the outline of all contacts, seen from above, without the steps between the strips below a slope."""
    seen = unite_layers(contacts)
    closed = close_gaps(seen, _SEEN_SMOOTHING)
    return normalize(simplify(closed, _MAX_STEP))


def _straighten(columns: Areas, outline: Areas, blocked: Areas) -> Areas:
    """Return columns whose edges lie on straight outlines, where they are near them.

    Strips below a slope end at slightly different places, so the outline of many of them has teeth. The nozzle would
    stop at each of them.
    """
    straight = intersection(offset(columns, _MAX_STEP), outline)
    closed = close_gaps(straight, _SEEN_SMOOTHING)
    return offset_open(difference(simplify(closed, _STRAIGHTENING), blocked), _SLIVER)


def _widen_slim_columns(column: _Column, z: float) -> bool:
    """Make columns wider that are too slim for their height; return whether any became wider."""
    if column.z - z < _WIDENING_STEP:
        return False
    step, column.z = column.z - z, z
    pieces = split_connected(column.area)
    slim = ~fits_circle(pieces.areas, min(z / _MAX_SLIMNESS, _WIDE_ENOUGH) / 2)
    if not slim.any():
        return False
    wider = offset(pieces.on_layers(1, np.flatnonzero(slim)), step * _WIDENING)
    column.area = union(wider, pieces.on_layers(1, np.flatnonzero(~slim)))
    column.outline = union(column.outline, wider)
    return True


def _add_foot(columns: Areas, blocked: Areas, profile: Profile) -> Areas:
    """Return the columns with a wider first layer."""
    first, rest = columns.of_layers(np.arange(1)), columns.of_layers(np.arange(1, columns.n_layers))
    foot = offset(first, profile.quality.support_first_layer_expansion, join="round")
    foot = _clip_to_bed(difference(foot, blocked.of_layers(np.arange(1))), profile)
    return foot.merge(rest)


def _keep_above_bed(columns: Areas) -> Areas:
    """Return the parts of the columns that stand on the bed."""
    own, n_layers = columns.find_first_equal_layers(), columns.n_layers
    standing = columns.copy_layers(np.array([0]))
    result = [standing.on_layers(np.array([0]), n_layers)]
    for layer in range(1, n_layers):
        at = np.array([layer])
        if own[layer] != own[layer - 1]:
            standing = offset_open(intersection(columns.copy_layers(at), standing), _SLIVER)
        result.append(standing.on_layers(at, n_layers))
    return Areas.concatenate(result, n_layers)


def _list_unreached(
    wanted: Areas, left: Areas, layers: LayerPlan, reason: str
) -> tuple[UnsupportedPlace, ...]:
    """List the contacts that get no support."""
    lost = split_connected(offset_open(difference(wanted, left), _SLIVER))
    area, (low, high) = lost.areas.area(), lost.areas.boxes()
    middle, z = ((low + high) / 2).tolist(), layers.top[lost.layer].tolist()
    large = np.flatnonzero(area > _MIN_LOST).tolist()
    return tuple(UnsupportedPlace(middle[i][0], middle[i][1], z[i], float(area[i]), reason) for i in large)
