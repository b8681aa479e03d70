"""Check that overrides change only settings that can be overridden, to valid values."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Final, NamedTuple

import msgspec

from printer_slicer.profile.base import HEIGHT, OBJECT
from printer_slicer.profile.conversion import find_first_fault
from printer_slicer.profile.keys import find_nearest_key
from printer_slicer.profile.overrides import Override
from printer_slicer.profile.reading import SettingsSource, merge_tables
from printer_slicer.profile.settings import Material, Quality
from printer_slicer.profile.tables import SettingRow, list_setting_definitions

__all__ = ["NEUTRAL_MATERIAL", "OverrideFault", "find_override_faults"]

_PLACE_NAMES: Final = {OBJECT: "objects", HEIGHT: "height ranges"}
NEUTRAL_MATERIAL: Final = Material(
    name="",
    nozzle_temperature=0,
    first_layer_nozzle_temperature=0,
    bed_temperature=0,
    first_layer_bed_temperature=0,
)
"""A material that never conflicts with a printer."""


class OverrideFault(NamedTuple):
    """An error in an override.

    Attributes:
        path: key of the setting, such as `overrides[1].set.perimeters`.
        problem: what is wrong.
        remedy: what to do.
    """

    path: str
    problem: str
    remedy: str


def find_override_faults(quality: Quality) -> Iterator[OverrideFault]:
    """Yield all errors in the overrides of a quality."""
    rows = {row.key: row for row in list_setting_definitions()} if quality.overrides else {}
    plain = msgspec.structs.replace(quality, overrides=())
    for i, one in enumerate(quality.overrides):
        path = f"overrides[{i}]"
        if one.is_everywhere and not one.object:
            problem = "an override has neither an object nor a height range"
            yield OverrideFault(path, problem, "Add one of them, or set the value for the whole plate")
        if one.high <= one.low:
            problem = f"{one.format_place()}: the height range from {one.low:g} to {one.high:g} mm is empty"
            yield OverrideFault(f"{path}.high", problem, "Write the lower end first")
        for key, value in one.set.items():
            where = f"{one.format_place()}:{key}".lstrip(":")
            for problem, remedy in _check_key(one, key, value, rows, plain):
                yield OverrideFault(f"{path}.set.{key}", f"{where}: {problem}", remedy)
    if quality.overrides and quality.spiral:
        problem = "overrides cannot be combined with quality.spiral"
        yield OverrideFault("overrides", problem, "Set quality.spiral to false, or remove the overrides")


def _check_key(
    one: Override, key: str, value: object, rows: Mapping[str, SettingRow], quality: Quality
) -> Iterator[tuple[str, str]]:
    """Yield problem and remedy of each error in one setting of an override."""
    required = {OBJECT} if one.object else set()
    required |= set() if one.is_everywhere else {HEIGHT}
    allowed = [row.key for row in rows.values() if row.own and required <= set(row.own)]
    found = [row.key for row in rows.values() if key in (row.key, row.key.partition(".")[2])]
    found.sort(key=lambda name: name not in allowed)  # printer and quality both have `speeds.internal_infill`
    if not found:
        near = find_nearest_key(key, [*allowed, *(name.partition(".")[2] for name in allowed)])
        hint = f"Did you mean {near!r}? " if near else ""
        yield "no such setting", f"{hint}`ps.find_settings()` lists all settings"
    elif found[0] not in allowed:
        places = (
            " and ".join(_PLACE_NAMES[one] for one in sorted(required, reverse=True))
            or "objects and height ranges"
        )
        yield f"{found[0]} cannot be overridden for {places}", _suggest_place(rows[found[0]])
    else:
        yield from _check_value(found[0], value, quality)


def _suggest_place(row: SettingRow) -> str:
    """Return where a setting can be set that an override may not change, in a sentence."""
    name = row.key.partition(".")[2]
    others = " and ".join(_PLACE_NAMES[one] for one in sorted(row.own, reverse=True))
    elsewhere = f"Override it for {others}, or set" if others else "Set"
    return f"{elsewhere} {name} for the whole print"


def _check_value(key: str, value: object, quality: Quality) -> Iterator[tuple[str, str]]:
    """Yield the problem and the remedy if a value has the wrong type or is out of bounds."""
    kind, _, path = key.partition(".")
    *tables, leaf = path.split(".")
    change = {leaf: value}
    for table in reversed(tables):
        change = {table: change}
    whole = msgspec.to_builtins(quality if kind == "quality" else NEUTRAL_MATERIAL)
    fault = find_first_fault(kind, SettingsSource(merge_tables(whole, change), {}, ""))
    if fault:
        yield fault.problem, fault.remedy
