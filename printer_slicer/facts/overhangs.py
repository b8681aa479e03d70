"""Present overhangs that get no supports, as facts for JSON and as a sentence for people."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from printer_slicer.arrays import Float, Int
from printer_slicer.geometry import Areas, intersection, split_connected
from printer_slicer.model import UnsupportedPlace
from printer_slicer.profile import Profile
from printer_slicer.profile.object_profiles import list_support_styles
from printer_slicer.stages import Stages
from printer_slicer.texts import format_count, format_significant

__all__ = [
    "collect_overhang_facts",
    "format_overhang_sentences",
    "list_blocked_island_warnings",
    "list_unused_volume_warnings",
]

_MAX_PLACES: Final = 3  # places of each kind that are listed


def collect_overhang_facts(stages: Stages, profile: Profile) -> dict[str, Any] | None:
    """Return the overhangs of objects without supports, for JSON; None if there are none.

    Positions are those after scaling and rotating, not those on the bed.

    Args:
        stages: the sliced part.
        profile: the profile used for slicing.
    """
    found = stages.overhangs_without_supports
    if found is None or not found.area.n_rings:
        return None
    islands = split_connected(found.islands)
    order = np.argsort(found.ring_patch, kind="stable")
    patches = found.area.restacked(order, found.ring_patch[order], found.n_patches)
    lowest = np.full(found.n_patches, found.plan.n_layers)
    np.minimum.at(lowest, found.ring_patch, found.area.ring_layer)
    return {
        "threshold_deg": profile.quality.support_threshold_deg,
        "area_mm2": round(float(found.area.area().sum()), 3),
        "count": found.n_patches,
        "largest": _list_largest(patches, found.plan.bottom[lowest], stages.shift),
        "islands": islands.count,
        "largest_islands": _list_largest(islands.areas, found.plan.bottom[islands.layer], stages.shift),
    }


def list_blocked_island_warnings(stages: Stages) -> list[str]:
    """Return a warning about each of the largest islands that get no support because they are blocked."""
    blocked = sorted(stages.overhangs.blocked if stages.overhangs else (), key=lambda place: -place.area)
    warnings = []
    for place in blocked[:_MAX_PLACES]:
        x, y, z = (np.array([place.x, place.y, place.z]) + stages.shift).tolist()
        warnings.append(
            f"an island of {format_significant(place.area)} mm² at x, y, z {x:.1f}, {y:.1f}, {z:.1f} begins with "
            f"nothing below: {place.reason}"
        )
    return warnings


def list_unused_volume_warnings(stages: Stages, profile: Profile) -> list[str]:
    """Return warnings about support enforcers, blockers and painted facets that have no effect."""
    volumes, found = stages.part.all_volumes, stages.overhangs
    if volumes is None or found is None or list_support_styles(profile) == {"off"}:
        return []
    warnings = []
    if volumes.enforce is not None:
        warnings += _list_idle_warnings(
            found.idle_enforcers, "no overhang lies within the support enforcer", stages
        )
    if volumes.block is not None and not len(volumes.blocked_facets):
        reason = "nothing would get supports within the support blocker"
        warnings += _list_idle_warnings(found.idle_blockers, reason, stages)
    if volumes.enforce is None and len(volumes.enforced_facets):
        from printer_slicer.slicing import cut_volumes  # noqa: PLC0415 - only with painted facets

        enforced = cut_volumes(volumes, found.plan).enforce
        if not intersection(enforced, found.area).n_rings:
            warnings.append(
                "no overhang lies at the facets that are painted for supports, so they have no effect"
            )
    return warnings


def _list_idle_warnings(idle: Sequence[UnsupportedPlace], reason: str, stages: Stages) -> list[str]:
    """Return a warning about each of the first enforcers or blockers without effect."""
    places = [(np.array([one.x, one.y, one.z]) + stages.shift).tolist() for one in idle[:_MAX_PLACES]]
    return [f"{reason} at x, y, z {x:.1f}, {y:.1f}, {z:.1f}, so it has no effect" for x, y, z in places]


def _list_largest(areas: Areas, z: Float, shift: Float) -> list[dict[str, float]]:
    """Return the middle, the lower side (A,) and the area of the largest areas (A entries), the largest first."""
    size: Float = areas.area()
    largest: Int = np.argsort(-size, kind="stable")[:_MAX_PLACES]
    low, high = areas.boxes()
    place = np.column_stack([(low + high) / 2, z])[largest] + shift
    return [
        {"x": round(x, 3), "y": round(y, 3), "z": round(height, 4), "area_mm2": round(one, 3)}
        for (x, y, height), one in zip(place.tolist(), size[largest].tolist(), strict=True)
    ]


def format_overhang_sentences(facts: dict[str, Any] | None) -> list[str]:
    """Format the overhangs that get no supports as one sentence; an empty list if there are none.

    Args:
        facts: the result of `collect_overhang_facts`.
    """
    if facts is None:
        return []
    parts = []
    if facts["islands"]:
        begin = "begins" if facts["islands"] == 1 else "begin"
        parts.append(
            f"{format_count(facts['islands'], 'island')} {begin} with nothing below "
            f"({_format_places(facts['largest_islands'])})"
        )
    parts.append(
        f"{format_significant(facts['area_mm2'])} mm² of overhangs are flatter than {facts['threshold_deg']:g}° "
        f"({_format_places(facts['largest'])})"
    )
    return [f"Unsupported: {'; '.join(parts)}"]


def _format_places(places: list[dict[str, float]]) -> str:
    """Format positions, mm."""
    return "x, y, z " + " and ".join(f"{one['x']:.1f}, {one['y']:.1f}, {one['z']:.1f}" for one in places)
