"""Convert settings that have names from other slicers, such as `fill_density=20%` and `wall_loops=3`.

The settings of one command line are converted together, as if they stood in a small file of their slicer; the other
settings of that file come from the profile that is changed. Unlike values in files, wrong values are errors.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from typing import Any, Final, NamedTuple

from printer_slicer import profile as plain
from printer_slicer.errors import ProfileError
from printer_slicer.importing.cura_names import CURA_DEFAULTS
from printer_slicer.importing.cura_typed import CURA_SETTINGS, translate_cura_settings
from printer_slicer.importing.ini import SourceSetting
from printer_slicer.importing.materials import convert_material
from printer_slicer.importing.orca_names import ORCA_DEFAULTS, ORCA_NAMES, ORCA_ONLY
from printer_slicer.importing.percentages import takes_percentage
from printer_slicer.importing.presets import OFF_WORDS, Preset
from printer_slicer.importing.printers import CompanionRanges, convert_printer
from printer_slicer.importing.profile_settings import describe_profile
from printer_slicer.importing.prusaslicer_names import DEFAULTS, METADATA
from printer_slicer.importing.qualities import convert_quality
from printer_slicer.importing.results import ConvertedSetting, ImportedProfile
from printer_slicer.macros.names import map_prusaslicer_names
from printer_slicer.profile import Profile, list_settings
from printer_slicer.profile.keys import is_setting
from printer_slicer.profile.tables import accepts_form, list_setting_definitions

__all__ = [
    "FamiliarSetting",
    "find_equivalent",
    "has_equivalent",
    "load_profile",
    "profile_with",
    "translate_changes",
    "translate_settings",
]


class FamiliarSetting(NamedTuple):
    """The settings of this program that correspond to a setting of another slicer.

    Attributes:
        slicer: the slicer that has a setting of this name; empty: nothing is to be changed.
        typed: the settings that the changes come from, as `NAME=VALUE`.
        changes: our setting -> value; empty if a later setting in the same command line makes the changes.
        notes: how the values were converted, where that is not obvious.
    """

    slicer: str
    typed: tuple[str, ...]
    changes: Mapping[str, Any]
    notes: tuple[str, ...] = ()


_NOTHING: Final = FamiliarSetting("", (), {})
_PRUSASLICER: Final = "PrusaSlicer"
_ORCASLICER: Final = "OrcaSlicer"
_CURA: Final = "Cura"
_DIALECTS: Final = {
    _PRUSASLICER: ("prusaslicer", DEFAULTS),
    _ORCASLICER: ("orca", ORCA_DEFAULTS),
    _CURA: ("cura", CURA_DEFAULTS),
}
"""Slicer -> its dialect, as in `Preset`, and its defaults."""

_COMMON_WORDS: Final[Mapping[str, str]] = {
    "density": "infill_density",
    "infill_percentage": "infill_density",
    "infill_percent": "infill_density",
    "pattern": "infill",
    "walls": "perimeters",
    "wall_count": "perimeters",
    "shells": "perimeters",
    "outlines": "perimeters",
    "loops": "perimeters",
    "layer": "layer_height",
    "height": "layer_height",
    "first_layer": "first_layer_height",
    "initial_layer": "first_layer_height",
    "initial_layer_height": "first_layer_height",
    "max_volumetric_speed": "max_flow",
    "hotend": "nozzle_temperature",
    "spiralize": "spiral",
    "supports": "support",
    "nozzle_temp": "nozzle_temperature",
    "hotend_temperature": "nozzle_temperature",
    "hotend_temp": "nozzle_temperature",
    "extruder_temperature": "nozzle_temperature",
    "extruder_temp": "nozzle_temperature",
    "print_temp": "nozzle_temperature",
    "temp": "nozzle_temperature",
    "print_temperature": "nozzle_temperature",
    "bed": "bed_temperature",
    "bed_temp": "bed_temperature",
    "nozzle": "nozzle_diameter",
    "nozzle_size": "nozzle_diameter",
    "flow": "flow_ratio",
    "flow_rate": "flow_ratio",
    "flowrate": "flow_ratio",
    "fan": "fan_ratio",
    "fan_speed": "fan_ratio",
    "speed": "speeds.perimeter",
    "print_speed": "speeds.perimeter",
    "speed_print": "speeds.perimeter",
    "feedrate": "speeds.perimeter",
    "linear_advance": "pressure_advance",
    "k_factor": "pressure_advance",
    "vase": "spiral",
    "vase_mode": "spiral",
    "retraction": "retract_length",
    "retraction_distance": "retract_length",
    "zhop": "z_hop",
    "z_lift": "z_hop",
    "brim": "brim_width",
    "skirt": "skirt_loops",
    "raft": "raft_height",
    "seam_type": "seam",
    "jerk": "jerk_xy",
    "baudrate": "baud",
}
"""Common word that is not the name of a setting -> the setting that it probably means."""

_UNITS: Final = {"mm": "MM", "mm/s": "SPEED", "°C": "DEGREES", "0-1": "PERCENT", "ratio": "PERCENT"}
"""Unit of a setting -> placeholder for its value in a suggestion."""

_ALWAYS_SET: Final = ("varying_walls",)  # settings that an import sets to the same value for every preset
_LARGEST_RATIO: Final = 2.0  # greater numbers are percentages
_RATIO_SETTINGS: Final = ("infill_density", "fan_ratio", "flow_ratio")


_PROBES: Final = {"seam_slope_type": "all", "raft_layers": "2"}
"""Settings without which others have no effect."""


def load_profile(
    printer: str | os.PathLike[str] | None = None,
    material: str | os.PathLike[str] | None = None,
    quality: str | os.PathLike[str] | None = None,
    changes: Mapping[str, object] | None = None,
    *,
    slices: bool = True,
    folders: Sequence[str | os.PathLike[str]] = (),
) -> Profile:
    """Load printer, material and quality, and apply changes.

    Args:
        printer: name of a profile or path of a TOML file; None: the default.
        material: likewise.
        quality: likewise.
        changes: `section.key`, or `key` if it is unique, -> value; or names and values of PrusaSlicer, OrcaSlicer and
            Cura. Text is converted to the setting's type, and ratios take percentages. A `layer_height` without a
            planner setting selects uniform layers. A key that ends with +, such as `overrides+`, appends rules.
        slices: whether parts are sliced with the profile; if so, conflicts between the three parts are errors.
        folders: folders of profiles that are searched before the user's and the shipped ones.

    Raises:
        ProfileError: a setting is invalid; names file, line, key and bound.
    """
    names = {"printer": printer, "material": material, "quality": quality}

    def load(own: Mapping[str, object] | None, *, slices: bool = False) -> Profile:
        return plain.load_profile(**names, changes=own, slices=slices, folders=folders)

    return load(translate_changes(changes, load)[0], slices=slices)


def profile_with(profile: Profile, changes: Mapping[str, object]) -> Profile:
    """Return a copy of a profile with some settings changed and all bounds checked.

    Args:
        profile: the profile, which is not changed.
        changes: as for `load_profile`.

    Raises:
        ProfileError: a setting does not exist, or a value is out of bounds.
    """

    def load(own: Mapping[str, object] | None) -> Profile:
        return plain.profile_with(profile, own or {})

    return plain.profile_with(profile, translate_changes(changes, load)[0] or {})


def translate_changes(
    changes: Mapping[str, object] | None, load: Callable[[Mapping[str, object] | None], Profile]
) -> tuple[Mapping[str, object] | None, tuple[str, ...]]:
    """Convert the settings of other slicers among changes; return all changes, and notes about the converted ones.

    Args:
        changes: names and values; a value that is no mapping is returned unchanged.
        load: function that returns the profile to be changed, with some changes of this program.

    Raises:
        ProfileError: a setting of another slicer is invalid or has no equivalent here.
    """
    if not isinstance(changes, Mapping):
        return changes, ()
    texts = [(str(key), _format_for_other_slicer(value)) for key, value in changes.items()]

    def load_own(own: Mapping[str, str]) -> Profile:
        return load({key: value for key, value in changes.items() if key in own})

    def write(name: str, text: str) -> str:
        """Write a setting as an argument of `slice`; other slicers write True as 1."""
        value = changes.get(name)
        return (
            f"{name.replace('.', '__')}={value}" if isinstance(value, bool) else _format_argument(name, text)
        )

    result: dict[str, object] = {}
    notes: list[str] = []
    found = translate_settings(texts, load_own, write)
    for (key, value), one in zip(changes.items(), found, strict=True):
        result |= {key: value} if one is None else one.changes
        if one is not None and one.changes:
            made = ", ".join(f"{name}={text}" for name, text in one.changes.items())
            notes.append(f"{one.slicer}'s {key.replace('.', '__')}={value!r} sets {made}")
    return result, tuple(notes)


def _format_for_other_slicer(value: object) -> str:
    """Format a setting's value as other slicers write it in their files."""
    if isinstance(value, bool):
        return str(int(value))
    return ",".join(map(str, value)) if isinstance(value, list | tuple) else str(value)


def _format_argument(name: str, value: str) -> str:
    """Format a setting as a keyword argument of `slice`, for messages."""
    is_number = value.removeprefix("-").replace(".", "", 1).isdigit()
    return f"{name.replace('.', '__')}={value if is_number else repr(value)}"


def has_equivalent(name: str) -> bool:
    """Return whether a setting of PrusaSlicer, OrcaSlicer or Cura has an equivalent here."""
    if name in CURA_SETTINGS or name in map_prusaslicer_names():
        return True
    if METADATA.fullmatch(name) or name == "printer_technology":
        return False
    theirs = ORCA_NAMES.get(name, name)
    return any(
        _has_effect(theirs, text, slicer)
        for slicer in (_PRUSASLICER, _ORCASLICER)
        for text in (_DIALECTS[slicer][1].get(theirs, "0"), "1")
    )


def find_equivalent(word: str) -> str:
    """Return our setting, without its section, for a word or a setting of another slicer; empty if unknown."""
    name = word.lower().replace("-", "_")
    known = {**_COMMON_WORDS, **map_prusaslicer_names()}
    return known.get(ORCA_NAMES.get(name, name), "") or known.get(f"{name}s", "")


def _has_effect(name: str, text: str, slicer: str) -> bool:
    """Return whether a setting of PrusaSlicer changes one of ours; an invalid value counts as a change."""
    entries = {key: SourceSetting(key, value, key) for key, value in {**_PROBES, name: text}.items()}
    try:
        return any(True for _ in _convert_entries(entries, frozenset({name}), slicer, (0.2, 0.2)))
    except ProfileError:
        return True


def _suggest_setting(name: str, text: str, profile: Profile) -> str:
    """Suggest the setting and value that a word probably means, such as `perimeters=3`; empty if unknown.

    If the setting does not take the value, it is replaced by a word such as MM.
    """
    key = _COMMON_WORDS.get(name.lower().replace("-", "_"), "")
    if not key:
        return ""
    if key == "support":
        text = {"1": "auto", "true": "auto", "0": "off", "false": "off"}.get(text.lower(), text)
    if key == "speeds.perimeter" and text.endswith("%"):
        key = "speeds.ratio"
    is_number = text.replace(".", "", 1).isdigit()
    if key in _RATIO_SETTINGS and is_number and float(text) > _LARGEST_RATIO:
        text = f"{text}%"
    for value in (text, "0") if text.lower() in OFF_WORDS else (text,):
        with suppress(ProfileError):
            plain.profile_with(profile, {key: value})
            return f"{key}={value}"
    unit = next((row.unit for row in list_setting_definitions() if row.key.partition(".")[2] == key), "")
    return f"{key}={_UNITS.get(unit, 'VALUE')}"


def translate_settings(
    given: Sequence[tuple[str, str]],
    load: Callable[[Mapping[str, str]], Profile],
    write: Callable[[str, str], str],
) -> list[FamiliarSetting | None]:
    """Convert the settings of other slicers among the given ones; the result has None for each of our own settings.

    Args:
        given: names and values, as the user wrote them.
        load: function that returns the profile to be changed, with some settings changed first; called only if there
            are settings of other slicers.
        write: function that writes a name and a value as the user would, for messages.

    Raises:
        ProfileError: a value is invalid, a setting has no equivalent here, or its name is a common word for a setting
            that has another name.
    """
    own = {name: text for name, text in given if _is_own(name, text)}
    foreign = {name: text for name, text in given if name not in own}
    if not foreign:
        return [None] * len(given)
    found = _convert_foreign(foreign, own, load(own), write)
    last = {name: i for i, (name, _) in enumerate(given)}
    return [
        found.get(name) if name in own or last[name] == i else _NOTHING for i, (name, _) in enumerate(given)
    ]


def _convert_foreign(
    foreign: Mapping[str, str], own: Collection[str], profile: Profile, write: Callable[[str, str], str]
) -> dict[str, FamiliarSetting]:
    """Convert settings of other slicers; leave out names that no slicer has."""
    slicers = _choose_slicers(foreign, own)
    for name, text in foreign.items():
        if not slicers[name]:
            _reject_common_word(name, text, profile, write)
    return _convert_together({name: foreign[name] for name in foreign if slicers[name]}, slicers, profile)


def _reject_common_word(name: str, text: str, profile: Profile, write: Callable[[str, str], str]) -> None:
    """Raise an error if a name is a common word for a setting that has another name."""
    if suggested := _suggest_setting(name, text, profile):
        key, _, value = suggested.partition("=")
        raise ProfileError(
            f"{write(name, text)}: no such setting", remedy=f"Did you mean {write(key, value)}?"
        )


def _is_own(name: str, text: str) -> bool:
    """Return whether a setting and its value belong to this program.

    Some names are also PrusaSlicer's: then a percentage of another setting, or a word that is unknown here, is
    PrusaSlicer's value.
    """
    if not is_setting(name) or accepts_form(name, text):
        return is_setting(name)
    return not (takes_percentage(name, "prusaslicer") if text.endswith("%") else has_equivalent(name))


def _choose_slicers(names: Collection[str], own: Collection[str]) -> dict[str, str]:
    """Return the slicer of each setting; empty if no slicer has it.

    If several slicers have a setting, it belongs to the one that most of the other settings belong to.
    """
    candidates = {name: _find_slicers(name, own) for name in names}
    certain = Counter(found[0] for found in candidates.values() if len(found) == 1)
    return {
        name: max(found, key=lambda slicer: certain[slicer], default="") for name, found in candidates.items()
    }


def _find_slicers(name: str, own: Collection[str]) -> list[str]:
    """Return the slicers that have a setting of this name, the most probable first."""
    if name == "ironing_type" and "ironing" not in own:
        return [_ORCASLICER]  # PrusaSlicer's has an effect only together with `ironing`
    renamed = name in ORCA_NAMES.values()
    is_cura = name in CURA_SETTINGS
    in_table = name in DEFAULTS or (name in map_prusaslicer_names() and not is_cura)
    found = [_PRUSASLICER] if in_table and name not in ORCA_ONLY else []
    if name in ORCA_NAMES or name in ORCA_ONLY or (in_table and not renamed):
        found.append(_ORCASLICER)
    if is_cura:
        found.append(_CURA)
    return found or ([_PRUSASLICER] if has_equivalent(name) else [])


def _convert_together(
    typed: Mapping[str, str], slicers: Mapping[str, str], profile: Profile
) -> dict[str, FamiliarSetting]:
    """Convert settings; return for each name the changes that it makes, alone or with the settings before it.

    Raises:
        ProfileError: a value is invalid, or a setting has no equivalent here.
    """
    entries, owners = _translate_names(typed, slicers, profile)
    made: dict[str, ConvertedSetting] = {}
    for slicer in dict.fromkeys(slicers[name] for name in typed):
        names = frozenset(key for key in entries if slicers[owners[key][-1]] == slicer)
        base = {
            key: SourceSetting(key, text, key) for key, text in describe_profile(profile, entries).items()
        }
        made |= dict(_convert_entries({**base, **entries}, names, slicer, _get_layer_heights(profile)))
    order = list(typed)
    makers = {
        ours: sorted({name for key in one.sources for name in owners.get(key, ())}, key=order.index)
        for ours, one in made.items()
    }
    return {
        name: _collect_changes(name, typed, slicers[name], made, makers)
        or _copy_equal_setting(name, typed[name], slicers[name], profile)
        for name in typed
    }


def _get_layer_heights(profile: Profile) -> tuple[float, float]:
    """Return the heights of the first layer and of the other layers, for settings that count layers."""
    return profile.quality.first_layer_height or profile.quality.layer_height, profile.quality.layer_height


def _translate_names(
    typed: Mapping[str, str], slicers: Mapping[str, str], profile: Profile
) -> tuple[dict[str, SourceSetting], dict[str, tuple[str, ...]]]:
    """Return the settings under PrusaSlicer's names, and for each of them the typed settings that it comes from."""
    entries: dict[str, SourceSetting] = {}
    owners: dict[str, tuple[str, ...]] = {}
    for name, text in typed.items():
        if slicers[name] != _CURA:
            theirs = ORCA_NAMES.get(name, name) if slicers[name] == _ORCASLICER else name
            entries[theirs], owners[theirs] = SourceSetting(name, text, f"{name}={text}"), (name,)
    own = map_prusaslicer_names()
    cura = {name: text for name, text in typed.items() if slicers[name] == _CURA and name not in own}
    found = translate_cura_settings(cura, profile)
    for theirs, one in found.items():
        entries[theirs], owners[theirs] = one
    return entries, owners


def _collect_changes(
    name: str,
    typed: Mapping[str, str],
    slicer: str,
    made: Mapping[str, ConvertedSetting],
    makers: Mapping[str, Sequence[str]],
) -> FamiliarSetting | None:
    """Return the changes for which a setting is the last one they depend on; None if no change depends on it.

    Args:
        name: name of the setting, as it was typed.
        typed: all settings.
        slicer: the slicer of the setting.
        made: our setting -> how it was converted.
        makers: our setting -> the typed settings that it comes from.
    """
    if not any(name in names for names in makers.values()):
        return None
    own = {ours: made[ours] for ours, names in makers.items() if names[-1] == name}
    together = {one for ours in own for one in makers[ours]}
    notes = dict.fromkeys(one.how for one in own.values() if one.how)
    return FamiliarSetting(
        slicer,
        tuple(f"{one}={text}" for one, text in typed.items() if one in together),
        {ours: one.value for ours, one in own.items()},
        tuple(notes),
    )


def _copy_equal_setting(name: str, text: str, slicer: str, profile: Profile) -> FamiliarSetting:
    """Copy the value of a setting that exists here too, but that imports do not convert.

    Raises:
        ProfileError: the setting has no equivalent here, or no effect.
    """
    ours = map_prusaslicer_names().get(name, "").removeprefix("quality.")
    found = [key for key, _ in list_settings(profile) if ours and key.partition(".")[2] == ours]
    if found:
        return FamiliarSetting(slicer, (f"{name}={text}",), {found[0]: text})
    if slicer == _CURA:
        return FamiliarSetting(slicer, (f"{name}={text}",), {}, ("it changes nothing",))
    if has_equivalent(name):
        raise ProfileError(
            f"{name}={text}: this setting of {slicer} has no effect with the other settings",
            remedy="Leave it out, or set what it depends on too",
        )
    raise ProfileError(
        f"{name}={text}: this setting of {slicer} has no equivalent here",
        remedy="`printer-slicer profiles settings` lists all settings",
    )


def _convert_entries(
    entries: Mapping[str, SourceSetting], typed: frozenset[str], slicer: str, heights: tuple[float, float]
) -> Iterator[tuple[str, ConvertedSetting]]:
    """Convert settings as an import does; yield name and conversion of our settings that depend on typed ones.

    Args:
        entries: settings under PrusaSlicer's names.
        typed: names of those that were typed.
        slicer: the slicer whose percentages and words they have.
        heights: heights of the first layer and of the other layers, mm.

    Raises:
        ProfileError: a value is invalid.
    """
    dialect, defaults = _DIALECTS[slicer]
    for kind, convert in _CONVERSIONS.items():
        preset = Preset(
            kind, "settings", dialect, "settings", entries, defaults, mixed=True, heights=heights, typed=typed
        )
        for one in convert(preset).taken:
            if typed.intersection(one.sources) and one.ours not in _ALWAYS_SET:
                yield f"{kind}.{one.ours}", one


def _convert_printer(preset: Preset) -> ImportedProfile:
    """Convert settings of a printer without materials and qualities."""
    return convert_printer(preset, CompanionRanges())


_CONVERSIONS: Final[Mapping[str, Callable[[Preset], ImportedProfile]]] = {
    "printer": _convert_printer,
    "material": convert_material,
    "quality": convert_quality,
}
