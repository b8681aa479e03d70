"""Divide the area inside the perimeters into regions by their distance from the surfaces above and below.

Shell thicknesses are in mm. With layers of different heights, the layers within a shell thickness are a range of z with
a different number of layers for each layer. Their common area comes from a table of intersections over 1, 2, 4, ...
layers.

On a slope the perimeters of the next layers move inward. If they move by more than their depth, the step between them
must be closed. So internal infill is only what is inside the perimeters on this layer and on the layers where the shell
thickness ends, above and below. The shell then keeps its thickness across a slope of any angle t to the bed: a point
`thickness` below one that is `depth` inside the face is depth sin t + thickness cos t away from the face. On steep
slopes this makes solid strips of thickness / tan t beside the perimeters, which alone are depth sin t thick there.
Strips are left out where the perimeters alone reach the fraction `slope_shell_ratio` of the smaller of thickness and
depth, and where strips are narrower than half an extrusion. With a ratio of 0, thickness is only measured vertically,
and the shell of a 45° slope is depth sin t thick.
"""

from __future__ import annotations

import numpy as np

from printer_slicer import bead
from printer_slicer.arrays import Bool, Float, Int
from printer_slicer.bridges import find_bridges, find_internal_bridges
from printer_slicer.geometry import (
    difference,
    intersection,
    offset,
    offset_open,
    split_connected,
    union,
    window_intersection,
    window_intersections,
)
from printer_slicer.layer_settings import LayerSettings, resolve_layer_settings
from printer_slicer.model import Areas, LayerPlan, Regions, Sections, Walls
from printer_slicer.profile import Profile
from printer_slicer.values import Struct

__all__ = ["classify"]

_SMALLEST = 1e-6  # mm; heights that differ by less are equal
_DOT = 5.0  # squared extrusion widths
_NARROW = 3.0  # extrusion widths; narrower strips of internal infill contain only dots


def classify(sections: Sections, walls: Walls, profile: Profile) -> Regions:
    """Divide the area inside the perimeters into regions.

    A point becomes solid infill if the part ends within `quality.top_thickness` above or `quality.bottom_thickness`
    below it, or if the area around it is too small for internal infill. The bed counts as a surface.
    """
    plan, inside, solid = sections.plan, walls.inside, sections.solid
    rules, width = _RegionSettings.from_layers(resolve_layer_settings(profile, plan)), walls.width
    near, (open_above, open_below) = _find_exposed_areas(sections, inside, rules)
    shell = _find_shell(walls, near, rules)
    supporting, infill = _take_layer_below(solid), difference(inside, shell)
    if rules.empty.any():
        hollow = _take_layer_below(infill.of_layers(rules.empty))
        # Nothing can stand on hollow areas, not even internal infill.
        lid = intersection(shell.of_layers(rules.empty).merge(inside.of_layers(~rules.empty)), hollow)
        supporting, open_below = difference(supporting, hollow), union(open_below, lid)
        infill = difference(infill, lid)
    down = _grow_areas(open_below, inside, width, rules.anchor)
    on_bed, overhanging = down.select(down.ring_layer == 0), down.select(down.ring_layer > 0)
    bridges = find_bridges(
        offset_open(open_below, width / 4), overhanging, supporting, width, (rules.anchor, rules.angle)
    )
    down = on_bed.merge(bridges.unite_areas())
    up = difference(_grow_areas(open_above, inside, width, 2 * width), down)
    infill, scraps = _split_usable_infill(difference(infill, down.merge(up)), width, rules)
    scraps = _select_scraps_over_infill(scraps, _take_layer_below(infill)).merge(
        _select_narrow_pieces(difference(overhanging, down.merge(up).merge(infill)), width)
    )
    bridges = bridges.add_scraps(split_connected(scraps), width / 4)
    open_to_air = on_bed.merge(bridges.unite_areas()).merge(up)
    covered = difference(inside, infill.merge(open_to_air))
    internal = find_internal_bridges(covered, _take_layer_below(infill), width, rules.anchor)
    bridge, angle = bridges.place_on_layers()
    return Regions(
        plan,
        bottom_solid_infill=on_bed,
        bridge=bridge,
        top_solid_infill=up,
        # A disc on a smaller one is not bridged: bridge lines would end unsupported. Solid infill bonds below.
        solid_infill=union(difference(covered, internal), bridges.loose),
        internal_infill=infill,
        bridge_angle=angle,
        internal_bridge=internal,
        inside=inside,
    )


class _RegionSettings(Struct, frozen=True, eq=False):
    """Settings of the regions for each layer (L,), in mm, mm², ratios and counts.

    Attributes:
        full: whether the inside is all solid.
        empty: whether everything except the shell stays empty.
    """

    full: Bool
    empty: Bool
    top: Float
    bottom: Float
    slope: Float
    smallest: Float
    perimeters: Float
    anchor: Float
    angle: Float

    @classmethod
    def from_layers(cls, layered: LayerSettings) -> _RegionSettings:
        """Read the settings of the regions from the profile of each layer."""
        density = layered.values(lambda profile: profile.quality.infill_density)
        return cls(
            density >= 1,
            density == 0,
            layered.values(lambda profile: profile.quality.top_thickness),
            layered.values(lambda profile: profile.quality.bottom_thickness),
            layered.values(lambda profile: profile.quality.slope_shell_ratio),
            layered.values(lambda profile: profile.quality.solid_infill_below_area),
            layered.values(lambda profile: profile.quality.perimeters),
            layered.values(lambda profile: profile.quality.bridge_anchor),
            np.deg2rad(layered.values(lambda profile: profile.quality.infill_angle_deg)),
        )


def _find_exposed_areas(
    sections: Sections, inside: Areas, rules: _RegionSettings
) -> tuple[tuple[Areas, Areas], tuple[Areas, Areas]]:
    """Return the areas near a surface (above, below), and the areas directly at a surface (above, below).

    On layers that are all solid, the first pair is not needed and equals the second.
    """
    plan = sections.plan
    top, bottom = rules.top, rules.bottom
    beside = np.minimum(top, _SMALLEST), np.minimum(bottom, _SMALLEST)
    windows = [_find_window_above(plan, beside[0]), _find_window_below(plan, beside[1])]
    if not rules.full.all():
        top, bottom = (np.where(rules.full, *pair) for pair in zip(beside, (top, bottom), strict=True))
        windows += [_find_window_above(plan, top), _find_window_below(plan, bottom)]
    own = np.arange(plan.n_layers)
    idle = [last <= first for first, last in windows]
    covers = window_intersections(
        sections.solid,
        [
            (np.where(none, own, first), np.where(none, own + 1, last))
            for none, (first, last) in zip(idle, windows, strict=True)
        ],
    )
    missing: list[Areas] = []
    for none, cover in reversed(list(zip(idle, covers, strict=True))):
        # A layer without a surface within the shell thickness has none directly beside it.
        some = ~none if len(missing) < 2 else missing[-2].used
        missing.append(difference(inside.of_layers(some), cover.of_layers(some)))
    above, below = missing[-1], missing[-2]
    near_above = missing[1]
    if sections.below_cut is not None and not rules.full.all():
        near_above = union(near_above, _find_areas_below_contours(sections.below_cut, inside, plan, top))
    return (near_above, missing[0]), (above, below)


def _find_areas_below_contours(below_cut: Areas, inside: Areas, plan: LayerPlan, thickness: Float) -> Areas:
    """Return the areas of each layer where the shell ends in a layer that contoured extrusions fill below its cut.

    There the surface is as near as where a flat layer would have no area. `thickness` (L,) is that of the shell, mm.
    """
    end = np.searchsorted(plan.bottom, plan.top + thickness - _SMALLEST / 2) - 1
    within = (end < plan.n_layers) & (thickness > _SMALLEST)
    ends = below_cut.copy_layers(np.where(within, end, 0))
    return intersection(inside.of_layers(within), ends.of_layers(within))


def _find_shell(walls: Walls, near: tuple[Areas, Areas], rules: _RegionSettings) -> Areas:
    """Return the areas that must be solid to close surfaces and slopes; on fully solid layers, the whole inside."""
    if rules.full.all():
        return walls.inside
    shell = offset_open(union(*near), walls.width / 4)
    if (rules.slope > 0).any():
        shell = union(shell, union(*_find_slope_areas(walls, rules)))
    dotted = rules.empty | (rules.smallest == 0)
    if not dotted.all():
        shell = _remove_tiny_pieces(shell.of_layers(~dotted), walls.width).merge(shell.of_layers(dotted))
    return walls.inside.of_layers(rules.full).merge(shell.of_layers(~rules.full))


def _find_slope_areas(walls: Walls, rules: _RegionSettings) -> tuple[Areas, Areas]:
    """Return the parts of the inside that perimeters cover on the layers where the shell ends, above and below."""
    plan, inside, sloped = walls.plan, walls.inside, rules.slope > 0
    above = _find_window_above(plan, rules.top)
    below = _find_window_below(plan, rules.bottom)
    own = np.arange(plan.n_layers)
    highest = np.where(sloped, np.maximum(np.minimum(above[1], plan.n_layers) - 1, own), own)
    lowest = np.where(sloped, np.minimum(np.maximum(below[0], 0), own), own)
    # A slope continues through all layers between, so the farthest layer decides.
    over, under = (
        offset_open(
            _subtract_layer(inside, at),
            _compute_unneeded_width(walls, rules, thickness, np.abs(plan.cut[at] - plan.cut)) / 2,
        )
        for at, thickness in ((highest, rules.top), (lowest, rules.bottom))
    )
    return over, under


def _remove_tiny_pieces(shell: Areas, width: Float) -> Areas:
    """Remove tiny pieces of the shell, which occur on faceted slopes where solid strips end.

    Such pieces are useless beside internal infill. Areas too small for internal infill become solid anyway.
    """
    pieces = split_connected(shell)
    large = pieces.areas.area() >= _DOT * width[pieces.layer] ** 2
    return pieces.on_layers(shell.n_layers, np.flatnonzero(large))


def _subtract_layer(inside: Areas, at: Int) -> Areas:
    """Return the inside of each layer minus the inside of the layer `at` (L,)."""
    other = at != np.arange(inside.n_layers)
    cover = window_intersection(inside, at, at + 1)
    return difference(inside.of_layers(other), cover.of_layers(other))


def _compute_unneeded_width(
    walls: Walls, rules: _RegionSettings, thickness: Float, section_distance: Float
) -> Float:
    """Return the width (L,) of solid strips beside the perimeters that can be left out, mm.

    Such strips come from slopes so steep that the perimeters alone are thick enough: the strip is thickness / tan t
    wide, the perimeters are depth sin t thick. Real steps are wider than these strips. `section_distance` (L,) is
    the distance between the sections at both ends of the shell thickness, mm.
    """
    half = walls.width / 2
    gap = bead.spacing(walls.width, walls.plan.height)
    depth = np.where(rules.perimeters > 0, half + (rules.perimeters - 0.5) * gap, 0.0)
    promised = np.maximum(rules.slope * np.minimum(thickness, depth), 1e-9)
    steep = section_distance * np.sqrt(np.maximum((depth / promised) ** 2 - 1, 0))
    return np.clip(steep, half, np.maximum(depth, half))


def _split_usable_infill(infill: Areas, width: Float, rules: _RegionSettings) -> tuple[Areas, Areas]:
    """Split internal infill into usable areas, and scraps that are too small or too narrow for infill."""
    as_they_are = rules.empty | (rules.smallest == 0)
    if as_they_are.all():
        return infill, Areas.empty(infill.n_layers)
    untouched, infill = infill.of_layers(as_they_are), infill.of_layers(~as_they_are)
    # Opening cuts off sharp corners; parts narrower than an extrusion stay there.
    narrow = offset_open(difference(infill, offset_open(infill, _NARROW / 2 * width)), width / 3)
    pieces = split_connected(difference(infill, narrow))
    large = pieces.areas.area() >= rules.smallest[pieces.layer]
    kept = pieces.on_layers(infill.n_layers, np.flatnonzero(large))
    return kept.merge(untouched), difference(infill, kept)


def _select_scraps_over_infill(scraps: Areas, infill: Areas) -> Areas:
    """Return the scraps that lie mostly over internal infill; as solid infill they would be unsupported."""
    pieces = split_connected(scraps)
    area = intersection(pieces.areas, pieces.select_nearby_rings(infill)).area()
    return pieces.on_layers(scraps.n_layers, np.flatnonzero(area > pieces.areas.area() / 2))


def _select_narrow_pieces(beside: Areas, width: Float) -> Areas:
    """Return the pieces that are too narrow for two extrusions side by side."""
    pieces = split_connected(beside)
    slim = pieces.mean_width() < 2 * width[pieces.layer]
    return pieces.on_layers(beside.n_layers, np.flatnonzero(slim))


def _take_layer_below(solid: Areas) -> Areas:
    """Return for each layer the area of the layer below; empty for the first layer."""
    own = np.arange(solid.n_layers)
    return window_intersection(solid, own - 1, own)


def _find_window_above(plan: LayerPlan, thickness: Float) -> tuple[Int, Int]:
    """Return for each layer the range of layers within `thickness` (L,) above it; empty if the thickness is 0."""
    first = np.arange(plan.n_layers) + 1
    last = np.searchsorted(plan.bottom, plan.top + thickness - _SMALLEST / 2)
    # Layers near the top get a window that extends beyond the stack, because there is air above the last layer.
    near_top = plan.top + thickness - _SMALLEST / 2 > plan.top[-1]
    return first, np.where(near_top & (thickness > 0), plan.n_layers + 1, last).astype(np.int64)


def _find_window_below(plan: LayerPlan, thickness: Float) -> tuple[Int, Int]:
    """Return for each layer the range of layers within `thickness` (L,) below it; -1 stands for the bed."""
    last = np.arange(plan.n_layers)
    first = np.searchsorted(plan.top, plan.bottom - thickness + _SMALLEST / 2, side="right")
    near_bed = plan.bottom - thickness + _SMALLEST / 2 < 0
    return np.where(near_bed & (thickness > 0), -1, first).astype(np.int64), last


def _grow_areas(area: Areas, inside: Areas, width: Float, by: Float) -> Areas:
    """Drop slivers narrower than half an extrusion, then grow the areas by `by` (L,) mm within `inside`."""
    return intersection(offset(offset_open(area, width / 4), by), inside)
