"""Read the object settings of a 3MF project, for slicing it with another profile."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from printer_slicer.errors import ProfileError
from printer_slicer.importing.archives import read_archive
from printer_slicer.importing.embedded_settings import OBJECTS_IN_3MF, SETTINGS_IN_3MF
from printer_slicer.importing.ini import SourceSetting
from printer_slicer.importing.object_overrides import flatten_settings, overridable_settings
from printer_slicer.importing.orca_names import ORCA_DEFAULTS
from printer_slicer.importing.presets import ObjectSettings, Preset, parse_quantity
from printer_slicer.importing.project_objects import read_object_settings
from printer_slicer.importing.prusaslicer_names import DEFAULTS
from printer_slicer.importing.qualities import convert_quality
from printer_slicer.importing.results import ImportedProfile
from printer_slicer.importing.source_files import read_presets
from printer_slicer.profile import Profile

__all__ = ["Project", "read_project"]


@dataclass(frozen=True, slots=True)
class Project:
    """Object settings of a 3MF file.

    Attributes:
        overrides: a table for each object or height range, as in `quality.overrides`.
        layer_heights: object -> uniform layer height, mm.
        used: the settings that are used, one line per object.
        unused: the settings that are not used, and why.
        has_settings: whether the file has print, filament or printer settings.
    """

    overrides: tuple[Mapping[str, Any], ...] = ()
    layer_heights: tuple[tuple[str, float], ...] = ()
    used: tuple[str, ...] = ()
    unused: tuple[str, ...] = ()
    has_settings: bool = False


def read_project(path: Path, profile: Profile, names: Collection[str]) -> Project:
    """Read the object settings of a 3MF file.

    Args:
        path: the file; one that no slicer wrote has no settings.
        profile: the profile for slicing. Its nozzle and layer height convert percentages and layer counts where
            the project has none.
        names: objects to print; settings of others are ignored.

    Raises:
        ProfileError: the archive is damaged.
    """
    has_settings = bool(read_archive(path, set(SETTINGS_IN_3MF)))
    try:
        owns, notes = read_object_settings(path)
    except ProfileError as error:
        return Project(
            unused=(f"its object settings are not used: {error.args[0]}",),
            has_settings=has_settings,
        )
    base = _base(path, profile) if owns else None
    made = [_of_object(own, base) for own in owns if own.object in names] if base else []
    return Project(
        tuple(table for one in made for table in one.overrides),
        tuple(height for one in made for height in one.layer_heights),
        tuple(text for one in made for text in one.used),
        (*(note.text for note in notes), *(text for one in made for text in one.unused)),
        has_settings,
    )


def _base(path: Path, profile: Profile) -> Preset:
    """Return the settings of the project that apply to all objects."""
    context = {"nozzle_diameter": f"{profile.printer.nozzle_diameter:g}"}
    height = SourceSetting("layer_height", f"{profile.quality.layer_height:g}", str(path))
    try:
        found = read_presets(path)
    except ProfileError:
        found = []
    for one in found if isinstance(found, list) else ():
        if isinstance(one, Preset) and one.kind == "quality":
            return replace(one, own=(), notes=(), context={**context, **one.context})
    dialect, defaults = (
        ("orca", ORCA_DEFAULTS) if read_archive(path, {OBJECTS_IN_3MF[1]}) else ("prusaslicer", DEFAULTS)
    )
    return Preset("quality", path.stem, dialect, str(path), {height.name: height}, defaults, context=context)


def _of_object(own: ObjectSettings, base: Preset) -> Project:
    """Convert the settings of one object or height range."""
    plain = {name: entry for name, entry in own.entries.items() if name != "layer_height"}
    try:
        before = convert_quality(base)
        made = convert_quality(replace(base, entries={**base.entries, **plain}))
    except ProfileError as error:
        return Project(unused=(f"{own.where}: its settings are not used: {error.args[0]}",))
    asked = {entry.name for entry in plain.values()}
    known, values = dict(flatten_settings(before.values)), dict(flatten_settings(made.values))
    wanted = {key for key, value in values.items() if known.get(key) != value}
    wanted |= {one.ours for one in made.taken if one.theirs in asked}
    kept = {
        key: values[key]
        for key in wanted
        if key in values and key in overridable_settings(heights=bool(own.high))
    }
    table: dict[str, Any] = {"object": own.object, "set": dict(sorted(kept.items()))}
    if own.high:
        table |= {"low": own.low, "high": own.high}
    heights, lost = _layer_heights(own)
    told = ", ".join(
        f"{key} = {value}"
        for key, value in [*sorted(kept.items()), *(("layer_height", height) for _, height in heights)]
    )
    lost += _lost(made, asked, kept)
    return Project(
        (table,) if kept else (),
        heights,
        (f"{own.where}: {told} (from the project)",) if told else (),
        tuple(f"{own.where}: {text}" for text in lost),
    )


def _layer_heights(own: ObjectSettings) -> tuple[tuple[tuple[str, float], ...], list[str]]:
    """Return the uniform layer height of an object, if it has one, and why it is not used, if so."""
    entry = own.entries.get("layer_height")
    if entry is None:
        return (), []
    found = parse_quantity(entry.text)
    if own.alone and not own.high and found and found.value > 0:
        return ((own.object, found.value),), []
    why = "all objects of a plate have the same layers"
    if own.alone:
        why = "`printer-slicer profiles import` converts it to height ranges of the planner"
    return (), [f"{entry.name} = {entry.text} is not used: {why}"]


def _lost(made: ImportedProfile, asked: set[str], kept: Collection[str]) -> list[str]:
    """List the settings of an object that are not used, with the reason."""
    lost = [f"{one.theirs} = {one.text} is not used: {one.why}" for one in made.left if one.theirs in asked]
    used = {one.theirs for one in made.taken if one.ours in kept}
    return lost + [
        f"{one.theirs} = {one.text} is not used: {one.ours} is the same for the whole plate here"
        for one in made.taken
        if one.theirs in asked - used and one.ours not in kept
    ]
