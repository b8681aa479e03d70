"""Present supports, and the places that get none, as facts for JSON and as sentences for people."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from printer_slicer.arrays import Bool
from printer_slicer.extrusion import move_seconds
from printer_slicer.extrusion.cooling import find_next_extrusions
from printer_slicer.geometry import Areas, difference, intersection
from printer_slicer.model import Program, Sections, Supports, UnsupportedPlace
from printer_slicer.profile import Profile
from printer_slicer.profile.object_profiles import list_support_styles
from printer_slicer.roles import Role, roles_with
from printer_slicer.stages import Stages
from printer_slicer.supports.findings import find_grips, find_slim_pieces
from printer_slicer.texts import format_count, format_duration, format_significant

__all__ = ["collect_support_facts", "format_support_sentences"]

_MAX_PLACES: Final = 3  # places without support that are told
_MAX_LISTED: Final = 20  # the same in JSON
_MIN_COLUMN: Final = 0.1  # mm² in all layers; less is rounding
_CONTACT_DEPTH: Final = 0.55  # mm below a support, up to which the part carries it


def collect_support_facts(stages: Stages, profile: Profile) -> dict[str, Any] | None:
    """Return filament, time and places of supports, for JSON; None without supports.

    The time includes the travels to supports. Positions are those after scaling and rotating, not those on the bed.

    Args:
        stages: the sliced part.
        profile: the profile used for slicing.
    """
    supports, program = stages.supports, stages.program
    if supports is None:
        return None
    carries = _mark_supports(program)
    filament = float(program.filament[carries & (program.role != Role.TRAVEL)].sum())
    volume = filament * profile.material.filament_area
    area, style = supports.area, _name_style(supports, profile)
    return {
        "style": style,
        "added_style": _find_added_style(style, profile),
        "layers": supports.plan.layers.n_layers,
        "filament_g": round(volume / 1000 * profile.material.density, 3),
        "seconds": round(float(move_seconds(program, profile)[carries].sum()), 3),
        "on_bed_mm2": round(float(area.area()[:1].sum()), 3),
        "on_part_mm2": round(_measure_area_on_part(supports, area, stages.sections), 3),
        "largest_gap_error_mm": round(supports.plan.flat_gap_error, 6),
        "unsupported_mm2": round(sum(place.area for place in supports.unsupported), 3),
        "unsupported_islands": sum(place.is_island for place in supports.unsupported),
        "unsupported_places": _list_largest(supports.unsupported, stages),
        "grips": _list_grips(supports, stages),
        "slim": _list_slim_pieces(supports, stages),
    }


def _name_style(supports: Supports, profile: Profile) -> str:
    """Return the styles of the supports: `columns`, `tree`, or both; `none` if none are printed.

    Trees for low places may have no branches, only a roof on the bed.
    """
    if not supports.area.n_rings:
        return "none"
    if not len(supports.branches):
        return "tree" if list_support_styles(profile) <= {"tree", "off"} else "columns"
    columns = supports.base.of_layers(np.arange(1, supports.base.n_layers)).area().sum()
    is_mixed = columns - supports.hollow.area().sum() > _MIN_COLUMN
    return "columns and tree" if is_mixed else "tree"


def _find_added_style(style: str, profile: Profile) -> str | None:
    """Return the style that supports places which those of the settings cannot; None if there is none."""
    asked = list_support_styles(profile)
    added = set() if "auto" in asked else {"columns", "tree"}.intersection(style.split(" and ")) - asked
    return next(iter(added), None)


def _mark_supports(program: Program) -> Bool:
    """Return a mask (K,) of the moves that print supports or lead to them."""
    carries = roles_with(is_support=True)[program.role]
    return np.asarray(np.append(carries, False)[find_next_extrusions(program.role, 0, program.n_moves)])


def _measure_area_on_part(supports: Supports, area: Areas, part: Sections) -> float:
    """Return the area of supports that stand on the part, mm²."""
    below = np.searchsorted(part.plan.top, supports.plan.layers.bottom - _CONTACT_DEPTH)
    begins = difference(area.of_layers(np.arange(1, area.n_layers)), area.shift_layers(1))
    return float(intersection(begins, part.solid.copy_layers(below)).area().sum())


def _list_largest(unsupported: tuple[UnsupportedPlace, ...], stages: Stages) -> list[dict[str, Any]]:
    """Return the largest places without support, islands first."""
    places = sorted(unsupported, key=lambda place: (not place.is_island, -place.area))[:_MAX_LISTED]
    shift = stages.shift.tolist()
    return [
        {
            "x": round(place.x + shift[0], 3),
            "y": round(place.y + shift[1], 3),
            "z": round(place.z + shift[2], 4),
            "area_mm2": round(place.area, 3),
            "free_distance_mm": round(place.free_distance, 3),
            "island": place.is_island,
            "reason": place.reason,
        }
        for place in places
    ]


def _list_grips(supports: Supports, stages: Stages) -> list[dict[str, float]]:
    """Return the closed rings of supports around the part."""
    shift = stages.shift.tolist()
    return [
        {
            "x": round(grip.x + shift[0], 3),
            "y": round(grip.y + shift[1], 3),
            "z_min": round(grip.low + shift[2], 4),
            "z_max": round(grip.high + shift[2], 4),
        }
        for grip in find_grips(supports, stages.sections)[:_MAX_LISTED]
    ]


def _list_slim_pieces(supports: Supports, stages: Stages) -> list[dict[str, float]]:
    """Return the pieces of supports that are slim for their height, the slimmest first."""
    slim = sorted(find_slim_pieces(supports), key=lambda piece: -piece.slimness)[:_MAX_LISTED]
    shift = stages.shift.tolist()
    return [
        {
            "x": round(piece.x + shift[0], 3),
            "y": round(piece.y + shift[1], 3),
            "height_mm": round(piece.height, 4),
            "foot_mm2": round(piece.foot, 3),
        }
        for piece in slim
    ]


def format_support_sentences(facts: dict[str, Any] | None) -> list[str]:
    """Format the filament and the time of supports, and the places that get none, as sentences.

    Args:
        facts: the result of `collect_support_facts`.
    """
    if facts is None:
        return []
    name = {"tree": "trees", "columns and tree": "columns and trees"}.get(facts["style"], facts["style"])
    on_part = (
        f"; {format_significant(facts['on_part_mm2'])} mm² stand on the part" if facts["on_part_mm2"] else ""
    )
    added = {"tree": "; trees support what columns cannot", "columns": "; columns support what trees cannot"}
    amount = f"{format_significant(facts['filament_g'])} g, {format_duration(facts['seconds'])}{on_part}"
    amount += added.get(facts["added_style"], "")
    lines = ["Supports: none can be printed" if name == "none" else f"Supports ({name}): {amount}"]
    for place in facts["unsupported_places"][:_MAX_PLACES]:
        what = "an island" if place["island"] else f"{format_significant(place['area_mm2'])} mm²"
        lines.append(
            f"Unsupported: {what} at x, y, z {place['x']:.1f}, {place['y']:.1f}, {place['z']:.1f}: {place['reason']}"
        )
    if len(facts["unsupported_places"]) > _MAX_PLACES:
        islands = (
            f", {format_count(facts['unsupported_islands'], 'island')}"
            if facts["unsupported_islands"]
            else ""
        )
        lines.append(f"Unsupported in total: {format_significant(facts['unsupported_mm2'])} mm²{islands}")
    if facts["grips"]:
        first, count = facts["grips"][0], format_count(len(facts["grips"]), "ring")
        where = f"at z {first['z_min']:.1f} to {first['z_max']:.1f}, x, y {first['x']:.1f}, {first['y']:.1f}"
        lines.append(f"Hard to remove: {count} of supports around the part, the lowest {where}")
    if facts["slim"]:
        first, count = facts["slim"][0], format_count(len(facts["slim"]), "support")
        size = f"{first['height_mm']:.1f} mm high on {format_significant(first['foot_mm2'])} mm²"
        lines.append(
            f"May fall over: {count}, the slimmest {size} at x, y {first['x']:.1f}, {first['y']:.1f}; "
            "increase support_first_layer_expansion"
        )
    return lines
