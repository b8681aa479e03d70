"""Read presets from files of other slicers, whatever kind of file it is."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from printer_slicer.errors import ProfileError
from printer_slicer.importing.archives import read_text
from printer_slicer.importing.bundle import PresetBundle, find_bundle
from printer_slicer.importing.cura import cura_presets, is_cura_definition, read_cura_profile
from printer_slicer.importing.embedded_settings import read_3mf_settings, read_gcode_settings
from printer_slicer.importing.ini import (
    FILE_REMEDY,
    IniSection,
    SourceSetting,
    read_sections,
    split_texts,
    unescape,
)
from printer_slicer.importing.orca import PresetFolders, orca_presets, read_json
from printer_slicer.importing.presets import Preset
from printer_slicer.importing.project_objects import read_object_settings
from printer_slicer.importing.prusaslicer_names import DEFAULTS
from printer_slicer.importing.results import ConvertedSetting, ImportedProfile
from printer_slicer.profile.gcode_settings import is_printer_slicer_gcode, settings_in_gcode
from printer_slicer.profile.reading import flatten

__all__ = ["PresetsInFile", "read_presets"]

_COMMENTED: Final = re.compile(r";\s*[a-z]\w* =")
_GCODE: Final = (".gcode", ".gco", ".g", ".nc", ".ngc")
_SUPERSLICER: Final = (
    "init_z_rotate",
    "extrusion_spacing",
    "perimeter_overlap",
    "bridge_speed_internal",
    "gap_fill",
)
_MARKS: Final = {
    "printer": ("bed_shape", "start_gcode", "machine_max_feedrate_x", "gcode_flavor", "max_print_height"),
    "material": (
        "temperature",
        "first_layer_temperature",
        "filament_type",
        "extrusion_multiplier",
        "bed_temperature",
    ),
    "quality": ("layer_height", "perimeters", "fill_density", "perimeter_speed", "infill_speed"),
}
_LABELS: Final = {
    "printer": "printer_settings_id",
    "material": "filament_settings_id",
    "quality": "print_settings_id",
}

_NO_CHANGES: Final[Mapping[str, str]] = {}

PresetsInFile = PresetBundle | list[Preset] | list[ImportedProfile]


def read_presets(
    path: Path, folders: Sequence[Path] = (), cura: Mapping[str, str] = _NO_CHANGES
) -> PresetsInFile:
    """Read the presets in a file: a bundle, up to one preset of each kind, or profiles of this program.

    Args:
        path: `config.ini`, a bundle, G-code, 3MF, or a preset of OrcaSlicer, BambuStudio or Cura.
        folders: other folders with the presets that others inherit from.
        cura: values that replace those of Cura's settings.

    Raises:
        ProfileError: the file cannot be read, or has no settings; with place and remedy.
    """
    if path.exists() and not (path.is_file() or path.is_dir()):
        raise ProfileError(f"{path}: is a pipe or a device, not a file", remedy="Save the settings to a file")
    try:
        changes = {key: SourceSetting(key, text, f"--cura {key}={text}") for key, text in cura.items()}
        if path.name.endswith((".inst.cfg", ".curaprofile")):
            return _cura_profile(path, folders, changes)
        if path.suffix.lower() in _GCODE and is_printer_slicer_gcode(path):
            return [_native_profile(kind, part, path) for kind, part in settings_in_gcode(path).items()]
        return _read_presets(path, folders, changes)
    except OSError as error:
        raise ProfileError(
            f"{path}: cannot be read: {error.strerror or error}", remedy="Check its name and permissions"
        ) from None


def _cura_profile(path: Path, folders: Sequence[Path], changes: Mapping[str, SourceSetting]) -> list[Preset]:
    """Read a profile of Cura together with the machine that it names."""
    text = "" if path.suffix == ".curaprofile" else read_text(path)
    machine, name, given = read_cura_profile(path, text)
    places = [folder / f"{machine}.def.json" for folder in (path.parent, *folders)]
    found = next((place for place in places if "/" not in machine and place.is_file()), None)
    if found is None:
        raise ProfileError(
            f"{path}: its machine {machine!r} is not in the same folder",
            remedy="Name the folder with Cura's definitions with --folder",
        )
    values = read_json(read_text(found), str(found))
    return cura_presets(values, found, folders, {**given, **changes}, name)


def _read_presets(
    path: Path, folders: Sequence[Path], changes: Mapping[str, SourceSetting]
) -> PresetBundle | list[Preset]:
    with path.open("rb") as file:
        magic = file.read(4)
    if magic.startswith(b"PK"):
        name, text = read_3mf_settings(path)
        return _with_object_settings(_from_text(text, f"{path}: {name}", path, folders, {}), path)
    if path.suffix.lower() in _GCODE:
        lines = read_gcode_settings(path)
        section = IniSection("", f"{path}:{lines[0][0]}")
        for number, line in lines:
            key, _, value = line.partition("=")
            section.entries[key.strip()] = SourceSetting(key.strip(), value.strip(), f"{path}:{number}")
        return _presets_in_section(section, path)
    return _from_text(read_text(path), str(path), path, folders, changes)


def _with_object_settings(found: PresetBundle | list[Preset], path: Path) -> PresetBundle | list[Preset]:
    """Return the presets of a project, the quality with the settings of single objects."""
    if isinstance(found, PresetBundle):
        return found
    own, notes = read_object_settings(path)
    return [replace(one, own=own, notes=notes) if one.kind == "quality" else one for one in found]


def _from_text(
    text: str, place: str, path: Path, folders: Sequence[Path], changes: Mapping[str, SourceSetting]
) -> PresetBundle | list[Preset]:
    if text.lstrip("\ufeff \t\r\n").startswith("{"):
        values = read_json(text.lstrip("\ufeff"), place)
        if is_cura_definition(values) or path.name.endswith(".def.json"):
            return cura_presets(values, path, folders, changes)
        return orca_presets(values, place, PresetFolders([path.parent, *folders]))
    lines = text.splitlines()
    if place != str(path):  # settings in 3MF files are comments
        lines = [line.lstrip("; ") if _COMMENTED.match(line) else line for line in lines]
    sections = read_sections(lines, place)
    dialect = _dialect(text, {key for section in sections for key in section.entries})
    bundle = find_bundle(sections, dialect, place)
    if bundle is not None:
        return bundle
    return _presets_in_section(sections[0], path, dialect)


def _dialect(text: str, keys: set[str]) -> str:
    """Return the slicer that wrote a file, which decides what percentages mean."""
    head = text[:300].lower()
    if "superslicer" in head or sum(key in keys for key in _SUPERSLICER) >= 2:
        return "superslicer"
    return "prusaslicer"


def _presets_in_section(section: IniSection, path: Path, dialect: str = "") -> list[Preset]:
    """Return the presets in one set of settings: each kind of which it has a main setting."""
    entries = section.entries
    if "printable_area" in entries or "wall_loops" in entries:
        return orca_presets(
            {key: _plain(entry) for key, entry in entries.items()}, str(path), PresetFolders([])
        )
    dialect = dialect or _dialect("", set(entries))
    presets = []
    for kind, marks in _MARKS.items():
        if any(mark in entries for mark in marks):
            label = entries.get(_LABELS[kind])
            name = next((one for one in split_texts(label.text) if one), "") if label else ""
            presets.append(
                Preset(kind, name or path.stem, dialect, section.place, entries, DEFAULTS, mixed=True)
            )
    if not presets:
        raise ProfileError(
            f"{path}: no printer, filament or print settings",
            remedy=FILE_REMEDY,
        )
    return presets


def _plain(entry: SourceSetting) -> str | list[str]:
    """Return a value of an OrcaSlicer file that is not JSON, as it would be in JSON."""
    if entry.name.endswith(("gcode", "notes")):
        several = split_texts(entry.text) if entry.text.startswith('"') else []
        return several if len(several) > 1 else unescape(entry.text)
    return [word.strip().strip('"') for word in entry.text.split(",")]


def _native_profile(kind: str, part: dict[str, Any], path: Path) -> ImportedProfile:
    """Return a profile in G-code of this program, with all its settings."""
    taken = tuple(ConvertedSetting(f"{kind}.{key}", str(value), key, value) for key, value in flatten(part))
    return ImportedProfile(kind, str(part["name"]) or path.stem, str(path), part, taken)
