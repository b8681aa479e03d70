"""Load profiles from TOML files, apply changes, and check them.

A profile has three parts, one file each: `printers/NAME.toml`, `materials/NAME.toml`, `qualities/NAME.toml`. A file may
contain `inherits = "OTHER"`; its own keys take precedence. Changes such as `quality.perimeters = 3` are applied last,
with the same bounds.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from types import NoneType
from typing import Any, Final, NamedTuple

import msgspec
from msgspec.structs import replace

from printer_slicer.arguments import PATH, check_argument, check_arguments
from printer_slicer.errors import ProfileError, UsageError
from printer_slicer.profile.checks import find_all_conflicts
from printer_slicer.profile.conversion import SettingFault, convert_section
from printer_slicer.profile.keys import resolve_key
from printer_slicer.profile.lists import LISTS, format_list, parse_list
from printer_slicer.profile.profile import Profile
from printer_slicer.profile.reading import (
    DEFAULT_NAMES,
    KINDS,
    SettingsSource,
    flatten_tables,
    merge_sources,
    merge_tables,
    read_chain,
)
from printer_slicer.profile.renamed import find_current_name, replace_former_name, replace_former_names
from printer_slicer.texts import describe_type

__all__ = [
    "FileSettings",
    "complete_profile",
    "find_conflicts",
    "list_settings",
    "load_profile",
    "profile_with",
    "read_sources",
    "restore_profile",
    "settings_as_dict",
]

_BARE_POINT = re.compile(r"([-+]?)([0-9]*)\.([0-9]*)")


_NAME: Final = (*PATH, NoneType)
"""The types of the name of a profile."""


class FileSettings(NamedTuple):
    """Settings found in a file.

    Attributes:
        values: kind -> settings; kinds without settings in the file are missing.
        refused: reasons why settings in the file are not used, one sentence each.
        unknown: name of the machine in the file if no profile has that name, else empty.
        source: origin of the settings, for messages.
    """

    values: Mapping[str, Mapping[str, Any]]
    refused: Sequence[str]
    unknown: str = ""
    source: str = "from the file"


@check_arguments(printer=_NAME, material=_NAME, quality=_NAME)
def load_profile(
    printer: str | os.PathLike[str] | None = None,
    material: str | os.PathLike[str] | None = None,
    quality: str | os.PathLike[str] | None = None,
    changes: Mapping[str, object] | None = None,
    *,
    slices: bool = True,
    folders: Sequence[str | os.PathLike[str]] = (),
) -> Profile:
    """Load printer, material and quality, and apply changes.

    Args:
        printer: name of a profile or path of a TOML file; None: the default.
        material: likewise.
        quality: likewise.
        changes: `section.key`, or `key` if it is unique, -> value; text is converted to the setting's type. A
            `layer_height` without a planner setting selects uniform layers. A key that ends with +, such as
            `overrides+`, appends rules.
        slices: whether parts are sliced with the profile; if so, conflicts between the three parts are errors.
        folders: folders of profiles that are searched before the user's and the shipped ones.

    Raises:
        ProfileError: a setting is invalid; names file, line, key and bound.
    """
    names = dict(zip(KINDS, map(_convert_name_to_text, (printer, material, quality)), strict=True))
    _check_folders(folders)
    changes = _choose_planner(_check_changes({} if changes is None else changes))
    sources = read_sources(names, changes, [Path(one) for one in folders])
    profile = _build_profile(sources, slices=slices)
    return replace(profile, changed=tuple(_list_changed_keys(sources, changes)))


def _convert_name_to_text(name: str | os.PathLike[str] | None) -> str | None:
    """Return the name of a profile as text."""
    return None if name is None else os.fspath(name)


def _check_folders(folders: object) -> None:
    """Check that folders of profiles are a list of paths.

    Raises:
        UsageError: they are not, for example a single path.
    """
    if isinstance(folders, PATH) or not isinstance(folders, Sequence):
        raise UsageError(
            f"folders of profiles must be a list, not {describe_type(folders)}",
            remedy='Pass a list of folders, such as ["my_profiles"]',
        )
    for folder in folders:
        check_argument("folders", folder, PATH)


def _check_changes(changes: Mapping[str, object]) -> Mapping[str, object]:
    """Check that changes of settings are a mapping without None as a value, and return them.

    Raises:
        ProfileError: they are not a mapping, or a value is None.
    """
    if not isinstance(changes, Mapping):
        raise ProfileError(
            f"changes must be a mapping of names to values, not {describe_type(changes)}",
            remedy='Write it like this: changes={"layer_height": 0.2}',
        )
    for key, value in changes.items():
        if value is None:
            raise ProfileError(
                f"{key}: None is not a value", remedy="Omit the setting to keep the value of the profile"
            )
    return changes


def _choose_planner(changes: Mapping[str, object]) -> Mapping[str, object]:
    """Add the uniform planner to changes that set a layer height but no planner setting; return the changes."""
    named = {key.removeprefix("quality.") for key in changes}
    if "layer_height" not in named or any(key.startswith("planner.") for key in named):
        return changes
    return {"quality.planner.kind": "uniform", **changes}


def complete_profile(
    own: Mapping[str, Mapping[str, Any]],
    names: Mapping[str, str | None],
    changes: Mapping[str, object] | None = None,
    folders: Sequence[Path] = (),
    *,
    slices: bool = False,
) -> Profile:
    """Build a profile from the settings in G-code or a file of another slicer; named profiles supply what is missing.

    Args:
        own: kind -> settings in the file; they are not used if `names` has a profile of this kind.
        names: as for `read_sources`.
        changes: as for `load_profile`.
        folders: as for `load_profile`.
        slices: as for `load_profile`.

    Raises:
        ProfileError: a setting is invalid; names file, line, key and bound.
    """
    sources = {
        kind: SettingsSource(dict(own[kind]), {}, f"{kind} of the file")
        if kind in own and not names.get(kind)
        else read_chain(kind, names.get(kind) or DEFAULT_NAMES[kind], folders)
        for kind in KINDS
    }
    profile = _build_profile(_apply_changes(sources, changes or {}), slices=slices)
    return replace(profile, changed=tuple(_list_changed_keys(sources, changes or {})))


def read_sources(
    names: Mapping[str, str | None], changes: Mapping[str, object] | None = None, folders: Sequence[Path] = ()
) -> dict[str, SettingsSource]:
    """Read printer, material and quality, and apply changes; None in `names` means the default profile.

    Raises:
        ProfileError: a file or a key does not exist.
    """
    sources = {kind: read_chain(kind, names.get(kind) or DEFAULT_NAMES[kind], folders) for kind in KINDS}
    return _apply_changes(sources, changes or {})


def _apply_changes(
    sources: dict[str, SettingsSource], changes: Mapping[str, object]
) -> dict[str, SettingsSource]:
    """Apply all changes in place; the planner's kind comes first, because it determines the planner's settings."""
    for key, value in sorted(changes.items(), key=_sort_key):
        _apply_change(sources, key, value)
    return sources


def _sort_key(change: tuple[str, object]) -> int:
    """Return the sort key of a change: the planner's kind first, appended rules last."""
    key = change[0]
    return -1 if key.endswith("planner.kind") else int(key.endswith("+"))


@check_arguments(profile=Profile)
def profile_with(profile: Profile, changes: Mapping[str, object]) -> Profile:
    """Return a copy of a profile with some settings changed and all bounds checked.

    Args:
        profile: the profile, which is not changed.
        changes: as for `load_profile`.

    Raises:
        ProfileError: a setting does not exist, or a value is out of bounds.
    """
    return _copy_with_changes(profile, _check_changes(changes))


def _copy_with_changes(profile: Profile, changes: Mapping[str, object], *, slices: bool = True) -> Profile:
    """Return a copy of a profile with some settings changed."""
    sources = {
        kind: SettingsSource(
            msgspec.to_builtins(getattr(profile, kind)), {}, f"{kind} {getattr(profile, kind).name!r}"
        )
        for kind in KINDS
    }
    made = _build_profile(_apply_changes(sources, changes), slices=slices)
    return replace(made, changed=tuple(sorted({*profile.changed, *_list_changed_keys(sources, changes)})))


def _list_changed_keys(sources: Mapping[str, SettingsSource], changes: Mapping[str, object]) -> list[str]:
    """Return the full keys, such as `quality.perimeters`, of the settings that changes have set."""
    return sorted(
        {".".join(resolve_key(sources, find_current_name(key.removesuffix("+")))) for key in changes}
    )


def settings_as_dict(profile: Profile) -> dict[str, dict[str, Any]]:
    """Return all settings as values for JSON; `restore_profile` converts them back to a profile."""
    return {kind: msgspec.to_builtins(getattr(profile, kind)) for kind in KINDS}


def restore_profile(values: Mapping[str, Mapping[str, Any]]) -> Profile:
    """Convert the result of `settings_as_dict` back to a profile, without looking for conflicts.

    Raises:
        ProfileError: the settings belong to another version of this program.
    """
    sources = {
        kind: SettingsSource(replace_former_names(values.get(kind, {})), {}, f"the stored {kind}")
        for kind in KINDS
    }
    return _build_profile(sources, slices=False)


def list_settings(profile: Profile) -> Iterator[tuple[str, object]]:
    """Yield all settings as pairs (`section.key`, value), in the order of their definition."""
    for kind in KINDS:
        for path, value in flatten_tables(msgspec.to_builtins(getattr(profile, kind))):
            yield f"{kind}.{path}", value


def _apply_change(sources: dict[str, SettingsSource], key: str, value: object) -> None:
    """Apply one change in place."""
    appends = key.endswith("+")
    kind, path = resolve_key(sources, replace_former_name(key.removesuffix("+")))
    typed = value
    value = parse_list(path, value) if path in LISTS and isinstance(value, str) else _normalize_value(value)
    if isinstance(value, str):
        value = _normalize_choice(kind, path, value)
    *tables, leaf = path.split(".")
    change: dict[str, Any] = {leaf: value}
    for table in reversed(tables):
        change = {table: change}
    source = sources[kind]
    if tables and not isinstance(source.values.get(tables[0], {}), dict):
        return  # the file has a plain value instead of a table; the conversion reports it
    if appends and isinstance(value, list):
        sources[kind] = merge_sources(
            source, SettingsSource(change, _list_rule_places(path, value), source.file)
        )
        return
    places = {one: place for one, place in source.places.items() if not one.startswith(f"{path}[")}
    places[path] = f"{key}={typed}"
    sources[kind] = SettingsSource(merge_tables(source.values, change), places, source.file)


def _list_rule_places(path: str, rules: Sequence[Any]) -> dict[str, str]:
    """Map the key of each added rule to its text, which is its place in messages; map the list to the last text."""
    places = {path: path}
    for i, one in enumerate(rules):
        with suppress(AttributeError, KeyError, TypeError, ValueError, msgspec.ValidationError):
            places[path] = places[f"{path}[{i}]"] = f"override {format_list([one])}"
    return places


def _normalize_choice(kind: str, path: str, text: str) -> str:
    """Convert a choice to lower case, in which all choices are written: `Gyroid` becomes `gyroid`."""
    if text == text.lower():
        return text
    from printer_slicer.profile.tables import find_choices  # noqa: PLC0415 - for capital letters only

    return text.lower() if text.lower() in find_choices(KINDS[kind], path).split(", ") else text


def _normalize_value(value: Any) -> Any:
    """Convert numpy values to Python's, and numbers such as `.5` or `5.` to a form with digits on both sides."""
    if isinstance(value, list | tuple):
        return [_normalize_value(item) for item in value]
    if isinstance(value, str):
        found = _BARE_POINT.fullmatch(value.strip())
        return (
            f"{found[1].strip('+')}{found[2] or 0}.{found[3] or 0}"
            if found and (found[2] or found[3])
            else value
        )
    return value.tolist() if hasattr(value, "tolist") else value


def _build_profile(sources: Mapping[str, SettingsSource], *, slices: bool = True) -> Profile:
    """Convert the sections to a profile, and check it."""
    profile = Profile(**{kind: convert_section(kind, source) for kind, source in sources.items()})
    for fault in _find_conflicts(profile, sources, slices=slices):
        raise fault.make_error()
    return profile


def find_conflicts(sources: Mapping[str, SettingsSource]) -> list[SettingFault]:
    """Return the conflicts between printer, material and quality.

    Raises:
        ProfileError: one of them is invalid by itself.
    """
    profile = Profile(**{kind: convert_section(kind, source) for kind, source in sources.items()})
    return list(_find_conflicts(profile, sources, slices=True))


def _find_conflicts(
    profile: Profile, sources: Mapping[str, SettingsSource], *, slices: bool
) -> Iterator[SettingFault]:
    """Yield conflicts between printer, material and quality, and errors in overrides."""
    for key, problem, remedy in find_all_conflicts(profile) if slices else ():
        kind, _, path = key.partition(".")
        yield SettingFault(sources[kind].find_place_or_file(path), path, f"{key}: {problem}", remedy)
    yield from _find_override_faults(profile, sources["quality"], slices=slices)


def _find_override_faults(
    profile: Profile, source: SettingsSource, *, slices: bool
) -> Iterator[SettingFault]:
    """Yield errors in overrides, and conflicts of overrides with other settings."""
    if not profile.quality.overrides:
        return
    from printer_slicer.profile.override_checks import find_override_faults  # noqa: PLC0415 - few profiles have overrides

    faults = list(find_override_faults(profile.quality))
    for path, problem, remedy in faults:
        yield SettingFault(source.find_place_or_file(path), path, f"quality.overrides: {problem}", remedy)
    for i, one in enumerate(() if faults else profile.quality.overrides):
        path, changed = f"overrides[{i}]", {"quality.overrides": (), **one.set}
        try:
            _copy_with_changes(profile, changed, slices=slices)
        except ProfileError as error:
            problem = str(error.args[0]).partition(": ")[2] or error.args[0]
            message = f"quality.overrides: {one.format_place()}: {problem}"
            yield SettingFault(source.find_place_or_file(path), path, message, error.remedy)
