"""Read the object settings of a 3MF project, for slicing it with another profile."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

from printer_slicer.errors import ProfileError
from printer_slicer.importing.archives import read_archive
from printer_slicer.importing.embedded_settings import OBJECTS_IN_3MF, SETTINGS_IN_3MF
from printer_slicer.importing.ini import SourceSetting
from printer_slicer.importing.object_overrides import (
    explain_common_setting,
    flatten_settings,
    list_overridable_settings,
)
from printer_slicer.importing.orca_names import ORCA_DEFAULTS
from printer_slicer.importing.presets import ObjectSettings, Preset, parse_quantity
from printer_slicer.importing.project_objects import read_object_settings
from printer_slicer.importing.prusaslicer_names import DEFAULTS
from printer_slicer.importing.qualities import convert_quality
from printer_slicer.importing.results import ImportedProfile
from printer_slicer.importing.source_files import read_presets
from printer_slicer.profile import Profile
from printer_slicer.values import Struct, replace

__all__ = ["Project", "read_project"]


class Project(Struct, frozen=True):
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
        path: the file; it has no settings if no slicer wrote it.
        profile: the profile for slicing. Its nozzle and layer height are used to convert percentages and layer counts
            if the project does not set them.
        names: objects and modifiers of the print; settings of others are ignored.

    Raises:
        ProfileError: the archive is damaged.
    """
    has_settings = bool(read_archive(path, set(SETTINGS_IN_3MF)))
    try:
        object_settings, notes = read_object_settings(path)
    except ProfileError as error:
        return Project(
            unused=(f"its object settings are not used: {error.args[0]}",),
            has_settings=has_settings,
        )
    base = _read_common_settings(path, profile) if object_settings else None
    made = (
        [_convert_object(settings, base) for settings in object_settings if settings.object in names]
        if base
        else []
    )
    return Project(
        tuple(table for one in made for table in one.overrides),
        tuple(height for one in made for height in one.layer_heights),
        tuple(text for one in made for text in one.used),
        (*(note.text for note in notes), *(text for one in made for text in one.unused)),
        has_settings,
    )


def _read_common_settings(path: Path, profile: Profile) -> Preset:
    """Read the settings of a project that apply to all objects."""
    context = {"nozzle_diameter": f"{profile.printer.nozzle_diameter:g}"}
    height = SourceSetting("layer_height", f"{profile.quality.layer_height:g}", str(path))
    try:
        found = read_presets(path)
    except ProfileError:
        found = []
    for one in found if isinstance(found, list) else ():
        if isinstance(one, Preset) and one.kind == "quality":
            return replace(one, object_settings=(), notes=(), context={**context, **one.context})
    dialect, defaults = (
        ("orca", ORCA_DEFAULTS) if read_archive(path, {OBJECTS_IN_3MF[1]}) else ("prusaslicer", DEFAULTS)
    )
    return Preset("quality", path.stem, dialect, str(path), {height.name: height}, defaults, context=context)


def _convert_object(settings: ObjectSettings, base: Preset) -> Project:
    """Convert the settings of one object or height range."""
    plain = {name: entry for name, entry in settings.entries.items() if name != "layer_height"}
    try:
        before = convert_quality(base)
        made = convert_quality(replace(base, entries={**base.entries, **plain}))
    except ProfileError as error:
        return Project(unused=(f"{settings.place}: its settings are not used: {error.args[0]}",))
    source_names = {entry.name for entry in plain.values()}
    known, values = dict(flatten_settings(before.values)), dict(flatten_settings(made.values))
    wanted = {key for key, value in values.items() if known.get(key) != value}
    wanted |= {one.ours for one in made.taken if one.theirs in source_names}
    kept = {
        key: values[key]
        for key in wanted
        if key in values
        and key in list_overridable_settings(heights=bool(settings.high), modifier=settings.is_modifier)
    }
    table: dict[str, Any] = {"object": settings.object, "set": dict(sorted(kept.items()))}
    if settings.high:
        table |= {"low": settings.low, "high": settings.high}
    heights, lost = _find_layer_height(settings)
    summary = ", ".join(
        f"{key} = {value}"
        for key, value in [*sorted(kept.items()), *(("layer_height", height) for _, height in heights)]
    )
    lost += _list_unused(made, source_names, kept, settings)
    return Project(
        (table,) if kept else (),
        heights,
        (f"{settings.place}: {summary} (from the project)",) if summary else (),
        tuple(f"{settings.place}: {text}" for text in lost),
    )


def _find_layer_height(settings: ObjectSettings) -> tuple[tuple[tuple[str, float], ...], list[str]]:
    """Return an object's name with its uniform layer height, or the reason why the layer height is not used."""
    entry = settings.entries.get("layer_height")
    if entry is None:
        return (), []
    found = parse_quantity(entry.text)
    if settings.is_only_object and not settings.high and found and found.value > 0:
        return ((settings.object, found.value),), []
    why = "all objects on a plate have the same layers"
    if settings.is_only_object:
        why = "`printer-slicer profiles import` converts it to height ranges of the planner"
    return (), [f"{entry.name} = {entry.text} is not used: {why}"]


def _list_unused(
    converted: ImportedProfile, source_names: set[str], kept: Collection[str], settings: ObjectSettings
) -> list[str]:
    """List the settings of an object that are not used, with the reason."""
    lost = [
        f"{one.theirs} = {one.text} is not used: {one.why}"
        for one in converted.left
        if one.theirs in source_names
    ]
    used = {one.theirs for one in converted.taken if one.ours in kept}
    return lost + [
        f"{one.theirs} = {one.text} is not used: {explain_common_setting(one.ours, settings)}"
        for one in converted.taken
        if one.theirs in source_names - used and one.ours not in kept
    ]
