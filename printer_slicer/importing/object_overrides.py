"""Convert settings of single objects and height ranges to overrides.

The settings of an object replace those of the project, and the result is converted again. Settings that then differ
become overrides. This way, percentages and layer counts are converted as they are for the whole project.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, Final

from printer_slicer.importing.presets import ObjectSettings, Preset
from printer_slicer.importing.results import ConvertedSetting, ImportedProfile, UnsupportedSetting
from printer_slicer.profile.base import HEIGHT, OBJECT
from printer_slicer.profile.overrides import HIGHEST
from printer_slicer.profile.tables import settings_table

__all__ = ["add_object_overrides", "flatten_settings", "overridable_settings"]


_HEIGHT: Final = "layer_height"


def add_object_overrides(
    whole: ImportedProfile, preset: Preset, convert: Callable[[Preset], ImportedProfile]
) -> ImportedProfile:
    """Return a quality with overrides for objects and height ranges.

    Args:
        whole: the quality without them.
        preset: its source.
        convert: converts a preset to a quality.

    Raises:
        ProfileError: a value is no number or out of range; with place and remedy.
    """
    tables: list[dict[str, Any]] = []
    layers: list[tuple[float, float, float]] = []
    taken: list[ConvertedSetting] = []
    left: list[UnsupportedSetting] = []
    values = dict(whole.values)
    for own in preset.own:
        height = own.entries.get(_HEIGHT)
        entries = {key: entry for key, entry in own.entries.items() if key != _HEIGHT or own.alone}
        made = convert(replace(preset, entries={**preset.entries, **entries}, own=(), notes=()))
        before = dict(flatten_settings(whole.values))
        changed = {key: value for key, value in flatten_settings(made.values) if before.get(key) != value}
        allowed = overridable_settings(heights=bool(own.high))
        kept = {key: value for key, value in changed.items() if key in allowed}
        if kept:
            heights = {"low": own.low, "high": own.high} if own.high else {}
            tables.append({"object": own.object, **heights, "set": kept})
        taken += _taken(own, made, kept)
        left += _left(own, made, changed.keys() - kept.keys() - {_HEIGHT})
        if height is None:
            continue
        if not own.alone:
            why = "all objects of a plate have the same layers"
            left.append(UnsupportedSetting(f"{own.where}: {height.name}", height.text, why))
            continue
        thick = changed.get(_HEIGHT, before[_HEIGHT])
        if own.high:
            layers.append((own.low, own.high, thick))
        else:
            values[_HEIGHT] = thick
        taken.append(ConvertedSetting(f"{own.where}: {height.name}", height.text, _HEIGHT, thick))
    if tables:
        values["overrides"] = tables
    if layers:
        values["planner"] = {"kind": "optimal", "ranges": _ranges(layers, values[_HEIGHT])}
    return replace(whole, values=values, taken=(*whole.taken, *taken), left=(*whole.left, *left))


def overridable_settings(*, heights: bool) -> frozenset[str]:
    """Return the quality settings that may differ per object.

    Args:
        heights: only those that may also differ per height range.
    """
    what = {OBJECT, HEIGHT} if heights else {OBJECT}
    return frozenset(row.key.partition(".")[2] for row in settings_table() if what <= set(row.own))


def flatten_settings(values: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield our settings with their full names."""
    for key, value in values.items():
        if isinstance(value, dict):
            yield from flatten_settings(value, f"{prefix}{key}.")
        else:
            yield prefix + key, value


def _ranges(layers: Sequence[tuple[float, float, float]], usual: float) -> list[dict[str, float]]:
    """Return the layer height of each height range from the bed to the top.

    Args:
        layers: low, high and layer height of the given ranges, mm.
        usual: layer height elsewhere, mm.
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


def _taken(own: ObjectSettings, made: ImportedProfile, kept: Mapping[str, Any]) -> Iterator[ConvertedSetting]:
    """Yield the settings that became overrides of an object."""
    for one in made.taken:
        if one.ours in kept:
            theirs = f"{own.where}: {one.theirs}" if one.theirs else ""
            yield replace(one, theirs=theirs, ours=f"overrides: {own.where}: {one.ours}")


def _left(own: ObjectSettings, made: ImportedProfile, same: set[str]) -> Iterator[UnsupportedSetting]:
    """Yield the settings of an object that have no equivalent, or none that can differ between objects."""
    names = {entry.name for entry in own.entries.values()}
    for lost in made.left:
        if lost.theirs in names:
            yield replace(lost, theirs=f"{own.where}: {lost.theirs}")
    for one in made.taken:
        if one.ours in same and one.theirs in names:
            why = f"{one.ours} is the same for the whole plate here"
            yield UnsupportedSetting(f"{own.where}: {one.theirs}", one.text, why)
