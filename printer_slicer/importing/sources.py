"""Files of other slicers as presets: what kind of file it is, and what it holds."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from printer_slicer.errors import ProfileError
from printer_slicer.importing.bundle import Bundle, bundle_of
from printer_slicer.importing.cura import cura_presets, cura_profile, is_definition
from printer_slicer.importing.embedded import config_in_3mf, config_in_gcode
from printer_slicer.importing.ini import GIVE, Entry, Section, read_sections, split_texts, unescaped
from printer_slicer.importing.objects import own_in_3mf
from printer_slicer.importing.orca import OrcaFolder, orca_presets, read_json
from printer_slicer.importing.presets import Preset
from printer_slicer.importing.report import Imported, Taken
from printer_slicer.importing.unpacking import text_of
from printer_slicer.importing.vocabulary import DEFAULTS
from printer_slicer.profile.gcode_settings import is_printer_slicer_gcode, settings_in_gcode
from printer_slicer.profile.reading import flatten

__all__ = ["Found", "presets_in"]

_REMARKED: Final = re.compile(r";\s*[a-z]\w* =")
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

Found = Bundle | list[Preset] | list[Imported]


def presets_in(path: Path, folders: Sequence[Path] = (), cura: Mapping[str, str] = _NO_CHANGES) -> Found:
    """What a file holds: a bundle, one preset of each kind that it knows something about, or profiles of ours.

    Args:
        path: `config.ini`, a bundle, G-code, 3MF, or a preset of OrcaSlicer or BambuStudio.
        folders: where presets are that others inherit from, besides the file's own.
        cura: changes of Cura's settings.

    Raises:
        ProfileError: it cannot be read, or holds no settings; with place and remedy.
    """
    if path.exists() and not (path.is_file() or path.is_dir()):
        raise ProfileError(f"{path}: is a pipe or a device, not a file", remedy="save the settings to a file")
    try:
        changes = {key: Entry(key, text, f"--cura {key}={text}") for key, text in cura.items()}
        if path.name.endswith((".inst.cfg", ".curaprofile")):
            return _cura_profile(path, folders, changes)
        if path.suffix.lower() in _GCODE and is_printer_slicer_gcode(path):
            return [_own_profile(kind, part, path) for kind, part in settings_in_gcode(path).items()]
        return _presets_in(path, folders, changes)
    except OSError as error:
        raise ProfileError(
            f"{path}: cannot be read: {error.strerror or error}", remedy="check name and permissions"
        ) from None


def _cura_profile(path: Path, folders: Sequence[Path], changes: Mapping[str, Entry]) -> list[Preset]:
    """A profile of Cura's, with the machine that it names."""
    text = "" if path.suffix == ".curaprofile" else text_of(path)
    machine, name, given = cura_profile(path, text)
    places = [folder / f"{machine}.def.json" for folder in (path.parent, *folders)]
    found = next((place for place in places if "/" not in machine and place.is_file()), None)
    if found is None:
        raise ProfileError(
            f"{path}: its machine {machine!r} is not beside it",
            remedy="name the folder of Cura's definitions with --folder",
        )
    values = read_json(text_of(found), str(found))
    return cura_presets(values, found, folders, {**given, **changes}, name)


def _presets_in(path: Path, folders: Sequence[Path], changes: Mapping[str, Entry]) -> Bundle | list[Preset]:
    with path.open("rb") as file:
        magic = file.read(4)
    if magic.startswith(b"PK"):
        name, text = config_in_3mf(path)
        return _with_own(_from_text(text, f"{path}: {name}", path, folders, {}), path)
    if path.suffix.lower() in _GCODE:
        lines = config_in_gcode(path)
        section = Section("", f"{path}:{lines[0][0]}")
        for number, line in lines:
            key, _, value = line.partition("=")
            section.entries[key.strip()] = Entry(key.strip(), value.strip(), f"{path}:{number}")
        return _flat(section, path)
    return _from_text(text_of(path), str(path), path, folders, changes)


def _with_own(found: Bundle | list[Preset], path: Path) -> Bundle | list[Preset]:
    """The presets of a project, the quality with what objects have of their own."""
    if isinstance(found, Bundle):
        return found
    own, notes = own_in_3mf(path)
    return [replace(one, own=own, notes=notes) if one.kind == "quality" else one for one in found]


def _from_text(
    text: str, place: str, path: Path, folders: Sequence[Path], changes: Mapping[str, Entry]
) -> Bundle | list[Preset]:
    if text.lstrip("\ufeff \t\r\n").startswith("{"):
        values = read_json(text.lstrip("\ufeff"), place)
        if is_definition(values) or path.name.endswith(".def.json"):
            return cura_presets(values, path, folders, changes)
        return orca_presets(values, place, OrcaFolder([path.parent, *folders]))
    lines = text.splitlines()
    if place != str(path):  # in 3MF files settings stand as comments
        lines = [line.lstrip("; ") if _REMARKED.match(line) else line for line in lines]
    sections = read_sections(lines, place)
    dialect = _dialect(text, {key for section in sections for key in section.entries})
    bundle = bundle_of(sections, dialect, place)
    if bundle is not None:
        return bundle
    return _flat(sections[0], path, dialect)


def _dialect(text: str, keys: set[str]) -> str:
    """Which program a file is of; percentages of widths hang on it."""
    head = text[:300].lower()
    if "superslicer" in head or sum(key in keys for key in _SUPERSLICER) >= 2:
        return "superslicer"
    return "prusaslicer"


def _flat(section: Section, path: Path, dialect: str = "") -> list[Preset]:
    """The presets in one set of settings: those of which it says anything that matters."""
    entries = section.entries
    if "printable_area" in entries or "wall_loops" in entries:
        return orca_presets({key: _plain(entry) for key, entry in entries.items()}, str(path), OrcaFolder([]))
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
            f"{path}: no settings of a printer, a filament or a print",
            remedy=GIVE,
        )
    return presets


def _plain(entry: Entry) -> str | list[str]:
    """A value in a file of OrcaSlicer that is no JSON."""
    if entry.name.endswith(("gcode", "notes")):
        several = split_texts(entry.text) if entry.text.startswith('"') else []
        return several if len(several) > 1 else unescaped(entry.text)
    return [word.strip().strip('"') for word in entry.text.split(",")]


def _own_profile(kind: str, part: dict[str, Any], path: Path) -> Imported:
    """A profile of G-code that this program wrote, with all its settings as they were."""
    taken = tuple(Taken(f"{kind}.{key}", str(value), key, value) for key, value in flatten(part))
    return Imported(kind, str(part["name"]) or path.stem, str(path), part, taken)
