"""Settings under the names that people know from other slicers: `fill_density=20%`, `wall_loops=3`.

PrusaSlicer's names are converted as an import converts them, with the present profile around them; OrcaSlicer's and
Cura's are translated to PrusaSlicer's first.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Any, Final, NamedTuple

from printer_slicer.errors import ProfileError
from printer_slicer.importing.cura_names import CURA_PATTERNS, CURA_SAME, CURA_SEAMS
from printer_slicer.importing.ini import SourceSetting
from printer_slicer.importing.materials import convert_material
from printer_slicer.importing.orca_names import ORCA, ORCA_DEFAULTS
from printer_slicer.importing.presets import Preset
from printer_slicer.importing.prusaslicer_names import DEFAULTS, setting_kind
from printer_slicer.importing.qualities import convert_quality
from printer_slicer.macros.names import add_other_names, own_names
from printer_slicer.profile import Profile, settings_text
from printer_slicer.profile.keys import is_setting

__all__ = ["FamiliarSetting", "familiar_setting", "is_familiar", "meant_setting", "translate_setting"]


class FamiliarSetting(NamedTuple):
    """What a setting of another slicer becomes.

    Attributes:
        slicer: whose name it is.
        changes: settings here -> value.
    """

    slicer: str
    changes: Mapping[str, Any]


def _percent(text: str) -> str:
    return text if text.endswith("%") else f"{text}%"


def _share(text: str) -> str:
    return f"{float(text.removesuffix('%')) / 100:.10g}"


_CURA: Final[Mapping[str, tuple[str, Callable[[str], str]]]] = {
    **{theirs: (prusa, str) for prusa, theirs in CURA_SAME.items()},
    "infill_sparse_density": ("fill_density", _percent),
    "infill_pattern": ("fill_pattern", lambda text: CURA_PATTERNS.get(text, text)),
    "z_seam_type": ("seam_position", lambda text: CURA_SEAMS.get(text, text)),
    "material_flow": ("extrusion_multiplier", _share),
    "retraction_amount": ("retract_length", str),
    "retraction_hop": ("retract_lift", str),
    "retraction_speed": ("retract_speed", str),
    "material_bed_temperature": ("bed_temperature", str),
    "material_bed_temperature_layer_0": ("first_layer_bed_temperature", str),
    "skirt_line_count": ("skirts", str),
    "speed_layer_0": ("first_layer_speed", str),
    "cool_fan_speed": ("max_fan_speed", str),
}
"""Cura's name -> PrusaSlicer's, and what becomes of the value."""

_MEANT: Final[Mapping[str, str]] = {
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
"""What a word that is no setting's name means most likely, as it is typed; {} is the value."""

_FIXED: Final = ("varying_walls",)  # settings that an import sets to the same value for any preset
_MOST_RATIO: Final = 2.0  # numbers above are percentages
_SHARES: Final = ("infill_density", "fan_ratio", "flow_ratio")
_NO_SUPPORTS: Final = re.compile(r"(?:enable_)?supports?(?:_\w+)?")


def is_familiar(name: str) -> bool:
    """Return whether PrusaSlicer, OrcaSlicer or Cura have a setting of this name."""
    return bool(_as_prusaslicer(name, "")[0])


def meant_setting(name: str, text: str) -> str:
    """Return the setting and value that a word means most likely, as they are typed; empty if there is none."""
    form = _MEANT.get(name.lower().replace("-", "_"), "")
    is_share = form.startswith(_SHARES) and text.replace(".", "", 1).isdigit() and float(text) > _MOST_RATIO
    return form.format(f"{text}%" if is_share else text)


def translate_setting(
    name: str, text: str, profile: Callable[[], Profile], write: Callable[[str, str], str]
) -> FamiliarSetting | None:
    """Return what a setting of another slicer becomes; None if it is a setting of this program, or of no program.

    Args:
        name: as the user wrote it.
        text: its value.
        profile: function that returns the profile around the setting; called for settings of other slicers.
        write: function that writes a name and a value as the user would, for messages.

    Raises:
        ProfileError: the value makes no sense, the setting has no counterpart here, or the name is a word that means
            another setting.
    """
    if is_setting(name):
        return None
    found = familiar_setting(name, text, profile())
    if found is None and (meant := meant_setting(name, text)):
        key, _, value = meant.partition("=")
        raise ProfileError(
            f"{write(name, text)}: no such setting", remedy=f"Did you mean {write(key, value)}?"
        )
    return found


def familiar_setting(name: str, text: str, profile: Profile) -> FamiliarSetting | None:
    """Return what a setting of another slicer becomes; None if no slicer has the name.

    Args:
        name: as PrusaSlicer, OrcaSlicer or Cura call it.
        text: its value.
        profile: for what the value depends on, such as layer heights.

    Raises:
        ProfileError: the value makes no sense, or the setting has no counterpart here.
    """
    if not name:
        return None
    slicer, theirs, value = _as_prusaslicer(name, text)
    if _NO_SUPPORTS.fullmatch(theirs or name):
        raise ProfileError(
            f"{name}={text}: supports are not available yet",
            remedy="Rotate the part so that nothing needs support, or model supports",
        )
    if not slicer:
        return _from_conversion(name, text, profile)
    settings = dict(settings_text(profile))
    ours = own_names().get(theirs, "")
    found = [key for key in settings if ours and key.partition(".")[2] == ours.removeprefix("quality.")]
    if len(found) > 1:
        found = [key for key in found if key.startswith(("quality.", ours))][:1]
    if found and not (
        value.endswith("%") and ".speeds." in found[0]
    ):  # an import knows what percentages are of
        return FamiliarSetting(slicer, {found[0]: value})
    converted = _from_conversion(theirs, value, profile, slicer)
    if converted is None:
        raise ProfileError(
            f"{name}={text}: {slicer}'s setting has no counterpart",
            remedy="`printer-slicer profiles settings` lists all settings",
        )
    return converted


def _from_conversion(name: str, text: str, profile: Profile, slicer: str = "") -> FamiliarSetting | None:
    """Return what an import makes of a setting of PrusaSlicer or OrcaSlicer; None if it makes nothing of it."""
    kind = setting_kind(name)
    for program in [slicer] if slicer else ["PrusaSlicer", "OrcaSlicer"]:
        changes = _converted(kind, name, text, profile, is_orca=program == "OrcaSlicer")
        if changes:
            return FamiliarSetting(program, {f"{kind}.{key}": made for key, made in changes.items()})
    return None


def _as_prusaslicer(name: str, text: str) -> tuple[str, str, str]:
    """Return whose name it is, PrusaSlicer's name and the value there; three empty texts for unknown names."""
    if name in DEFAULTS or name in own_names():
        return "PrusaSlicer", name, text
    if name in ORCA or name in ORCA_DEFAULTS:
        return "OrcaSlicer", ORCA.get(name, name), text
    if name in _CURA:
        theirs, change = _CURA[name]
        with suppress(ValueError):
            return "Cura", theirs, change(text)
        return "Cura", theirs, text
    return "", "", ""


def _converted(kind: str, name: str, text: str, profile: Profile, *, is_orca: bool) -> dict[str, Any]:
    """Return what an import makes of one setting: our names within the kind -> value."""
    convert = {"quality": convert_quality, "material": convert_material}.get(kind)
    if convert is None:
        return {}
    plain: dict[str, Any] = {key.partition(".")[2]: value for key, value in settings_text(profile)}
    speeds = {
        f"quality.speeds.{key}": getattr(profile.speeds, key)
        for key in type(profile.speeds).__struct_fields__
    }
    around = add_other_names({**plain, **speeds, "quality.layer_height": profile.quality.layer_height})
    entries = {
        key: SourceSetting(key, str(value[0] if isinstance(value, tuple) else value), "")
        for key, value in around.items()
        if key in DEFAULTS
    }
    entries[name] = SourceSetting(name, text, f"{name}={text}")
    made = convert(
        Preset(
            kind,
            "settings",
            "orca" if is_orca else "prusaslicer",
            f"{name}={text}",
            entries,
            ORCA_DEFAULTS if is_orca else DEFAULTS,
        )
    )
    return {one.ours: one.value for one in made.taken if one.theirs == name and one.ours not in _FIXED}
