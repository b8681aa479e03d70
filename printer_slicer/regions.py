"""Sections + Walls -> Regions: what is inside the walls, by how far below and above it there is air.

Shell thicknesses are in mm. On layers of uneven height the layers within reach are a range of z, a different number for
each layer; their common area comes from a table of intersections over 1, 2, 4, ... layers.

Where a slope moves the walls inward by more than they are deep, the step between them must be closed too: sparse is
only what is inside the walls both here and where the skin ends, over and under here. So the shell keeps its thickness
measured across a slope of any angle t to the bed: a point that is `skin` below (above) one that is `depth` inside the
face is depth sin t + skin cos t away from it. On steep slopes that leaves strips of skin / tan t beside the walls,
which alone are depth sin t thick there. Strips are left out where that is enough, a share of the lesser of skin and
depth that the quality asks for (`slope_shell_ratio`), and where they are narrower than half a bead. With a share of 0
skins keep their thickness only as measured up and down: across a slope of 45° the shell is depth sin t thick.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from printer_slicer import bead
from printer_slicer.arrays import Bool, Float, Int
from printer_slicer.bridges import bridges_over, over_sparse
from printer_slicer.geometry import (
    difference,
    intersection,
    offset,
    offset_open,
    pieces_of,
    union,
    window_intersection,
    window_intersections,
)
from printer_slicer.layer_settings import LayerSettings, settings_by_layer
from printer_slicer.model import Areas, LayerPlan, Regions, Sections, Walls
from printer_slicer.profile import Profile

__all__ = ["classify"]

_SMALLEST = 1e-6  # mm: heights that differ by less are the same
_DOT = 5.0  # square beads
_NARROW = 3.0  # beads: strips of sparse infill that are narrower hold only dots of it


def classify(sections: Sections, walls: Walls, profile: Profile) -> Regions:
    """The inside of the walls, divided by purpose.

    A point is solid when, going up (down) from its layer, the inside of the walls ends within `quality.top_thickness`
    (`quality.bottom_thickness`), or where the area around it is too small for sparse infill. The bed is a surface too.
    """
    plan, inside, solid = sections.plan, walls.inside, sections.solid
    rules, width = _Rules.of(settings_by_layer(profile, plan)), walls.width
    near, (open_above, open_below) = _exposed(sections, inside, rules)
    shell = _shell(walls, near, rules)
    carrying, sparse = _below(solid), difference(inside, shell)
    if rules.empty.any():
        hollow = _below(sparse.of_layers(rules.empty))
        # Nothing can stand on what is hollow, sparse infill neither.
        lid = intersection(shell.of_layers(rules.empty).merge(inside.of_layers(~rules.empty)), hollow)
        carrying, open_below = difference(carrying, hollow), union(open_below, lid)
        sparse = difference(sparse, lid)
    down = _grown(open_below, inside, width, rules.anchor)
    skin, hanging = down.select(down.ring_layer == 0), down.select(down.ring_layer > 0)
    bridges = bridges_over(
        offset_open(open_below, width / 4), hanging, carrying, width, (rules.anchor, rules.angle)
    )
    down = skin.merge(bridges.covered())
    up = difference(_grown(open_above, inside, width, 2 * width), down)
    sparse, scraps = _worth_it(difference(sparse, down.merge(up)), width, rules)
    scraps = _over(scraps, _below(sparse)).merge(
        _narrow(difference(hanging, down.merge(up).merge(sparse)), width)
    )
    bridges = bridges.with_scraps(pieces_of(scraps), width / 4)
    open_to_air = skin.merge(bridges.covered()).merge(up)
    covered = difference(inside, sparse.merge(open_to_air))
    internal = over_sparse(covered, _below(sparse), width, rules.anchor)
    bridge, angle = bridges.of_stack()
    return Regions(
        plan,
        bottom_skin=skin,
        bridge=bridge,
        top_skin=up,
        # A disc on a smaller one is no bridge: threads would end in the air, pressed lines hold on to what is below.
        solid=union(difference(covered, internal), bridges.loose),
        sparse=sparse,
        bridge_angle=angle,
        internal_bridge=internal,
        inside=inside,
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Rules:
    """The settings that regions come from, of each layer (L,): mm, mm², shares, and how many.

    Attributes:
        full, empty: whether everything inside is solid, or what is not shell stays empty.
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
    def of(cls, layered: LayerSettings) -> _Rules:
        """Those of profiles."""
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


def _exposed(
    sections: Sections, inside: Areas, rules: _Rules
) -> tuple[tuple[Areas, Areas], tuple[Areas, Areas]]:
    """What of the inside has air within the skins above and below it; and what has it right over and under it.

    Where everything is solid, what is near air is not asked for: the second pair stands for it.
    """
    plan = sections.plan
    top, bottom = rules.top, rules.bottom
    beside = np.minimum(top, _SMALLEST), np.minimum(bottom, _SMALLEST)
    windows = [_window_above(plan, beside[0]), _window_below(plan, beside[1])]
    if not rules.full.all():
        top, bottom = (np.where(rules.full, *pair) for pair in zip(beside, (top, bottom), strict=True))
        windows += [_window_above(plan, top), _window_below(plan, bottom)]
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
        # Where there is no air within the skin, there is none right beside it.
        some = ~none if len(missing) < 2 else missing[-2].used
        missing.append(difference(inside.of_layers(some), cover.of_layers(some)))
    above, below = missing[-1], missing[-2]
    return (missing[1], missing[0]), (above, below)


def _shell(walls: Walls, near: tuple[Areas, Areas], rules: _Rules) -> Areas:
    """What of the inside has to be solid to keep surfaces and slopes closed; all of it where that is asked for."""
    if rules.full.all():
        return walls.inside
    shell = offset_open(union(*near), walls.width / 4)
    if (rules.slope > 0).any():
        shell = union(shell, union(*_across_slopes(walls, rules)))
    dotted = rules.empty | (rules.smallest == 0)
    if not dotted.all():
        shell = _without_dots(shell.of_layers(~dotted), walls.width).merge(shell.of_layers(dotted))
    return walls.inside.of_layers(rules.full).merge(shell.of_layers(~rules.full))


def _across_slopes(walls: Walls, rules: _Rules) -> tuple[Areas, Areas]:
    """What is over and under the walls of the layer where the skin ends, where a slope makes the walls too thin."""
    plan, inside, sloped = walls.plan, walls.inside, rules.slope > 0
    above = _window_above(plan, rules.top)
    below = _window_below(plan, rules.bottom)
    own = np.arange(plan.n_layers)
    highest = np.where(sloped, np.maximum(np.minimum(above[1], plan.n_layers) - 1, own), own)
    lowest = np.where(sloped, np.minimum(np.maximum(below[0], 0), own), own)
    # A slope goes on through the layers between: what it covers of the inside, it does at the farthest of them.
    over, under = (
        offset_open(
            _uncovered(inside, at), _needless(walls, rules, skin, np.abs(plan.cut[at] - plan.cut)) / 2
        )
        for at, skin in ((highest, rules.top), (lowest, rules.bottom))
    )
    return over, under


def _without_dots(shell: Areas, width: Float) -> Areas:
    """The shell without what a bead of few mm would fill, as faceted slopes leave it where solid strips end.

    Beside sparse infill such beads hold nothing. Where there is none, the place is too small for it, and solid anyway.
    """
    pieces = pieces_of(shell)
    large = pieces.areas.area() >= _DOT * width[pieces.layer] ** 2
    return pieces.on_layers(shell.n_layers, np.flatnonzero(large))


def _uncovered(inside: Areas, at: Int) -> Areas:
    """What of each layer's inside is not inside the layer `at` (L,)."""
    other = at != np.arange(inside.n_layers)
    cover = window_intersection(inside, at, at + 1)
    return difference(inside.of_layers(other), cover.of_layers(other))


def _needless(walls: Walls, rules: _Rules, skin: Float, apart: Float) -> Float:
    """(L,) mm: how narrow strips of solid beside the walls can be left out.

    They come from slopes so steep that the walls are thick enough: the strip is skin / tan t wide, the walls are
    depth sin t thick. Steps that leave more of the inside open than a slope hides under the walls are wider than these.
    `apart` (L,) is how far from each other the sections lie at both ends of the skin, mm.
    """
    half = walls.width / 2
    gap = bead.spacing(walls.width, walls.plan.height)
    depth = np.where(rules.perimeters > 0, half + (rules.perimeters - 0.5) * gap, 0.0)
    promised = np.maximum(rules.slope * np.minimum(skin, depth), 1e-9)
    steep = apart * np.sqrt(np.maximum((depth / promised) ** 2 - 1, 0))
    return np.clip(steep, half, np.maximum(depth, half))


def _worth_it(sparse: Areas, width: Float, rules: _Rules) -> tuple[Areas, Areas]:
    """Sparse areas without scraps, and these: too small or narrow for it, where such ones are not to be sparse."""
    as_they_are = rules.empty | (rules.smallest == 0)
    if as_they_are.all():
        return sparse, Areas.empty(sparse.n_layers)
    untouched, sparse = sparse.of_layers(as_they_are), sparse.of_layers(~as_they_are)
    # Opened, sharp corners are cut off: what is narrower than a bead there stays.
    narrow = offset_open(difference(sparse, offset_open(sparse, _NARROW / 2 * width)), width / 3)
    pieces = pieces_of(difference(sparse, narrow))
    large = pieces.areas.area() >= rules.smallest[pieces.layer]
    kept = pieces.on_layers(sparse.n_layers, np.flatnonzero(large))
    return kept.merge(untouched), difference(sparse, kept)


def _over(scraps: Areas, sparse: Areas) -> Areas:
    """Those of the scraps of which the larger part lies over sparse infill: solid, they would hang over its cells."""
    pieces = pieces_of(scraps)
    area = intersection(pieces.areas, pieces.beside(sparse)).area()
    return pieces.on_layers(scraps.n_layers, np.flatnonzero(area > pieces.areas.area() / 2))


def _narrow(beside: Areas, width: Float) -> Areas:
    """Pieces in which no two beads fit side by side."""
    pieces = pieces_of(beside)
    slim = pieces.mean_width() < 2 * width[pieces.layer]
    return pieces.on_layers(beside.n_layers, np.flatnonzero(slim))


def _below(solid: Areas) -> Areas:
    """For each layer the section of the layer below; nothing under the first."""
    own = np.arange(solid.n_layers)
    return window_intersection(solid, own - 1, own)


def _window_above(plan: LayerPlan, thickness: Float) -> tuple[Int, Int]:
    """For each layer the layers above whose bottom is less than `thickness` (L,) over its top; none for thickness 0."""
    first = np.arange(plan.n_layers) + 1
    last = np.searchsorted(plan.bottom, plan.top + thickness - _SMALLEST / 2)
    # Air over the last layer: what lies within reach of the top has a window that leaves the stack.
    near_top = plan.top + thickness - _SMALLEST / 2 > plan.top[-1]
    return first, np.where(near_top & (thickness > 0), plan.n_layers + 1, last).astype(np.int64)


def _window_below(plan: LayerPlan, thickness: Float) -> tuple[Int, Int]:
    """For each layer those below whose top is less than `thickness` (L,) under its bottom; the bed ends the stack."""
    last = np.arange(plan.n_layers)
    first = np.searchsorted(plan.top, plan.bottom - thickness + _SMALLEST / 2, side="right")
    near_bed = plan.bottom - thickness + _SMALLEST / 2 < 0
    return np.where(near_bed & (thickness > 0), -1, first).astype(np.int64), last


def _grown(area: Areas, inside: Areas, width: Float, by: Float) -> Areas:
    """`area` without slivers too narrow for half a bead, grown by `by` (L,) mm so that its lines end on something."""
    return intersection(offset(offset_open(area, width / 4), by), inside)
