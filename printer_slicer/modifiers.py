"""Settings of the part inside modifier volumes: infill, solid layers, their speeds, and supports.

The regions inside the perimeters are classified once with the settings of the object and once with those of the
modifier, and each side keeps its own. So a modifier changes nothing outside its volume, and its border is no surface.
Bridges are not divided, because their lines must reach from support to support: they belong to the side on which most
of them lies.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from printer_slicer.arrays import Bool, Float
from printer_slicer.geometry import Areas, difference, intersection, offset_open, split_connected, union
from printer_slicer.model import Mesh, Regions, Sections, Walls
from printer_slicer.profile import Profile, profile_with
from printer_slicer.profile.object_profiles import MODIFIER_SETTINGS
from printer_slicer.regions import classify
from printer_slicer.slicing import cut_closed
from printer_slicer.supports.bridges_on_supports import replace_bridges_on_supports
from printer_slicer.values import Struct, replace

__all__ = [
    "Modifier",
    "cut_modifiers",
    "divide_regions",
]


_REST: Final = 0.05  # mm; narrower strips that neither side fills are rounding


class Modifier(Struct, frozen=True, eq=False):
    """A volume with settings of its own.

    Attributes:
        area: its section in each layer of the object, without modifiers that follow it.
        profile: the profile of the object with the settings of the modifier.
    """

    area: Areas
    profile: Profile


def cut_modifiers(mesh: Mesh, sections: Sections, profile: Profile, own: Profile) -> list[Modifier]:
    """Return the modifiers of an object that have settings; where several overlap, the last one counts.

    Args:
        mesh: the object with its volumes.
        sections: of the object.
        profile: of the plate; its overrides have the settings of modifiers under their names.
        own: the profile of the object.

    Raises:
        MeshError: the surface of a modifier is open.
    """
    found: list[Modifier] = []
    taken = Areas.empty(sections.plan.n_layers)
    for volume in reversed(mesh.volumes.modifiers if mesh.volumes else ()):
        changed = _change_profile(profile, own, volume.name)
        if changed is None:
            continue
        area = cut_closed(volume, sections.plan)
        found.insert(0, Modifier(difference(area, taken), changed))
        taken = union(taken, area)
    return found


def _change_profile(profile: Profile, own: Profile, name: str) -> Profile | None:
    """Return the profile of an object with the settings of a modifier; None if it has none that are followed."""
    everywhere: dict[str, object] = {}
    heights: list[dict[str, object]] = [
        {"low": one.low, "high": one.high, "set": one.set} for one in own.quality.overrides
    ]
    n_own = len(heights)
    for one in profile.quality.overrides:
        followed = {
            key: value for key, value in one.set.items() if key.removeprefix("quality.") in MODIFIER_SETTINGS
        }
        if one.object != name or not followed:
            continue
        if one.is_everywhere:
            everywhere |= followed
        else:
            heights.append({"low": one.low, "high": one.high, "set": followed})
    if not everywhere and len(heights) == n_own:
        return None
    return profile_with(own, {**everywhere, "quality.overrides": heights})


def divide_regions(
    regions: Regions, sections: Sections, walls: Walls, modifiers: Sequence[Modifier]
) -> tuple[Regions, list[Regions]]:
    """Return the regions outside all modifiers, and those inside each modifier by its settings.

    Args:
        regions: of the object, by its own settings.
        sections: of the object.
        walls: of the object.
        modifiers: their areas do not overlap.
    """
    inside = []
    carried = regions.bottom_solid_infill.of_layers(np.arange(regions.plan.n_layers) > 0)
    for one in modifiers:
        own = replace_bridges_on_supports(classify(sections, walls, one.profile), carried)
        regions, own = _divide(regions, own, one.area)
        inside.append(own)
    return regions, inside


def _divide(outer: Regions, inner: Regions, area: Areas) -> tuple[Regions, Regions]:
    """Return two divisions of the same areas, one outside and one inside an area."""
    lies_inside = [_mark_pieces(one.bridge, area) for one in (outer, inner)]
    outer_bridge, outer_angle = _select(outer, ~lies_inside[0])
    inner_bridge, inner_angle = _select(inner, lies_inside[1])
    inner_bridge, inner_angle = _subtract(inner_bridge, inner_angle, outer_bridge)
    bridges = union(outer_bridge, inner_bridge)
    rest = difference(outer.inside, bridges)
    return (
        _fill(outer, difference(rest, area), outer_bridge, outer_angle),
        _fill(inner, intersection(rest, area), inner_bridge, inner_angle),
    )


def _mark_pieces(areas: Areas, area: Areas) -> Bool:
    """Return a mask (R,) of the rings of connected pieces of which more than half lies in an area."""
    pieces = split_connected(areas)
    within = intersection(pieces.areas, area.copy_layers(pieces.layer)).area() > pieces.areas.area() / 2
    return np.asarray(np.append(within, False)[pieces.of_ring], np.bool_)


def _select(regions: Regions, chosen: Bool) -> tuple[Areas, Float]:
    """Return some rings (R,) of the bridges, and their angles."""
    return regions.bridge.select(chosen), regions.bridge_angle[chosen]


def _subtract(bridge: Areas, angle: Float, taken: Areas) -> tuple[Areas, Float]:
    """Return bridges without an area, and the angles of their rings."""
    pieces = split_connected(bridge)
    if not pieces.count:
        return bridge, angle
    of_piece = np.zeros(pieces.count)
    is_known = pieces.of_ring >= 0
    of_piece[pieces.of_ring[is_known]] = angle[is_known]
    left = difference(pieces.areas, taken.copy_layers(pieces.layer))
    return left.on_layers(pieces.layer, bridge.n_layers), of_piece[left.ring_layer]


def _fill(regions: Regions, area: Areas, bridge: Areas, angle: Float) -> Regions:
    """Return regions within an area, with these bridges; what no region covers becomes solid infill."""
    names = ("bottom_solid_infill", "top_solid_infill", "solid_infill", "internal_infill", "internal_bridge")
    within = {name: intersection(getattr(regions, name), area) for name in names}
    covered = Areas.empty(area.n_layers)
    for one in within.values():
        covered = union(covered, one)
    rest = offset_open(difference(area, covered), _REST / 2)
    within["solid_infill"] = union(within["solid_infill"], rest)
    return replace(
        regions,
        bridge=bridge,
        bridge_angle=angle,
        internal_bridge_angle=np.zeros(0),
        top_angle=np.zeros(0),
        **within,
    )
