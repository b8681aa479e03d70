"""List the differences between imported profiles and their sources that change the print most."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from functools import cache
from typing import Any, Final, NamedTuple

from printer_slicer.importing.results import ConvertedSetting, ImportedProfile, ImportNote, UnsupportedSetting
from printer_slicer.profile.tables import list_setting_definitions

__all__ = ["Difference", "find_largest_differences", "find_other_notes"]

_MIN_WEIGHT: Final = 20  # differences with less weight are not listed
_USUAL_WEIGHT: Final = 30  # weight of a converted setting that is not in the table
_CONVERTED_WEIGHTS: Final[tuple[tuple[str, int], ...]] = (
    ("bed_", 85),
    ("flavour", 80),
    ("layer_height", 95),
    ("first_layer_height", 80),
    ("perimeters", 90),
    ("infill_density", 90),
    ("extrusion_width", 75),
    ("nozzle_diameter", 75),
    ("flow_ratio", 75),
    ("infill", 60),
    ("brim_", 55),
    ("max_flow", 50),
    ("speeds.", 50),
    ("firmware_retraction", 50),
    ("varying_walls", 40),
    ("scarf_", 35),
    ("support_", 30),
    ("support", 100),
    ("slope_shell_ratio", 21),
    ("fan_overhang_", 22),
)
"""Prefix of our setting -> weight, which says how much it changes the print; the first match counts."""
_UNSUPPORTED_WEIGHTS: Final[tuple[tuple[str, int], ...]] = (
    (r"support_material|enable_support|support_enable", 100),
    (r"fuzzy_skin|magic_fuzzy_skin_enabled|mold_enabled|magic_mesh_surface_mode", 90),
    (r"adaptive_layer_height(_enabled)?|variable_layer_height", 80),
    (r"complete_objects|print_sequence", 70),
    (r"print_flow_ratio|(first|initial)_layer_flow_ratio|default_filament_flow", 65),
    (r"filament_shrink\w*|chamber_temperature", 60),
    (r"make_overhang_printable|hole_to_polyhole|interlocking_beam", 60),
    (r"filament_(retract|retraction)_(length|speed)", 50),
    (r"\w*(infill|surface|skin)\w*(_extrusion_width|_line_width)", 45),
    (r"\w*_flow_ratio|\w*_material_flow", 40),
    (r"overhang_reversal|thick_internal_bridges|extra_solid_infills|infill_combination", 25),
    (r"filament_(z_hop|retract_lift|wipe)", 22),
)
"""Pattern for settings without an equivalent -> weight, which says how much they change the print."""
_NEUTRAL_VALUES: Final = ("100%", "1", "by layer")
_RATIO_NAMES: Final = re.compile(r"ratio|flow|shrink|sequence")
_WITH_UNITS: Final = ("mm", "mm/s", "mm/s²", "mm²", "mm³/s", "°C", "s", "degrees")
_NUMBER: Final = re.compile(r"-?\d+(\.\d*)?")


class Difference(NamedTuple):
    """A setting whose effect on the print differs from the source.

    Attributes:
        weight: how much it changes the print.
        text: both settings with their values and units, and the reason.
    """

    weight: int
    text: str


def find_largest_differences(profiles: Sequence[ImportedProfile]) -> list[Difference]:
    """Return the differences that change the print, the largest first.

    Args:
        profiles: the imported profiles.
    """
    found = [one for profile in profiles for one in (*_list_converted(profile), *_list_unsupported(profile))]
    unique = {one.text: one for one in found if one.weight >= _MIN_WEIGHT}
    return sorted(unique.values(), key=lambda one: -one.weight)


def find_other_notes(profile: ImportedProfile) -> list[ImportNote]:
    """Return the warnings of a profile about settings that are not among the differences."""
    differing = {one.theirs for one in profile.taken if one.differs}
    return [note for note in profile.notes if note.place.rpartition(": ")[2] not in differing]


def _list_converted(profile: ImportedProfile) -> Iterator[Difference]:
    """Yield the settings whose value had to change."""
    for one in profile.taken:
        if one.differs:
            name = one.ours.rpartition(": ")[2]
            weight = next(
                (weight for start, weight in _CONVERTED_WEIGHTS if name.startswith(start)), _USUAL_WEIGHT
            )
            yield Difference(weight, f"{profile.kind}: {_describe_change(profile, one, name)}")


def _describe_change(profile: ImportedProfile, setting: ConvertedSetting, name: str) -> str:
    """Format a converted setting with its name and value in the source and in the new profile."""
    unit = _map_units().get(f"{profile.kind}.{name}", "")
    ours = f"{setting.ours} = {_append_unit(_format_value(setting.value), unit)}"
    theirs = (
        f"{setting.theirs} = {_append_unit(_shorten(setting.text), unit)}" if setting.theirs else "not set"
    )
    return f"{theirs} -> {ours} ({setting.how})" if setting.how else f"{theirs} -> {ours}"


def _list_unsupported(profile: ImportedProfile) -> Iterator[Difference]:
    """Yield the settings without an equivalent that change the print."""
    for one in profile.left:
        weight = 0 if one.off else _weigh_unsupported(one)
        if weight:
            unit = "mm" if one.theirs.endswith(("_width", "_length")) else ""
            value = _append_unit(_shorten(one.text), unit)
            yield Difference(weight, f"{profile.kind}: {one.theirs} = {value} is not imported ({one.why})")


def _weigh_unsupported(setting: UnsupportedSetting) -> int:
    """Return the weight of a setting without an equivalent; 0 if its value does not change the print."""
    name = setting.theirs.rpartition(": ")[2]
    if setting.text.strip() in _NEUTRAL_VALUES and _RATIO_NAMES.search(name):
        return 0
    return next((weight for pattern, weight in _UNSUPPORTED_WEIGHTS if re.fullmatch(pattern, name)), 0)


@cache
def _map_units() -> dict[str, str]:
    """Map each of our settings to its unit."""
    return {row.key: row.unit for row in list_setting_definitions()}


def _append_unit(value: str, unit: str) -> str:
    """Append a unit to a value that is a number."""
    return f"{value} {unit}" if unit in _WITH_UNITS and _NUMBER.fullmatch(value) else value


def _format_value(value: Any) -> str:
    """Format one of our values on one short line."""
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:g}" if isinstance(value, float) else _shorten(str(value))


def _shorten(text: str) -> str:
    """Return the first line of a text, shortened."""
    line = text.strip().splitlines()[0] if text.strip() else "empty"
    return line if len(line) <= 40 else f"{line[:37]}..."
