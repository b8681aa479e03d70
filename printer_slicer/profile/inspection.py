"""Inspect profiles: list the origin of each value, differences between two profiles, or all errors in a file."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

import msgspec

from printer_slicer.errors import ProfileError
from printer_slicer.input_files import read_input
from printer_slicer.profile.checks import Conflict, find_all_conflicts, find_planner_conflicts
from printer_slicer.profile.conversion import SettingFault, convert_section, find_first_fault
from printer_slicer.profile.override_checks import NEUTRAL_MATERIAL, find_override_faults
from printer_slicer.profile.overrides import HIGHEST
from printer_slicer.profile.planners import UniformPlanner
from printer_slicer.profile.profile import Profile
from printer_slicer.profile.reading import SettingsSource, flatten_tables, read_chain
from printer_slicer.profile.settings import Printer, Quality
from printer_slicer.toml_text import MAX_BYTES

__all__ = [
    "DEFAULT",
    "SettingOrigin",
    "compare_settings",
    "find_faults",
    "find_setting_origins",
    "has_settings",
    "make_profile_for_printer",
    "read_headline",
]

DEFAULT: Final = "default"
"""Origin of settings that no file sets."""


class SettingOrigin(NamedTuple):
    """The value of a setting and its origin: file and line, the option that was typed, or `DEFAULT`."""

    value: object
    place: str


def find_setting_origins(kind: str, source: SettingsSource) -> dict[str, SettingOrigin]:
    """Map each setting of a printer, material or quality to its value and origin.

    Raises:
        ProfileError: a setting is invalid.
    """
    values = flatten_tables(msgspec.to_builtins(convert_section(kind, source)))
    return {key: SettingOrigin(value, source.find_place(key) or DEFAULT) for key, value in values}


def compare_settings(
    kind: str, one: SettingsSource, other: SettingsSource
) -> dict[str, tuple[object, object]]:
    """Return the settings that differ between two profiles of the same kind, each with both values.

    A value is None if the profile does not have the setting.
    """
    left, right = find_setting_origins(kind, one), find_setting_origins(kind, other)
    pairs = {
        key: (left[key].value if key in left else None, right[key].value if key in right else None)
        for key in [*left, *(key for key in right if key not in left)]
    }
    return {key: pair for key, pair in pairs.items() if pair[0] != pair[1]}


def has_settings(kind: str, name: str, values: Mapping[str, Any], folders: Sequence[Path] = ()) -> bool:
    """Return whether a profile, which may have faults, has exactly these settings; unset ones have their defaults."""
    try:
        known = convert_section(kind, read_chain(kind, name, folders))
        return bool(known == convert_section(kind, SettingsSource(dict(values), {}, "")))
    except ProfileError:
        return False


def find_faults(
    kind: str,
    name: str,
    folders: Sequence[Path] = (),
    check_macros: Callable[[Printer], Iterable[Conflict]] = lambda _: (),
) -> list[SettingFault]:
    """Find all errors in a printer, material or quality profile.

    Args:
        kind: `printer`, `material` or `quality`.
        name: name of the profile, or its file.
        folders: further folders of profiles.
        check_macros: function that finds errors in the macros of a printer; default: macros are not checked.

    Raises:
        ProfileError: the file, or one that it inherits from, cannot be read.
    """
    source = read_chain(kind, name, folders)
    found, repaired = _find_and_repair_faults(kind, source)
    if find_first_fault(kind, repaired):
        return found
    part = convert_section(kind, repaired)
    own = [] if found else list(find_planner_conflicts(part) if kind == "quality" else ())
    own += find_all_conflicts(make_profile_for_printer(part)) if kind == "printer" and not found else ()
    own += check_macros(part) if kind == "printer" else ()
    for key, problem, remedy in own:
        section, _, path = key.partition(".")
        if section == kind:
            found.append(SettingFault(source.find_place_or_file(path), path, f"{key}: {problem}", remedy))
    return [*found, *_find_override_faults(part, source, found)] if kind == "quality" else found


def _find_override_faults(
    quality: Quality, source: SettingsSource, found: Sequence[SettingFault]
) -> Iterator[SettingFault]:
    """Yield errors in overrides, except wrong types and bounds; skip overrides with an error in `found`."""
    reported = {
        fault.path.partition("].")[0] + "]" for fault in found if not _is_setting_of_override(fault.path)
    }
    for path, problem, remedy in find_override_faults(quality):
        if _is_setting_of_override(path) or path not in reported:
            yield SettingFault(source.find_place_or_file(path), path, f"quality.overrides: {problem}", remedy)


def _is_setting_of_override(path: str) -> bool:
    """Return whether a path leads to a setting inside an override."""
    return "].set" in path


def _find_and_repair_faults(kind: str, source: SettingsSource) -> tuple[list[SettingFault], SettingsSource]:
    """Find all faults, by repairing each one before looking for the next; return the faults and repaired settings."""
    found: list[SettingFault] = []
    replaced: set[str] = set()
    while fault := find_first_fault(kind, source):
        path = fault.path
        is_repeated = any(path == one.path for one in found)
        if not is_repeated:
            found.append(fault)
        if not path or path in replaced:
            break
        # A table cannot be checked without its kind, so the whole table is removed.
        keys = _split_path(path.removesuffix(".kind"))
        if is_repeated or _find_value(source.values, keys) is None:  # required settings get any valid value
            replaced.add(path)
            source = source._replace(
                values=_replace_value(source.values, keys, _VALID_VALUES.get(str(keys[-1]), 100))
            )
        else:
            source = source._replace(values=_replace_value(source.values, keys, None))
    return found, source


_VALID_VALUES: Final[Mapping[str, object]] = {"name": "?", "set": {}, "low": 0, "high": HIGHEST}


def _split_path(path: str) -> list[str | int]:
    """Split a path into keys and list indices."""
    return [
        int(one) if one.isdecimal() else one for one in re.findall(r"[^.\[\]]+", path.replace("[...]", ""))
    ]


def _find_value(values: Any, keys: Sequence[str | int]) -> Any:
    """Return the value at a path; None if there is no value."""
    for key in keys:
        fits = isinstance(values, list | tuple) if isinstance(key, int) else isinstance(values, Mapping)
        if not fits or (isinstance(key, str) and key not in values):
            return None
        values = values[key]
    return values


def _replace_value(values: Any, keys: Sequence[str | int], new_value: object) -> Any:
    """Return a copy of settings with a new value at a path; None removes the value, or the list that contains it."""
    key, *rest = keys
    if isinstance(key, int):
        return [_replace_value(one, rest, new_value) if i == key else one for i, one in enumerate(values)]
    if rest and not (len(rest) == 1 and isinstance(rest[0], int)):
        return {**values, key: _replace_value(values[key], rest, new_value)}
    if new_value is None:
        return {name: value for name, value in values.items() if name != key}
    return {**values, key: new_value}


def make_profile_for_printer(printer: Printer) -> Profile:
    """Combine a printer with a material and a quality that never conflict with it; return the profile."""
    thin_quality = Quality(name="", planner=UniformPlanner(), layer_height=printer.min_layer)
    return Profile(printer=printer, material=NEUTRAL_MATERIAL, quality=thin_quality)


def read_headline(path: Path) -> str:
    """Return the first sentence of the first comment in a file; only the first line of the comment is read."""
    try:
        text = read_input(path, MAX_BYTES).decode("utf-8-sig")
    except (OSError, UnicodeDecodeError):
        return ""
    for line in text.splitlines():
        if not line.startswith("#"):
            return ""
        if not line.startswith("#:"):
            return re.split(r"(?<=[^.])\.(?:\s|$)", line.lstrip("# "), maxsplit=1)[0].rstrip()
    return ""
