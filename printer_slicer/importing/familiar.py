"""Convert single settings that have names from other slicers, such as `fill_density=20%` and `wall_loops=3`.

A setting with a name of PrusaSlicer is converted as in an import; the other settings come from the current profile.
Names of OrcaSlicer and Cura are first translated to names of PrusaSlicer.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Any, Final, NamedTuple

from printer_slicer.errors import ProfileError
from printer_slicer.importing.cura_names import CURA_NAMES, CURA_PATTERNS, CURA_SEAMS
from printer_slicer.importing.ini import SourceSetting
from printer_slicer.importing.materials import convert_material
from printer_slicer.importing.orca_names import ORCA_DEFAULTS, ORCA_NAMES
from printer_slicer.importing.presets import Preset
from printer_slicer.importing.prusaslicer_names import DEFAULTS, setting_kind
from printer_slicer.importing.qualities import convert_quality
from printer_slicer.macros.names import add_other_names, map_prusaslicer_names
from printer_slicer.profile import Profile, settings_text
from printer_slicer.profile.keys import is_setting

__all__ = [
    "FamiliarSetting",
    "convert_familiar_setting",
    "is_familiar",
    "suggest_setting",
    "translate_setting",
]


class FamiliarSetting(NamedTuple):
    """The settings of this program that correspond to a setting of another slicer.

    Attributes:
        slicer: the slicer that has a setting of this name.
        changes: our setting -> value.
    """

    slicer: str
    changes: Mapping[str, Any]


def _append_percent_sign(text: str) -> str:
    """Append a percent sign unless there is one."""
    return text if text.endswith("%") else f"{text}%"


def _percent_to_ratio(text: str) -> str:
    """Convert a percentage, with or without its sign, to a ratio."""
    return f"{float(text.removesuffix('%')) / 100:.10g}"


_CURA: Final[Mapping[str, tuple[str, Callable[[str], str]]]] = {
    **{theirs: (prusa, str) for prusa, theirs in CURA_NAMES.items()},
    "infill_sparse_density": ("fill_density", _append_percent_sign),
    "infill_pattern": ("fill_pattern", lambda text: CURA_PATTERNS.get(text, text)),
    "z_seam_type": ("seam_position", lambda text: CURA_SEAMS.get(text, text)),
    "material_flow": ("extrusion_multiplier", _percent_to_ratio),
    "retraction_amount": ("retract_length", str),
    "retraction_hop": ("retract_lift", str),
    "retraction_speed": ("retract_speed", str),
    "material_bed_temperature": ("bed_temperature", str),
    "material_bed_temperature_layer_0": ("first_layer_bed_temperature", str),
    "skirt_line_count": ("skirts", str),
    "speed_layer_0": ("first_layer_speed", str),
    "cool_fan_speed": ("max_fan_speed", str),
}
"""Cura's name -> PrusaSlicer's name, and a function that converts the value."""

_COMMON_WORDS: Final[Mapping[str, str]] = {
    "density": "infill_density={}",
    "infill_percentage": "infill_density={}",
    "infill_percent": "infill_density={}",
    "pattern": "infill={}",
    "walls": "perimeters={}",
    "wall_count": "perimeters={}",
    "shells": "perimeters={}",
    "outlines": "perimeters={}",
    "loops": "perimeters={}",
    "layer": "layer_height={}",
    "height": "layer_height={}",
    "layers": "layer_height={}",
    "nozzle_temp": "nozzle_temperature={}",
    "hotend_temperature": "nozzle_temperature={}",
    "hotend_temp": "nozzle_temperature={}",
    "extruder_temperature": "nozzle_temperature={}",
    "extruder_temp": "nozzle_temperature={}",
    "print_temp": "nozzle_temperature={}",
    "temp": "nozzle_temperature={}",
    "bed_temp": "bed_temperature={}",
    "nozzle": "nozzle_diameter={}",
    "nozzle_size": "nozzle_diameter={}",
    "flow": "flow_ratio={}",
    "flow_rate": "flow_ratio={}",
    "flowrate": "flow_ratio={}",
    "fan": "fan_ratio={}",
    "fan_speed": "fan_ratio={}",
    "speed": "speeds.perimeter={}",
    "print_speed": "speeds.perimeter={}",
    "speed_print": "speeds.perimeter={}",
    "feedrate": "speeds.perimeter={}",
    "linear_advance": "pressure_advance={}",
    "k_factor": "pressure_advance={}",
    "vase": "spiral={}",
    "vase_mode": "spiral={}",
    "retraction": "retract_length={}",
    "retraction_distance": "retract_length={}",
    "zhop": "z_hop={}",
    "z_lift": "z_hop={}",
    "brim": "brim_width={}",
    "skirt": "skirt_loops={}",
    "raft": "raft_height={}",
    "adhesion_type": "brim_width=5",
    "seam_type": "seam={}",
    "jerk": "jerk_xy={}",
    "baudrate": "baud={}",
}
"""Common word that is not the name of a setting -> the setting that it probably means, where {} is the value."""

_ALWAYS_SET: Final = ("varying_walls",)  # settings that an import sets to the same value for every preset
_LARGEST_RATIO: Final = 2.0  # greater numbers are percentages
_RATIO_SETTINGS: Final = ("infill_density", "fan_ratio", "flow_ratio")
_NO_SUPPORTS: Final = re.compile(r"(?:enable_)?supports?(?:_\w+)?")


def is_familiar(name: str) -> bool:
    """Return whether PrusaSlicer, OrcaSlicer or Cura has a setting of this name."""
    return bool(_translate_to_prusaslicer(name, "")[0])


def suggest_setting(name: str, text: str) -> str:
    """Return the setting, with its value, that a word probably means, such as `perimeters=3`; empty if unknown."""
    form = _COMMON_WORDS.get(name.lower().replace("-", "_"), "")
    is_percentage = (
        form.startswith(_RATIO_SETTINGS)
        and text.replace(".", "", 1).isdigit()
        and float(text) > _LARGEST_RATIO
    )
    return form.format(f"{text}%" if is_percentage else text)


def translate_setting(
    name: str, text: str, profile: Callable[[], Profile], write: Callable[[str, str], str]
) -> FamiliarSetting | None:
    """Convert a setting of another slicer; return None if this program or no program has a setting of this name.

    Args:
        name: name of the setting, as the user wrote it.
        text: its value.
        profile: function that returns the profile to be changed; called only for settings of other slicers.
        write: function that writes a name and a value as the user would, for messages.

    Raises:
        ProfileError: the value is invalid, the setting has no equivalent here, or the name is a common word for a
            setting that has another name.
    """
    if is_setting(name):
        return None
    found = convert_familiar_setting(name, text, profile())
    if found is None and (suggested := suggest_setting(name, text)):
        key, _, value = suggested.partition("=")
        raise ProfileError(
            f"{write(name, text)}: no such setting", remedy=f"Did you mean {write(key, value)}?"
        )
    return found


def convert_familiar_setting(name: str, text: str, profile: Profile) -> FamiliarSetting | None:
    """Convert a setting of another slicer; return None if no slicer has a setting of this name.

    Args:
        name: name of the setting in PrusaSlicer, OrcaSlicer or Cura.
        text: its value.
        profile: profile with the settings that the value depends on, such as layer heights.

    Raises:
        ProfileError: the value is invalid, or the setting has no equivalent here.
    """
    if not name:
        return None
    slicer, theirs, value = _translate_to_prusaslicer(name, text)
    if _NO_SUPPORTS.fullmatch(theirs or name):
        raise ProfileError(
            f"{name}={text}: supports are not available yet",
            remedy="Rotate the part so that nothing needs support, or add supports to the model",
        )
    if not slicer:
        return _convert_setting(name, text, profile)
    settings = dict(settings_text(profile))
    ours = map_prusaslicer_names().get(theirs, "")
    found = [key for key in settings if ours and key.partition(".")[2] == ours.removeprefix("quality.")]
    if len(found) > 1:
        found = [key for key in found if key.startswith(("quality.", ours))][:1]
    if found and not (
        value.endswith("%") and ".speeds." in found[0]
    ):  # an import knows which speed a percentage refers to
        return FamiliarSetting(slicer, {found[0]: value})
    converted = _convert_setting(theirs, value, profile, slicer)
    if converted is None:
        raise ProfileError(
            f"{name}={text}: this setting of {slicer} has no equivalent here",
            remedy="`ps.find_settings()` lists all settings",
        )
    return converted


def _convert_setting(name: str, text: str, profile: Profile, slicer: str = "") -> FamiliarSetting | None:
    """Convert a setting of PrusaSlicer or OrcaSlicer as in an import; return None if it has no equivalent."""
    kind = setting_kind(name)
    for program in [slicer] if slicer else ["PrusaSlicer", "OrcaSlicer"]:
        changes = _convert_in_profile(kind, name, text, profile, is_orca=program == "OrcaSlicer")
        if changes:
            return FamiliarSetting(program, {f"{kind}.{key}": result for key, result in changes.items()})
    return None


def _translate_to_prusaslicer(name: str, text: str) -> tuple[str, str, str]:
    """Return the slicer that has a setting, and PrusaSlicer's name and value for it; empty texts if it is unknown."""
    if name in DEFAULTS or name in map_prusaslicer_names():
        return "PrusaSlicer", name, text
    if name in ORCA_NAMES or name in ORCA_DEFAULTS:
        return "OrcaSlicer", ORCA_NAMES.get(name, name), text
    if name in _CURA:
        theirs, change = _CURA[name]
        with suppress(ValueError):
            return "Cura", theirs, change(text)
        return "Cura", theirs, text
    return "", "", ""


def _convert_in_profile(
    kind: str, name: str, text: str, profile: Profile, *, is_orca: bool
) -> dict[str, Any]:
    """Convert one setting as in an import; return our name without the section -> value."""
    convert = {"quality": convert_quality, "material": convert_material}.get(kind)
    if convert is None:
        return {}
    plain: dict[str, Any] = {key.partition(".")[2]: value for key, value in settings_text(profile)}
    speeds = {
        f"quality.speeds.{key}": getattr(profile.speeds, key)
        for key in type(profile.speeds).__struct_fields__
    }
    context = add_other_names({**plain, **speeds, "quality.layer_height": profile.quality.layer_height})
    entries = {
        key: SourceSetting(key, str(value[0] if isinstance(value, tuple) else value), "")
        for key, value in context.items()
        if key in DEFAULTS
    }
    entries[name] = SourceSetting(name, text, f"{name}={text}")
    result = convert(
        Preset(
            kind,
            "settings",
            "orca" if is_orca else "prusaslicer",
            f"{name}={text}",
            entries,
            ORCA_DEFAULTS if is_orca else DEFAULTS,
        )
    )
    return {one.ours: one.value for one in result.taken if one.theirs == name and one.ours not in _ALWAYS_SET}
