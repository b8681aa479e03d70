"""Convert settings of single objects and height ranges to overrides.

The settings of an object replace those of the project, and the result is converted again. The settings that differ
after this become overrides. In this way, percentages and layer counts are converted as for the whole project.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, Final

from printer_slicer.importing.presets import ObjectSettings, Preset
from printer_slicer.importing.results import ConvertedSetting, ImportedProfile, UnsupportedSetting
from printer_slicer.profile.base import HEIGHT, OBJECT
from printer_slicer.profile.object_profiles import MODIFIER_SETTINGS
from printer_slicer.profile.overrides import HIGHEST
from printer_slicer.profile.tables import list_setting_definitions
from printer_slicer.values import replace

__all__ = ["add_object_overrides", "explain_common_setting", "flatten_settings", "list_overridable_settings"]


_HEIGHT: Final = "layer_height"


def add_object_overrides(
    profile: ImportedProfile, preset: Preset, convert: Callable[[Preset], ImportedProfile]
) -> ImportedProfile:
    """Return a quality with overrides for objects and height ranges.

    Args:
        profile: the quality without overrides.
        preset: its source.
        convert: function that converts a preset to a quality.

    Raises:
        ProfileError: a value is not a number or is out of range; with place and remedy.
    """
    tables: list[dict[str, Any]] = []
    layers: list[tuple[float, float, float]] = []
    taken: list[ConvertedSetting] = []
    left: list[UnsupportedSetting] = []
    values = dict(profile.values)
    for source in preset.object_settings:
        height = source.entries.get(_HEIGHT)
        entries = {
            key: entry for key, entry in source.entries.items() if key != _HEIGHT or source.is_only_object
        }
        made = convert(replace(preset, entries={**preset.entries, **entries}, object_settings=(), notes=()))
        before = dict(flatten_settings(profile.values))
        changed = {key: value for key, value in flatten_settings(made.values) if before.get(key) != value}
        allowed = list_overridable_settings(heights=bool(source.high), modifier=source.is_modifier)
        kept = {key: value for key, value in changed.items() if key in allowed}
        if kept:
            heights = {"low": source.low, "high": source.high} if source.high else {}
            tables.append({"object": source.object, **heights, "set": kept})
        taken += _list_converted(source, made, kept)
        left += _list_unsupported(source, made, changed.keys() - kept.keys() - {_HEIGHT})
        if height is None:
            continue
        if not source.is_only_object:
            why = "all objects on a plate have the same layers"
            left.append(UnsupportedSetting(f"{source.place}: {height.name}", height.text, why))
            continue
        layer_height = changed.get(_HEIGHT, before[_HEIGHT])
        if source.high:
            layers.append((source.low, source.high, layer_height))
        else:
            values[_HEIGHT] = layer_height
        taken.append(ConvertedSetting(f"{source.place}: {height.name}", height.text, _HEIGHT, layer_height))
    if tables:
        values["overrides"] = tables
    if layers:
        values["planner"] = {"kind": "optimal", "ranges": _fill_height_ranges(layers, values[_HEIGHT])}
    return replace(profile, values=values, taken=(*profile.taken, *taken), left=(*profile.left, *left))


def list_overridable_settings(*, heights: bool, modifier: bool = False) -> frozenset[str]:
    """Return the names of the quality settings that can differ between objects.

    Args:
        heights: whether to return only those that can also differ between height ranges.
        modifier: whether to return only those that modifiers can change.
    """
    places = {OBJECT, HEIGHT} if heights else {OBJECT}
    keys = frozenset(
        row.key.partition(".")[2] for row in list_setting_definitions() if places <= set(row.own)
    )
    return keys & MODIFIER_SETTINGS if modifier else keys


def explain_common_setting(ours: str, source: ObjectSettings) -> str:
    """Return why a setting of an object or modifier is not used."""
    return f"{ours} is the same for the whole {'object' if source.is_modifier else 'plate'} here"


def flatten_settings(values: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield our settings with dotted names, such as `speeds.travel`."""
    for key, value in values.items():
        if isinstance(value, dict):
            yield from flatten_settings(value, f"{prefix}{key}.")
        else:
            yield prefix + key, value


def _fill_height_ranges(layers: Sequence[tuple[float, float, float]], usual: float) -> list[dict[str, float]]:
    """Return height ranges with layer heights, without gaps from the bed to the top.

    Args:
        layers: low, high and layer height of the given ranges, mm.
        usual: layer height between the given ranges, mm.
    """
    ranges, begin = [], 0.0
    for low, high, height in sorted(layers):
        if low > begin:
            ranges.append({"low": begin, "high": low, "layer_height": usual})
        ranges.append({"low": max(low, begin), "high": high, "layer_height": height})
        begin = max(begin, high)
    return [one for one in ranges if one["high"] > one["low"]] + [
        {"low": begin, "high": HIGHEST, "layer_height": usual}
    ]


def _list_converted(
    source: ObjectSettings, made: ImportedProfile, kept: Mapping[str, Any]
) -> Iterator[ConvertedSetting]:
    """Yield the settings of an object that became overrides."""
    for one in made.taken:
        if one.ours in kept:
            theirs = f"{source.place}: {one.theirs}" if one.theirs else ""
            yield replace(one, theirs=theirs, ours=f"overrides: {source.place}: {one.ours}")


def _list_unsupported(
    source: ObjectSettings, made: ImportedProfile, same: set[str]
) -> Iterator[UnsupportedSetting]:
    """Yield the settings of an object that have no equivalent here, or that apply only to the whole plate here."""
    names = {entry.name for entry in source.entries.values()}
    for lost in made.left:
        if lost.theirs in names:
            yield replace(lost, theirs=f"{source.place}: {lost.theirs}")
    for one in made.taken:
        if one.ours in same and one.theirs in names:
            why = explain_common_setting(one.ours, source)
            yield UnsupportedSetting(f"{source.place}: {one.theirs}", one.text, why)
