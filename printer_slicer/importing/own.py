"""Settings that objects and heights have of their own, as overrides of ours.

An object's settings are laid over those of the whole, and all are converted again: what comes out differently is the
object's own. So percentages, and numbers of layers that become thicknesses, mean there what they mean in the whole.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, Final

from printer_slicer.importing.presets import Own, Preset
from printer_slicer.importing.report import Imported, Left, Taken
from printer_slicer.profile.base import HEIGHT, OBJECT
from printer_slicer.profile.overrides import HIGHEST
from printer_slicer.profile.tables import settings_table

__all__ = ["flat", "may_differ", "with_own"]


_HEIGHT: Final = "layer_height"


def with_own(whole: Imported, preset: Preset, convert: Callable[[Preset], Imported]) -> Imported:
    """A quality with overrides for what objects have of their own.

    Args:
        whole: the quality without them.
        preset: what it was made from.
        convert: makes a quality.

    Raises:
        ProfileError: a value that is no number or makes no sense, with place and remedy.
    """
    tables: list[dict[str, Any]] = []
    layers: list[tuple[float, float, float]] = []
    taken: list[Taken] = []
    left: list[Left] = []
    values = dict(whole.values)
    for own in preset.own:
        height = own.entries.get(_HEIGHT)
        entries = {key: entry for key, entry in own.entries.items() if key != _HEIGHT or own.alone}
        made = convert(replace(preset, entries={**preset.entries, **entries}, own=(), notes=()))
        before = dict(flat(whole.values))
        changed = {key: value for key, value in flat(made.values) if before.get(key) != value}
        allowed = may_differ(heights=bool(own.high))
        kept = {key: value for key, value in changed.items() if key in allowed}
        if kept:
            heights = {"low": own.low, "high": own.high} if own.high else {}
            tables.append({"object": own.object, **heights, "set": kept})
        taken += _taken(own, made, kept)
        left += _left(own, made, changed.keys() - kept.keys() - {_HEIGHT})
        if height is None:
            continue
        if not own.alone:
            why = "all of a plate has the same layers"
            left.append(Left(f"{own.where}: {height.name}", height.text, why))
            continue
        thick = changed.get(_HEIGHT, before[_HEIGHT])
        if own.high:
            layers.append((own.low, own.high, thick))
        else:
            values[_HEIGHT] = thick
        taken.append(Taken(f"{own.where}: {height.name}", height.text, _HEIGHT, thick))
    if tables:
        values["overrides"] = tables
    if layers:
        values["planner"] = {"kind": "optimal", "ranges": _ranges(layers, values[_HEIGHT])}
    return replace(whole, values=values, taken=(*whole.taken, *taken), left=(*whole.left, *left))


def may_differ(*, heights: bool) -> frozenset[str]:
    """Return the quality settings that may differ per object.

    Args:
        heights: only those that may also differ per height range.
    """
    what = {OBJECT, HEIGHT} if heights else {OBJECT}
    return frozenset(row.key.partition(".")[2] for row in settings_table() if what <= set(row.own))


def flat(values: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Our settings by their full names."""
    for key, value in values.items():
        if isinstance(value, dict):
            yield from flat(value, f"{prefix}{key}.")
        else:
            yield prefix + key, value


def _ranges(layers: Sequence[tuple[float, float, float]], usual: float) -> list[dict[str, float]]:
    """Height of layers from the bed on: as told, and elsewhere the usual one."""
    ranges, begin = [], 0.0
    for low, high, height in sorted(layers):
        if low > begin:
            ranges.append({"low": begin, "high": low, "layer_height": usual})
        ranges.append({"low": max(low, begin), "high": high, "layer_height": height})
        begin = max(begin, high)
    return [one for one in ranges if one["high"] > one["low"]] + [
        {"low": begin, "high": HIGHEST, "layer_height": usual}
    ]


def _taken(own: Own, made: Imported, kept: Mapping[str, Any]) -> Iterator[Taken]:
    """What was taken over, told as of this object."""
    for one in made.taken:
        if one.ours in kept:
            theirs = f"{own.where}: {one.theirs}" if one.theirs else ""
            yield replace(one, theirs=theirs, ours=f"overrides: {own.where}: {one.ours}")


def _left(own: Own, made: Imported, same: set[str]) -> Iterator[Left]:
    """What has no counterpart, or none that only this object has."""
    names = {entry.name for entry in own.entries.values()}
    for lost in made.left:
        if lost.theirs in names:
            yield replace(lost, theirs=f"{own.where}: {lost.theirs}")
    for one in made.taken:
        if one.ours in same and one.theirs in names:
            why = f"{one.ours} is the same for all of a plate here"
            yield Left(f"{own.where}: {one.theirs}", one.text, why)
