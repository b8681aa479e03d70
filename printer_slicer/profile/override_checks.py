"""Whether overrides make sense: keys that there are, that may differ there, and values that their settings take."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Final, NamedTuple

import msgspec

from printer_slicer.profile.base import HEIGHT, OBJECT
from printer_slicer.profile.conversion import fault_of
from printer_slicer.profile.keys import nearest
from printer_slicer.profile.overrides import Override
from printer_slicer.profile.reading import SettingsSource, merged
from printer_slicer.profile.settings import Material, Quality
from printer_slicer.profile.tables import SettingRow, settings_table

__all__ = ["COLD", "OwnFault", "own_faults"]

_WORDS: Final = {OBJECT: "objects", HEIGHT: "heights"}
COLD: Final = Material(
    name="",
    nozzle_temperature=0,
    first_layer_nozzle_temperature=0,
    bed_temperature=0,
    first_layer_bed_temperature=0,
)
"""A material that asks nothing of anybody."""


class OwnFault(NamedTuple):
    """What is wrong with an override.

    Attributes:
        path: `overrides[1].set.perimeters`.
        problem: what is wrong.
        remedy: what to do.
    """

    path: str
    problem: str
    remedy: str


def own_faults(quality: Quality) -> Iterator[OwnFault]:
    """Everything that is wrong with the overrides of a quality by itself."""
    rows = {row.key: row for row in settings_table()} if quality.overrides else {}
    plain = msgspec.structs.replace(quality, overrides=())
    for i, one in enumerate(quality.overrides):
        path = f"overrides[{i}]"
        if one.is_everywhere and not one.object:
            nowhere = "an override is for no object and no heights"
            yield OwnFault(path, nowhere, "name one of them, or set it for all")
        if one.high <= one.low:
            empty = f"{one.where()}: from {one.low:g} to {one.high:g} mm is nothing"
            yield OwnFault(f"{path}.high", empty, "name the lower end first")
        for key, value in one.set.items():
            where = f"{one.where()}:{key}".lstrip(":")
            for problem, remedy in _of_key(one, key, value, rows, plain):
                yield OwnFault(f"{path}.set.{key}", f"{where}: {problem}", remedy)
    if quality.overrides and quality.spiral:
        same = "a spiral has the same settings everywhere"
        yield OwnFault("overrides", same, "set quality.spiral to false, or leave the overrides out")


def _of_key(
    one: Override, key: str, value: object, rows: Mapping[str, SettingRow], quality: Quality
) -> Iterator[tuple[str, str]]:
    """What is wrong with one setting of an override: problem and remedy."""
    what = {OBJECT} if one.object else set()
    what |= set() if one.is_everywhere else {HEIGHT}
    allowed = [row.key for row in rows.values() if row.own and what <= set(row.own)]
    found = [row.key for row in rows.values() if key in (row.key, row.key.partition(".")[2])]
    found.sort(key=lambda name: name not in allowed)  # printer and quality both have `speeds.internal_infill`
    if not found:
        near = nearest(key, [*allowed, *(name.partition(".")[2] for name in allowed)])
        hint = f"did you mean {near!r}? " if near else ""
        yield "no such setting", f"{hint}`printer-slicer profiles settings` lists all"
    elif found[0] not in allowed:
        places = " and ".join(_WORDS[one] for one in sorted(what, reverse=True)) or "objects and heights"
        near = ", ".join(name.partition(".")[2] for name in allowed)
        yield f"{found[0]} is the same for all {places}", f"of their own they can have: {near}"
    else:
        yield from _of_value(found[0], value, quality)


def _of_value(key: str, value: object, quality: Quality) -> Iterator[tuple[str, str]]:
    """Whether a value is of the type and within the bounds of its setting."""
    kind, _, path = key.partition(".")
    *tables, leaf = path.split(".")
    change = {leaf: value}
    for table in reversed(tables):
        change = {table: change}
    whole = msgspec.to_builtins(quality if kind == "quality" else COLD)
    fault = fault_of(kind, SettingsSource(merged(whole, change), {}, ""))
    if fault:
        yield fault.problem, fault.remedy
