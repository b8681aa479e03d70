"""Profiles from TOML files: found by name, inherited, changed from the command line, checked.

A profile has three parts, one file each: `printers/NAME.toml`, `materials/NAME.toml`, `qualities/NAME.toml`. A file may
say `inherits = "OTHER"`; its own keys win. Changes such as `quality.perimeters = 3` come last and obey the same bounds.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import msgspec

from printer_slicer.errors import ProfileError
from printer_slicer.profile.checks import conflicts
from printer_slicer.profile.conversion import SettingFault, converted
from printer_slicer.profile.keys import resolved
from printer_slicer.profile.lists import LISTS, list_as_text, list_from_text
from printer_slicer.profile.profile import Profile
from printer_slicer.profile.reading import (
    DEFAULT_NAMES,
    KINDS,
    SettingsSource,
    flatten,
    laid_over,
    merged,
    read_chain,
)
from printer_slicer.profile.renamed import current_names, warn_of
from printer_slicer.texts import describe_type

__all__ = [
    "faults_together",
    "load_profile",
    "profile_from",
    "profile_over",
    "profile_with",
    "read_sources",
    "settings_of",
    "settings_text",
]

_SHARES = ("0-1", "ratio")
_BARE_POINT = re.compile(r"([-+]?)([0-9]*)\.([0-9]*)")


def load_profile(
    printer: str | None = None,
    material: str | None = None,
    quality: str | None = None,
    changes: Mapping[str, object] | None = None,
    *,
    slices: bool = True,
    folders: Sequence[Path] = (),
) -> Profile:
    """The profile made of three parts and some changes.

    Args:
        printer: name of a profile or path of a TOML file; None takes the default, as for the other two.
        material: likewise.
        quality: likewise.
        changes: `section.key` or, where it is unique, `key` -> value; text is converted to the setting's type. A
            `layer_height` without a setting of a planner means uniform layers. With a + behind the key, as in
            `overrides+`, rules come behind those of the file instead of in their place.
        slices: whether parts are sliced with it, so that printer, material and quality must suit each other.
        folders: of profiles, looked into before the person's own and the shipped ones.

    Raises:
        ProfileError: naming file, line, key and bound.
    """
    names = {"printer": printer, "material": material, "quality": quality}
    if changes is not None and not isinstance(changes, Mapping):
        raise ProfileError(
            f"changes are a table of names and values, not {describe_type(changes)}",
            remedy='write changes={"layer_height": 0.2}',
        )
    return _built(read_sources(names, _meant(changes or {}), folders), slices=slices)


def _meant(changes: Mapping[str, object]) -> Mapping[str, object]:
    """The same changes, with uniform layers where a layer height is named and nothing of a planner."""
    named = {key.removeprefix("quality.") for key in changes}
    if "layer_height" not in named or any(key.startswith("planner.") for key in named):
        return changes
    return {"quality.planner.kind": "uniform", **changes}


def profile_over(
    own: Mapping[str, Mapping[str, Any]],
    names: Mapping[str, str | None],
    changes: Mapping[str, object] | None = None,
    folders: Sequence[Path] = (),
    *,
    slices: bool = False,
) -> Profile:
    """Load a profile around settings that a file has: G-code, or a file of another slicer.

    Args:
        own: kind -> settings of the file, used if `names` has no other profile.
        names: as for `read_sources`.
        changes: as for `load_profile`.
        folders: as for `load_profile`.
        slices: as for `load_profile`.

    Raises:
        ProfileError: naming file, line, key and bound.
    """
    sources = {
        kind: SettingsSource(dict(own[kind]), {}, f"{kind} of the file")
        if kind in own and not names.get(kind)
        else read_chain(kind, names.get(kind) or DEFAULT_NAMES[kind], folders)
        for kind in KINDS
    }
    return _built(_changed(sources, changes or {}), slices=slices)


def read_sources(
    names: Mapping[str, str | None], changes: Mapping[str, object] | None = None, folders: Sequence[Path] = ()
) -> dict[str, SettingsSource]:
    """The three parts as they are read, with changes; None in `names` is the default.

    Raises:
        ProfileError: a file or a key that there is not.
    """
    sources = {kind: read_chain(kind, names.get(kind) or DEFAULT_NAMES[kind], folders) for kind in KINDS}
    return _changed(sources, changes or {})


def _changed(sources: dict[str, SettingsSource], changes: Mapping[str, object]) -> dict[str, SettingsSource]:
    """The sources with all changes applied; the planner's kind first, since the other planner settings hang on it."""
    for key, value in sorted(changes.items(), key=_turn):
        _change(sources, key, value)
    return sources


def _turn(change: tuple[str, object]) -> int:
    """When it is applied: the planner's kind first, what is added last."""
    key = change[0]
    return -1 if key.endswith("planner.kind") else int(key.endswith("+"))


def profile_with(profile: Profile, changes: Mapping[str, object]) -> Profile:
    """The same profile with some settings changed; bounds are checked, unlike by the structs' constructors.

    Args:
        profile: stays as it is.
        changes: as for `load_profile`.

    Raises:
        ProfileError: a change that is out of bounds, or of a setting that there is not.
    """
    return _with(profile, changes)


def _with(profile: Profile, changes: Mapping[str, object], *, slices: bool = True) -> Profile:
    sources = {
        kind: SettingsSource(
            msgspec.to_builtins(getattr(profile, kind)), {}, f"{kind} {getattr(profile, kind).name!r}"
        )
        for kind in KINDS
    }
    return _built(_changed(sources, changes), slices=slices)


def settings_of(profile: Profile) -> dict[str, dict[str, Any]]:
    """All settings of the three parts as JSON can hold them; `profile_from` makes a profile of them again."""
    return {kind: msgspec.to_builtins(getattr(profile, kind)) for kind in KINDS}


def profile_from(values: Mapping[str, Mapping[str, Any]]) -> Profile:
    """The profile whose `settings_of` these are; whether its parts suit each other is not asked again.

    Raises:
        ProfileError: they are of another version of this program.
    """
    sources = {
        kind: SettingsSource(current_names(values.get(kind, {})), {}, f"the kept {kind}") for kind in KINDS
    }
    return _built(sources, slices=False)


def settings_text(profile: Profile) -> Iterator[tuple[str, object]]:
    """All settings, flat: (`section.key`, value) in the order they are declared."""
    for kind in KINDS:
        for path, value in flatten(msgspec.to_builtins(getattr(profile, kind))):
            yield f"{kind}.{path}", value


def _change(sources: dict[str, SettingsSource], key: str, value: object) -> None:
    """Apply one change in place."""
    adds = key.endswith("+")
    kind, path = resolved(sources, warn_of(key.removesuffix("+")))
    typed = value
    value = list_from_text(path, value) if path in LISTS and isinstance(value, str) else _plain(value)
    if isinstance(value, str) and value.endswith("%"):
        value = _share(kind, path, value)
    *tables, leaf = path.split(".")
    change: dict[str, Any] = {leaf: value}
    for table in reversed(tables):
        change = {table: change}
    source = sources[kind]
    if tables and not isinstance(source.values.get(tables[0], {}), dict):
        return  # the file has a plain value where a table belongs, which the conversion will refuse by name
    if adds and isinstance(value, list):
        sources[kind] = laid_over(source, SettingsSource(change, _places_of(path, value), source.file))
        return
    places = {one: place for one, place in source.places.items() if not one.startswith(f"{path}[")}
    places[path] = f"{key}={typed}"
    sources[kind] = SettingsSource(merged(source.values, change), places, source.file)


def _places_of(path: str, rules: Sequence[Any]) -> dict[str, str]:
    """Return the text of each rule that is added as its place, and the last one's as that of the list."""
    places = {path: path}
    for i, one in enumerate(rules):
        with suppress(AttributeError, KeyError, TypeError, ValueError, msgspec.ValidationError):
            places[path] = places[f"{path}[{i}]"] = f"override {list_as_text([one])}"
    return places


def _share(kind: str, path: str, text: str) -> str:
    """Return a percentage as the share that a setting without a unit expects; the text itself for other settings."""
    from printer_slicer.profile.tables import settings_table  # noqa: PLC0415 - for percentages only

    units = {row.key: row.unit for row in settings_table()}
    try:
        return f"{float(text[:-1]) / 100:.10g}" if units.get(f"{kind}.{path}") in _SHARES else text
    except ValueError:
        return text


def _plain(value: Any) -> Any:
    """Numbers and arrays of numpy as Python's own, typed numbers with a digit before the point and one behind it."""
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, str):
        found = _BARE_POINT.fullmatch(value.strip())
        return (
            f"{found[1].strip('+')}{found[2] or 0}.{found[3] or 0}"
            if found and (found[2] or found[3])
            else value
        )
    return value.tolist() if hasattr(value, "tolist") else value


def _built(sources: Mapping[str, SettingsSource], *, slices: bool = True) -> Profile:
    """The checked profile."""
    profile = Profile(**{kind: converted(kind, source) for kind, source in sources.items()})
    for fault in _faults(profile, sources, slices=slices):
        raise fault.error()
    return profile


def faults_together(sources: Mapping[str, SettingsSource]) -> list[SettingFault]:
    """Everything in which three parts, each good by itself, do not suit each other.

    Raises:
        ProfileError: one is not good by itself.
    """
    profile = Profile(**{kind: converted(kind, source) for kind, source in sources.items()})
    return list(_faults(profile, sources, slices=True))


def _faults(
    profile: Profile, sources: Mapping[str, SettingsSource], *, slices: bool
) -> Iterator[SettingFault]:
    """What does not suit each other, and what is wrong with settings of objects and heights."""
    for key, problem, remedy in conflicts(profile) if slices else ():
        kind, _, path = key.partition(".")
        yield SettingFault(sources[kind].place(path), path, f"{key}: {problem}", remedy)
    yield from _faults_of_places(profile, sources["quality"], slices=slices)


def _faults_of_places(profile: Profile, source: SettingsSource, *, slices: bool) -> Iterator[SettingFault]:
    """Settings of objects and heights that there are not, that cannot differ, or that do not suit the others."""
    if not profile.quality.overrides:
        return
    from printer_slicer.profile.override_checks import own_faults  # noqa: PLC0415 - few profiles have overrides

    wrong = list(own_faults(profile.quality))
    for path, problem, remedy in wrong:
        yield SettingFault(source.place(path), path, f"quality.overrides: {problem}", remedy)
    for i, one in enumerate(() if wrong else profile.quality.overrides):
        path, changed = f"overrides[{i}]", {"quality.overrides": (), **one.set}
        try:
            _with(profile, changed, slices=slices)
        except ProfileError as error:
            problem = str(error.args[0]).partition(": ")[2] or error.args[0]
            told = f"quality.overrides: {one.where()}: {problem}"
            yield SettingFault(source.place(path), path, told, error.remedy)
