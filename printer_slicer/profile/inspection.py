"""Looking at profiles: where each value comes from, how two differ, everything that is wrong with a file."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

import msgspec

from printer_slicer.profile.checks import conflicts
from printer_slicer.profile.conversion import Fault, converted, fault_of
from printer_slicer.profile.planners import UniformPlanner
from printer_slicer.profile.profile import Profile
from printer_slicer.profile.reading import Source, flatten, read_chain
from printer_slicer.profile.settings import Material, Printer, Quality

__all__ = ["DEFAULT", "Told", "differences", "faults_of", "headline", "settings_told"]

DEFAULT: Final = "default"
"""The place of what is set nowhere."""


class Told(NamedTuple):
    """A setting as it is used, and where that value was set: a file with the line, what was typed, or `DEFAULT`."""

    value: object
    place: str


def settings_told(kind: str, source: Source) -> dict[str, Told]:
    """All settings of one part of a profile as it is used: key -> value and place.

    Raises:
        ProfileError: it has a fault of its own.
    """
    values = flatten(msgspec.to_builtins(converted(kind, source)))
    return {key: Told(value, source.known_place(key) or DEFAULT) for key, value in values}


def differences(kind: str, one: Source, other: Source) -> dict[str, tuple[object, object]]:
    """The settings in which two parts of the same kind differ; None for what one of them does not have."""
    left, right = settings_told(kind, one), settings_told(kind, other)
    pairs = {
        key: (left[key].value if key in left else None, right[key].value if key in right else None)
        for key in [*left, *(key for key in right if key not in left)]
    }
    return {key: pair for key, pair in pairs.items() if pair[0] != pair[1]}


def faults_of(kind: str, name: str, folders: Sequence[Path] = ()) -> list[Fault]:
    """Everything that is wrong with one part of a profile by itself; empty where nothing is.

    Raises:
        ProfileError: the file, or one that it inherits from, cannot be read at all.
    """
    source = read_chain(kind, name, folders)
    found = list(_each_fault(kind, source))
    if not found and kind == "printer":
        found = [
            Fault(source.place(key.partition(".")[2]), key.partition(".")[2], f"{key}: {problem}", remedy)
            for key, problem, remedy in conflicts(_alone(converted(kind, source)))
            if key.startswith("printer.")
        ]
    return found


def _each_fault(kind: str, source: Source) -> Iterator[Fault]:
    """One fault after the other: what is wrong is taken out, and looked again."""
    missing: dict[str, Any] = {}
    while fault := fault_of(kind, Source({**source.values, **missing}, source.places, source.file)):
        yield fault
        # Without its kind a table cannot be looked at; nor without what an entry of a list must have.
        table = fault.path.rpartition(".")[0]
        taken = _without(source.values, table if table and fault.path.endswith(".kind") else fault.path)
        taken = _without(source.values, table) if taken is None and table else taken
        if taken is not None:
            source = Source(taken, source.places, source.file)
        elif fault.path in missing or not fault.path:
            return
        else:  # what must be there and is not: anything will do, to see what else is wrong
            missing[fault.path] = "?" if fault.path == "name" else 100


def _without(values: Mapping[str, Any], path: str) -> dict[str, Any] | None:
    """The same without one key, or the list that holds it; None where it is not there."""
    key, _, rest = path.partition("[")[0].partition(".")
    if key not in values:
        return None
    if not rest or not isinstance(values[key], Mapping):
        return {name: value for name, value in values.items() if name != key}
    inner = _without(values[key], rest)
    if inner is None:
        return None
    return {**values, key: inner}


def _alone(printer: Printer) -> Profile:
    """A printer with a material and a quality that ask nothing of it."""
    cold = Material(
        name="",
        nozzle_temperature=0,
        first_layer_nozzle_temperature=0,
        bed_temperature=0,
        first_layer_bed_temperature=0,
    )
    thin = Quality(name="", planner=UniformPlanner(), layer_height=printer.min_layer)
    return Profile(printer=printer, material=cold, quality=thin)


def headline(path: Path) -> str:
    """What the first comment of a file says it is for: its first sentence, as far as it stands in the first line."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError):
        return ""
    for line in text.splitlines():
        if not line.startswith("#"):
            return ""
        if not line.startswith("#:"):
            return re.split(r"(?<=[^.])\.(?:\s|$)", line.lstrip("# "), maxsplit=1)[0].rstrip()
    return ""
