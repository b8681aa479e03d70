"""Looking at profiles: where each value comes from, how two differ, everything that is wrong with a file."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

import msgspec

from printer_slicer.input_files import read_input
from printer_slicer.profile.checks import Conflict, conflicts, planner_conflicts
from printer_slicer.profile.conversion import SettingFault, converted, fault_of
from printer_slicer.profile.override_checks import COLD, own_faults
from printer_slicer.profile.overrides import HIGHEST
from printer_slicer.profile.planners import UniformPlanner
from printer_slicer.profile.profile import Profile
from printer_slicer.profile.reading import SettingsSource, flatten, read_chain
from printer_slicer.profile.settings import Printer, Quality
from printer_slicer.toml_text import MOST_BYTES

__all__ = ["DEFAULT", "SettingOrigin", "alone", "differences", "faults_of", "headline", "settings_told"]

DEFAULT: Final = "default"
"""The place of what is set nowhere."""


class SettingOrigin(NamedTuple):
    """A setting as it is used, and where that value was set: a file with the line, what was typed, or `DEFAULT`."""

    value: object
    place: str


def settings_told(kind: str, source: SettingsSource) -> dict[str, SettingOrigin]:
    """All settings of one part of a profile as it is used: key -> value and place.

    Raises:
        ProfileError: it has a fault of its own.
    """
    values = flatten(msgspec.to_builtins(converted(kind, source)))
    return {key: SettingOrigin(value, source.known_place(key) or DEFAULT) for key, value in values}


def differences(kind: str, one: SettingsSource, other: SettingsSource) -> dict[str, tuple[object, object]]:
    """The settings in which two parts of the same kind differ; None for what one of them does not have."""
    left, right = settings_told(kind, one), settings_told(kind, other)
    pairs = {
        key: (left[key].value if key in left else None, right[key].value if key in right else None)
        for key in [*left, *(key for key in right if key not in left)]
    }
    return {key: pair for key, pair in pairs.items() if pair[0] != pair[1]}


def faults_of(
    kind: str,
    name: str,
    folders: Sequence[Path] = (),
    of_macros: Callable[[Printer], Iterable[Conflict]] = lambda _: (),
) -> list[SettingFault]:
    """Everything that is wrong with one part of a profile by itself; empty where nothing is.

    Args:
        kind: `printer`, `material` or `quality`.
        name: of the profile, or its file.
        folders: further folders of profiles.
        of_macros: finds errors in the macros of a printer; default: macros are not checked.

    Raises:
        ProfileError: the file, or one that it inherits from, cannot be read at all.
    """
    source = read_chain(kind, name, folders)
    found, mended = _faults_and_rest(kind, source)
    if fault_of(kind, mended):
        return found
    part = converted(kind, mended)
    own = [] if found else list(planner_conflicts(part) if kind == "quality" else ())
    own += conflicts(alone(part)) if kind == "printer" and not found else ()
    own += of_macros(part) if kind == "printer" else ()
    for key, problem, remedy in own:
        section, _, path = key.partition(".")
        if section == kind:
            found.append(SettingFault(source.place(path), path, f"{key}: {problem}", remedy))
    return [*found, *_of_places(part, source, found)] if kind == "quality" else found


def _of_places(
    quality: Quality, source: SettingsSource, found: Sequence[SettingFault]
) -> Iterator[SettingFault]:
    """What is wrong with overrides beyond types and bounds, but for where those are for that is faulty already."""
    told = {fault.path.partition("].")[0] + "]" for fault in found if not _is_of_set(fault.path)}
    for path, problem, remedy in own_faults(quality):
        if _is_of_set(path) or path not in told:
            yield SettingFault(source.place(path), path, f"quality.overrides: {problem}", remedy)


def _is_of_set(path: str) -> bool:
    """Whether it is one of the settings of an override."""
    return "].set" in path


def _faults_and_rest(kind: str, source: SettingsSource) -> tuple[list[SettingFault], SettingsSource]:
    """One fault after the other, each mended before it is looked again; and what is left then."""
    found: list[SettingFault] = []
    replaced: set[str] = set()
    while fault := fault_of(kind, source):
        path = fault.path
        again = any(path == one.path for one in found)
        if not again:
            found.append(fault)
        if not path or path in replaced:
            break
        # Without its kind a table cannot be looked at.
        keys = _keys(path.removesuffix(".kind"))
        if again or _entry(source.values, keys) is None:  # what must be there: anything will do
            replaced.add(path)
            source = source._replace(values=_mended(source.values, keys, _STAND_INS.get(str(keys[-1]), 100)))
        else:
            source = source._replace(values=_mended(source.values, keys, None))
    return found, source


_STAND_INS: Final[Mapping[str, object]] = {"name": "?", "set": {}, "low": 0, "high": HIGHEST}


def _keys(path: str) -> list[str | int]:
    """The keys and numbers that a path goes by; a value of a list or a mapping goes with all of it."""
    return [
        int(one) if one.isdecimal() else one for one in re.findall(r"[^.\[\]]+", path.replace("[...]", ""))
    ]


def _entry(values: Any, keys: Sequence[str | int]) -> Any:
    """What stands there; None: nothing."""
    for key in keys:
        fits = isinstance(values, list | tuple) if isinstance(key, int) else isinstance(values, Mapping)
        if not fits or (isinstance(key, str) and key not in values):
            return None
        values = values[key]
    return values


def _mended(values: Any, keys: Sequence[str | int], stand_in: object) -> Any:
    """The same with something else in one place; None takes it out, with its list if it is an item."""
    key, *rest = keys
    if isinstance(key, int):
        return [_mended(one, rest, stand_in) if i == key else one for i, one in enumerate(values)]
    if rest and not (len(rest) == 1 and isinstance(rest[0], int)):
        return {**values, key: _mended(values[key], rest, stand_in)}
    if stand_in is None:
        return {name: value for name, value in values.items() if name != key}
    return {**values, key: stand_in}


def alone(printer: Printer) -> Profile:
    """A printer with a material and a quality that ask nothing of it."""
    thin = Quality(name="", planner=UniformPlanner(), layer_height=printer.min_layer)
    return Profile(printer=printer, material=COLD, quality=thin)


def headline(path: Path) -> str:
    """What the first comment of a file says it is for: its first sentence, as far as it stands in the first line."""
    try:
        text = read_input(path, MOST_BYTES).decode("utf-8-sig")
    except (OSError, UnicodeDecodeError):
        return ""
    for line in text.splitlines():
        if not line.startswith("#"):
            return ""
        if not line.startswith("#:"):
            return re.split(r"(?<=[^.])\.(?:\s|$)", line.lstrip("# "), maxsplit=1)[0].rstrip()
    return ""
