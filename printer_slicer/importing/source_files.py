"""Read presets from all kinds of files of other slicers."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from printer_slicer.errors import ProfileError
from printer_slicer.importing.archives import read_text
from printer_slicer.importing.bundle import PresetBundle, group_sections
from printer_slicer.importing.cura import is_cura_definition, make_cura_presets, read_cura_profile
from printer_slicer.importing.embedded_settings import read_3mf_settings, read_gcode_settings
from printer_slicer.importing.ini import (
    FILE_REMEDY,
    IniSection,
    SourceSetting,
    read_sections,
    split_texts,
    unescape,
)
from printer_slicer.importing.orca import PresetFolders, make_orca_presets, read_json
from printer_slicer.importing.presets import Preset
from printer_slicer.importing.project_objects import read_object_settings
from printer_slicer.importing.prusaslicer_names import DEFAULTS
from printer_slicer.importing.results import ConvertedSetting, ImportedProfile
from printer_slicer.input_files import is_gcode
from printer_slicer.profile.gcode_settings import is_printer_slicer_gcode, read_settings_from_gcode
from printer_slicer.profile.reading import flatten_tables
from printer_slicer.values import replace

__all__ = ["PresetsInFile", "read_presets"]

_COMMENTED_SETTING: Final = re.compile(r";\s*[a-z]\w* =")
_SUPERSLICER_SETTINGS: Final = (
    "init_z_rotate",
    "extrusion_spacing",
    "perimeter_overlap",
    "bridge_speed_internal",
    "gap_fill",
)
_MAIN_SETTINGS: Final = {
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
_NAME_SETTINGS: Final = {
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
        folders: other folders with presets that those in the file inherit from.
        cura: values that replace those of Cura's settings.

    Raises:
        ProfileError: the file cannot be read, or has no settings; with place and remedy.
    """
    if path.exists() and not (path.is_file() or path.is_dir()):
        raise ProfileError(
            f"{path}: this is a pipe or a device, not a file", remedy="Save the settings to a file"
        )
    try:
        changes = {key: SourceSetting(key, text, f"--cura {key}={text}") for key, text in cura.items()}
        if path.name.endswith((".inst.cfg", ".curaprofile")):
            return _load_cura_profile(path, folders, changes)
        if is_gcode(path) and is_printer_slicer_gcode(path):
            return [
                _make_native_profile(kind, part, path)
                for kind, part in read_settings_from_gcode(path).items()
            ]
        return _read_presets(path, folders, changes)
    except OSError as error:
        raise ProfileError(
            f"{path}: cannot be read: {error.strerror or error}", remedy="Check its name and permissions"
        ) from None


def _load_cura_profile(
    path: Path, folders: Sequence[Path], changes: Mapping[str, SourceSetting]
) -> list[Preset]:
    """Read a profile of Cura together with the machine that it names."""
    text = "" if path.suffix == ".curaprofile" else read_text(path)
    machine, name, given = read_cura_profile(path, text)
    places = [folder / f"{machine}.def.json" for folder in (path.parent, *folders)]
    found = next((place for place in places if "/" not in machine and place.is_file()), None)
    if found is None:
        raise ProfileError(
            f"{path}: its machine {machine!r} is not in the same folder",
            remedy="Give the folder of Cura's definitions with --folder FOLDER",
        )
    values = read_json(read_text(found), str(found))
    return make_cura_presets(values, found, folders, {**given, **changes}, name)


def _read_presets(
    path: Path, folders: Sequence[Path], changes: Mapping[str, SourceSetting]
) -> PresetBundle | list[Preset]:
    """Read the presets in a 3MF file, in G-code or in a text file of another slicer."""
    with path.open("rb") as file:
        magic = file.read(4)
    if magic.startswith(b"PK"):
        name, text = read_3mf_settings(path)
        return _add_object_settings(_parse_presets(text, f"{path}: {name}", path, folders, {}), path)
    if is_gcode(path):
        lines = read_gcode_settings(path)
        section = IniSection("", f"{path}:{lines[0][0]}")
        for number, line in lines:
            key, _, value = line.partition("=")
            section.entries[key.strip()] = SourceSetting(key.strip(), value.strip(), f"{path}:{number}")
        return _split_section_by_kind(section, path)
    return _parse_presets(read_text(path), str(path), path, folders, changes)


def _add_object_settings(found: PresetBundle | list[Preset], path: Path) -> PresetBundle | list[Preset]:
    """Add the settings of single objects to the quality of a project; other presets stay unchanged."""
    if isinstance(found, PresetBundle):
        return found
    own, notes = read_object_settings(path)
    return [replace(one, object_settings=own, notes=notes) if one.kind == "quality" else one for one in found]


def _parse_presets(
    text: str, place: str, path: Path, folders: Sequence[Path], changes: Mapping[str, SourceSetting]
) -> PresetBundle | list[Preset]:
    """Parse the presets in a JSON or INI text."""
    if text.lstrip("\ufeff \t\r\n").startswith("{"):
        values = read_json(text.lstrip("\ufeff"), place)
        if is_cura_definition(values) or path.name.endswith(".def.json"):
            return make_cura_presets(values, path, folders, changes)
        return make_orca_presets(values, place, PresetFolders([path.parent, *folders]))
    lines = text.splitlines()
    if place != str(path):  # settings in 3MF files are comments
        lines = [line.lstrip("; ") if _COMMENTED_SETTING.match(line) else line for line in lines]
    sections = read_sections(lines, place)
    dialect = _detect_dialect(text, {key for section in sections for key in section.entries})
    bundle = group_sections(sections, dialect, place)
    if bundle is not None:
        return bundle
    return _split_section_by_kind(sections[0], path, dialect)


def _detect_dialect(text: str, keys: set[str]) -> str:
    """Return the slicer that wrote a file, which determines the meaning of percentages."""
    head = text[:300].lower()
    if "superslicer" in head or sum(key in keys for key in _SUPERSLICER_SETTINGS) >= 2:
        return "superslicer"
    return "prusaslicer"


def _split_section_by_kind(section: IniSection, path: Path, dialect: str = "") -> list[Preset]:
    """Split one set of settings into up to three presets: one for each kind whose main settings it contains."""
    entries = section.entries
    if "printable_area" in entries or "wall_loops" in entries:
        return make_orca_presets(
            {key: _parse_orca_value(entry) for key, entry in entries.items()}, str(path), PresetFolders([])
        )
    dialect = dialect or _detect_dialect("", set(entries))
    presets = []
    for kind, marks in _MAIN_SETTINGS.items():
        if any(mark in entries for mark in marks):
            label = entries.get(_NAME_SETTINGS[kind])
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


def _parse_orca_value(entry: SourceSetting) -> str | list[str]:
    """Convert a value from a file of OrcaSlicer that is not JSON to the form that it has in JSON files."""
    if entry.name.endswith(("gcode", "notes")):
        several = split_texts(entry.text) if entry.text.startswith('"') else []
        return several if len(several) > 1 else unescape(entry.text)
    return [word.strip().strip('"') for word in entry.text.split(",")]


def _make_native_profile(kind: str, part: dict[str, Any], path: Path) -> ImportedProfile:
    """Make a profile from settings in G-code of this program."""
    taken = tuple(
        ConvertedSetting(f"{kind}.{key}", str(value), key, value) for key, value in flatten_tables(part)
    )
    return ImportedProfile(kind, str(part["name"]) or path.stem, str(path), part, taken)
