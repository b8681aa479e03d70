"""Apply support enforcers and blockers, and painted facets, to overhangs."""

from __future__ import annotations

from typing import Final

import numpy as np

from printer_slicer.geometry import Areas, difference, intersection, offset_open, split_connected, union
from printer_slicer.model import LayerPlan, Overhangs, Sections, UnsupportedPlace, VolumeSections
from printer_slicer.profile import Quality
from printer_slicer.supports.overhangs import mark_flat_layers
from printer_slicer.supports.patches import join_patches
from printer_slicer.supports.slopes import compute_steps
from printer_slicer.values import replace

__all__ = ["apply_enforcers_and_blockers", "select_overhangs"]

_SLIVER: Final = (
    0.02  # mm; narrower strips than twice this are rounding, or surfaces that are nearly vertical
)
_BLOCKED: Final = "a support blocker covers it"
_IDLE: Final = "no overhang lies within this support enforcer"
_IDLE_BLOCKER: Final = "no supports are needed within this support blocker"
_NOT_ENFORCED: Final = "supports are made only in enforced places"


def apply_enforcers_and_blockers(
    overhangs: Overhangs, sections: Sections, volumes: VolumeSections, quality: Quality
) -> Overhangs:
    """Add enforced areas to overhangs, then remove blocked ones.

    Whatever is unsupported within an enforced place gets a support: at any angle, however small, and also bridges.
    Where a place is enforced and blocked, it is blocked; islands that are blocked are listed. With
    `support_places = enforced`, nothing else gets a support.

    Args:
        overhangs: areas that need supports by the rules for the whole part.
        sections: the part.
        volumes: the places by layer of `overhangs.plan`.
        quality: threshold angle, and whether only enforced places get supports.
    """
    only_enforced = quality.support_places == "enforced"
    if not (volumes.enforce.n_rings or volumes.block.n_rings or only_enforced):
        return overhangs
    plan, enforced = overhangs.plan, _find_enforced(sections.solid, volumes.enforce)
    supported = enforced if only_enforced else union(overhangs.area, enforced)
    hanging = difference(supported, volumes.block)
    # All of it is kept: small patches were dropped before, unless they are enforced.
    step = compute_steps(plan, quality.support_threshold_deg)
    area, patch = join_patches(hanging, hanging, Areas.empty(plan.n_layers), step, quality)
    islands = difference(overhangs.islands, volumes.block)
    blocked = _list_places(overhangs.islands, volumes.block, plan, _BLOCKED)
    if only_enforced:
        left = difference(islands, enforced)
        islands = intersection(islands, enforced)
        blocked += _list_places(overhangs.islands, left, plan, _NOT_ENFORCED)
    return replace(
        overhangs,
        area=area,
        ring_patch=patch,
        islands=islands,
        bridged=difference(overhangs.bridged, enforced),
        is_flat=mark_flat_layers(area, patch),
        blocked=(*overhangs.blocked, *blocked),
        idle_enforcers=_list_unused(volumes.enforce, enforced, quality, plan, _IDLE),
        idle_blockers=_list_unused(volumes.block, supported, quality, plan, _IDLE_BLOCKER),
    )


def select_overhangs(overhangs: Overhangs, place: Areas, quality: Quality, *, inside: bool) -> Overhangs:
    """Return the overhangs inside or outside a place, given by its area in each layer; lists stay with the outside."""
    cut = intersection if inside else difference
    area, islands, bridged = (
        cut(one, place) for one in (overhangs.area, overhangs.islands, overhangs.bridged)
    )
    # All of it is kept: small patches were dropped before.
    area = offset_open(area, _SLIVER / 2)
    step = compute_steps(overhangs.plan, quality.support_threshold_deg)
    area, patch = join_patches(area, area, Areas.empty(overhangs.plan.n_layers), step, quality)
    return replace(
        overhangs,
        area=area,
        ring_patch=patch,
        islands=islands,
        bridged=bridged,
        is_flat=mark_flat_layers(area, patch),
        blocked=() if inside else overhangs.blocked,
        idle_enforcers=() if inside else overhangs.idle_enforcers,
        idle_blockers=() if inside else overhangs.idle_blockers,
    )


def _find_enforced(solid: Areas, enforce: Areas) -> Areas:
    """Return the areas with no part below them within the enforced places."""
    hangs = difference(intersection(solid, enforce), solid.shift_layers(1))
    on_bed = np.arange(solid.n_layers) == 0
    return offset_open(hangs.of_layers(~on_bed), _SLIVER)


def _list_unused(
    volumes: Areas, hanging: Areas, quality: Quality, plan: LayerPlan, reason: str
) -> tuple[UnsupportedPlace, ...]:
    """List the connected volumes without any overhang, at the middle of their lowest section."""
    step = compute_steps(plan, quality.support_threshold_deg)
    area, patch = join_patches(volumes, volumes, Areas.empty(plan.n_layers), step, quality)
    if not area.n_rings:
        return ()
    pieces = split_connected(area)
    in_use = intersection(pieces.areas, hanging.copy_layers(pieces.layer)).area() > 0
    of_piece = np.zeros(pieces.count, np.int64)
    is_known = pieces.of_ring >= 0
    of_piece[pieces.of_ring[is_known]] = patch[is_known]
    idle = np.setdiff1d(of_piece, of_piece[in_use])
    first = [int(np.flatnonzero(of_piece == one)[0]) for one in idle]
    size, (low, high) = pieces.areas.area(), pieces.areas.boxes()
    places = ((low + high) / 2)[first].tolist()
    return tuple(
        UnsupportedPlace(x, y, float(plan.bottom[pieces.layer[piece]]), float(size[piece]), reason)
        for (x, y), piece in zip(places, first, strict=True)
    )


def _list_places(islands: Areas, block: Areas, plan: LayerPlan, reason: str) -> tuple[UnsupportedPlace, ...]:
    """List the islands of which more than half is blocked for the same reason, from the lowest."""
    pieces = split_connected(islands)
    area, (low, high) = pieces.areas.area(), pieces.areas.boxes()
    covered = intersection(pieces.areas, block.copy_layers(pieces.layer)).area()
    found = []
    for piece in np.flatnonzero(covered > area / 2).tolist():
        x, y = ((low[piece] + high[piece]) / 2).tolist()
        z = float(plan.bottom[pieces.layer[piece]])
        found.append(UnsupportedPlace(x, y, z, float(area[piece]), reason, is_island=True))
    return tuple(found)
