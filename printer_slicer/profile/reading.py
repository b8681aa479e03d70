"""Read one part of a profile from TOML files, with inheritance and the origin of every key."""

from __future__ import annotations

import errno
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Final, NamedTuple

import msgspec

from printer_slicer.errors import ProfileError
from printer_slicer.input_files import read_input
from printer_slicer.profile.folders import FOLDERS, find_profile_paths, list_search_folders
from printer_slicer.profile.lists import LISTS, format_list, merge_lists, parse_list
from printer_slicer.profile.renamed import (
    find_current_name,
    list_override_keys,
    replace_former_name,
    replace_former_names,
)
from printer_slicer.profile.settings import Material, Printer, Quality
from printer_slicer.texts import find_similar_words
from printer_slicer.toml_text import MAX_BYTES, TomlError, find_key_lines, parse_toml

__all__ = [
    "DEFAULT_NAMES",
    "KINDS",
    "OtherFormatError",
    "SettingsSource",
    "find_profile_file",
    "find_profile_kind",
    "flatten_tables",
    "merge_sources",
    "merge_tables",
    "read_chain",
]

KINDS: Final[Mapping[str, type[msgspec.Struct]]] = {
    "printer": Printer,
    "material": Material,
    "quality": Quality,
}
DEFAULT_NAMES: Final[Mapping[str, str]] = {
    "printer": "marlin_220",
    "material": "pla",
    "quality": "adaptive",
}


MAX_ANCESTORS: Final = 32
_MAX_LISTED: Final = 16  # names in a message
MAX_NAME_BYTES: Final = 200
MAX_PATH: Final = 1000
"""Maximum length of a file name in bytes, and of a path in characters; systems allow 255 and a few thousand."""


_OTHER_FORMATS: Final = (".ini", ".json", ".cfg", ".curaprofile", ".3mf", ".gcode")
"""Suffixes of files in which other slicers, and G-code of this program, have settings."""


class SettingsSource(NamedTuple):
    """Settings of one kind, and the places where they were set.

    Attributes:
        values: the settings, nested as in a file.
        places: dotted key -> place: a file with a line, or the option that was typed.
        file: place of keys that were not set.
    """

    values: dict[str, Any]
    places: dict[str, str]
    file: str

    def find_place_or_file(self, path: str) -> str:
        """Return where a key, or the table that contains it, was set; the file if neither was set."""
        return self.find_place(path) or self.file

    def find_place(self, path: str) -> str:
        """Return where a key, or the table that contains it, was set; an empty text if neither was set."""
        path = path.replace("[...]", "")
        while "[" in path:  # an entry of a list that has no place takes the place of the list
            if path in self.places:
                return self.places[path]
            path = path.removesuffix("]").rpartition("[" if path.endswith("]") else ".")[0]
        for key in reversed(self.places):
            if path and (f"{key}.".startswith(f"{path}.") or f"{path}.".startswith(f"{key}.")):
                return self.places[key]
        return ""


def read_chain(
    kind: str, name: str, folders: Sequence[Path] = (), seen: tuple[Path, ...] = ()
) -> SettingsSource:
    """Read the settings of a file and of the files that it inherits from.

    Args:
        kind: `printer`, `material` or `quality`.
        name: name of a profile, or path of a TOML file, relative to the file that inherits from it.
        folders: folders that are searched first.
        seen: the files that inherit from it, its direct heir last.

    Raises:
        ProfileError: a file does not exist, cannot be read, or inherits from itself.
    """
    path = find_profile_file(kind, name, folders, seen)
    if path in seen:
        cycle = " -> ".join(one.name for one in (*seen[seen.index(path) :], path))
        raise ProfileError(f"{path}: inherits from itself: {cycle}", remedy="Remove one of these `inherits`")
    if len(seen) > MAX_ANCESTORS:
        raise ProfileError(
            f"{seen[0]}: more than {MAX_ANCESTORS} levels of inheritance", remedy="Inherit from fewer files"
        )
    text, values = _read_toml(path)
    lines = {find_current_name(key): line for key, line in find_key_lines(text).items()}
    for key in _list_leaf_keys(values):
        replace_former_name(key, f"{path}:{_find_line(lines, find_current_name(key))}")
    for key in list_override_keys(values):
        replace_former_name(key, f"{path}:{_find_line(lines, 'overrides')}: override")
    values = replace_former_names(values)
    parent = values.pop("inherits", None)
    if parent is not None and not isinstance(parent, str):
        raise ProfileError(
            f"{path}:{lines.get('inherits', 1)}: inherits: expected the name of a profile, got {parent!r}",
            remedy=f'Write it like this: inherits = "{DEFAULT_NAMES[kind]}"',
        )
    _check_aliases(values.pop("aliases", []), f"{path}:{lines.get('aliases', 1)}")
    base = read_chain(kind, parent, folders, (*seen, path)) if parent else SettingsSource({}, {}, str(path))
    places = {
        key: f"{path}:{_find_line(lines, key)}"
        for key in [*_list_leaf_keys(values), *(one for one in lines if "[" in one)]
    }
    if kind == "quality":
        _choose_uniform_planner(base, values)
    return merge_sources(base, SettingsSource(_parse_lists(values), places, str(path)))


def _check_aliases(aliases: object, place: str) -> None:
    """Check the aliases of a profile: further names, by which `finding` finds the profile.

    Raises:
        ProfileError: they are not a list of texts.
    """
    if not isinstance(aliases, list) or not all(isinstance(one, str) for one in aliases):
        raise ProfileError(
            f"{place}: aliases: expected a list of names, got {aliases!r}",
            remedy='Write it like this: aliases = ["Ender-3 Pro"]',
        )


def _choose_uniform_planner(base: SettingsSource, values: dict[str, Any]) -> None:
    """Set the uniform planner in `values` if a quality sets a layer height and inherits its planner.

    Other planners choose the layer heights themselves, so the layer height would be ignored.
    """
    if "layer_height" in values and "planner" not in values:
        base.values.pop("planner", None)
        values["planner"] = {"kind": "uniform"}


def merge_sources(base: SettingsSource, over: SettingsSource) -> SettingsSource:
    """Merge settings into base settings, with their places; rules for objects and height ranges are appended."""
    values = merge_tables(base.values, over.values, appends=True)
    places = dict(base.places)
    for key, place in over.places.items():
        found = re.match(r"(.+?)\[(\d+)\](.*)", key)
        before = _count_items(values, found[1]) - _count_items(over.values, found[1]) if found else 0
        places[f"{found[1]}[{int(found[2]) + before}]{found[3]}" if found else key] = place
    return SettingsSource(values, places, over.file)


def _count_items(values: Mapping[str, Any], path: str) -> int:
    """Return the number of items in the list at a dotted key; 0 if there is no list."""
    found: Any = values
    for key in path.split("."):
        found = found.get(key) if isinstance(found, Mapping) else None
    return len(found) if isinstance(found, list) else 0


def _parse_lists(values: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Parse settings that are lists written as text; the later conversion of types reports invalid texts."""
    result = dict(values)
    for key, value in values.items():
        if isinstance(value, dict):
            result[key] = _parse_lists(value, f"{prefix}{key}.")
        elif isinstance(value, str) and prefix + key in LISTS:
            with suppress(ProfileError):
                result[key] = parse_list(prefix + key, value)
    return result


def _list_leaf_keys(values: Mapping[str, Any], prefix: str = "") -> Iterator[str]:
    """Yield the dotted keys of all values that are not tables."""
    for key, value in values.items():
        yield from _list_leaf_keys(value, f"{prefix}{key}.") if isinstance(value, dict) else (prefix + key,)


def _find_line(lines: Mapping[str, int], key: str) -> int:
    """Return the line number of a key, or of the table that contains it."""
    while key not in lines and "." in key:
        key = key.rpartition(".")[0]
    return lines.get(key, 1)


def _read_toml(path: Path) -> tuple[str, dict[str, Any]]:
    """Read a TOML file; return its text and its values."""
    try:
        text = read_input(path, MAX_BYTES).decode("utf-8-sig").replace("\r\n", "\n")
        return text, parse_toml(text)
    except TomlError as error:
        raise ProfileError(
            f"{path}:{error.line}: not valid TOML: {error.reason}",
            remedy="Correct this line",
        ) from None
    except UnicodeDecodeError as error:
        raise ProfileError(
            f"{path}: not valid TOML: {error}", remedy="Save the file with UTF-8 encoding"
        ) from None
    except OSError as error:
        if error.errno == errno.EFBIG:
            raise ProfileError(
                f"{path}: larger than {MAX_BYTES >> 20} MiB, too large for a profile",
                remedy="Check the path",
            ) from None
        raise ProfileError(
            f"{path}: cannot be read: {error.strerror}", remedy="Check the file's permissions"
        ) from None


def find_profile_file(
    kind: str, name: str, folders: Sequence[Path] = (), seen: tuple[Path, ...] = ()
) -> Path:
    """Return the file of a profile, by name or by path.

    A profile that inherits from its own name inherits from the next one of that name, such as a user's `pla` from the
    shipped `pla`.

    Raises:
        ProfileError: there is no such profile.
    """
    asked_by = f"{seen[-1]}: inherits: " if seen else ""
    if len(name) > MAX_PATH or any(
        len(part.encode("utf-8", "replace")) > MAX_NAME_BYTES for part in Path(name).parts
    ):
        raise ProfileError(
            f"{asked_by}{kind} {name[:60]!r}...: too long for a file name", remedy="Check the name"
        )
    if name.endswith(".toml") or "/" in name:
        path = (seen[-1].parent if seen else Path()) / name
        if not path.is_file():
            raise _explain_missing_file(path, asked_by, f"{kind} ")
        _check_format(path, asked_by)
        return path
    candidates = [folder / FOLDERS[kind] / f"{name}.toml" for folder in list_search_folders(folders)]
    try:
        files = [path for path in candidates if path.is_file()]
    except ValueError:  # not a valid file name
        files = []
    if seen and seen[-1] in files:
        files = files[files.index(seen[-1]) + 1 :] or [seen[-1]]
    if files:
        return files[0]
    if not seen:
        _check_format(Path(name), asked_by)
    for path in candidates:
        if "\0" not in name and (path.is_dir() or path.is_symlink()):
            raise _explain_missing_file(path, asked_by)
    return _find_by_display_name(kind, name, folders, asked_by)


class OtherFormatError(ProfileError):
    """A file named as a profile has the format of another slicer."""


def _check_format(path: Path, asked_by: str = "") -> None:
    """Check that a path, which need not exist, is not a file with settings of another slicer.

    Raises:
        OtherFormatError: it is one, or a project or G-code.
    """
    if path.suffix.lower() in _OTHER_FORMATS and path.is_file():
        raise OtherFormatError(
            f"{asked_by}{path}: not a profile of this program, which is a .toml file",
            remedy=f"Convert it with `printer-slicer profiles import {path}`",
        )


def _describe_known_names(known: Collection[str]) -> str:
    """Format a remedy that lists the known names; if there are many, it names a command that lists them."""
    return (
        f"Known: {', '.join(known)}" if len(known) <= _MAX_LISTED else "`printer-slicer profiles` lists all"
    )


def _find_by_display_name(kind: str, name: str, folders: Sequence[Path], asked_by: str) -> Path:
    """Find the file of a profile by its display name, its model, or words of these.

    Raises:
        ProfileError: no profile matches clearly better than the others; suggests those that match.
    """
    from printer_slicer.profile.finding import find_profiles, suggest_profiles  # noqa: PLC0415 - reads all profiles

    known = find_profile_paths(kind, folders)
    matches = find_profiles(kind, name, folders)
    if matches and matches[0].is_sure and not asked_by:
        return known[matches[0].name]
    is_ambiguous = len(matches) > 1 and not matches[0].is_sure
    raise ProfileError(
        f"{asked_by}{'several profiles match' if is_ambiguous else 'unknown'} {kind} {name!r}",
        remedy=suggest_profiles(kind, name, folders)
        or f"{_describe_known_names(known)}; the path of a .toml file is accepted too",
    )


def _explain_missing_file(path: Path, asked_by: str = "", kind: str = "") -> ProfileError:
    """Return an error that explains why a path is not a profile."""
    problem = f"no such {kind}profile"
    if path.is_dir():
        problem = "is a folder, not a profile"
    elif path.exists():
        problem = "is a pipe or a device, not a file"
    elif path.is_symlink():
        problem = "is a link to a missing file"
    return ProfileError(
        f"{asked_by}{path}: {problem}",
        remedy="Check the path, or choose a profile that `printer-slicer profiles` lists",
    )


def find_profile_kind(name: str, folders: Sequence[Path] = ()) -> str:
    """Return the kind of a profile: `printer`, `material` or `quality`.

    The kind of a file is determined from its folder, from the profile that it inherits from, or from its keys, in this
    order. The kind of a name that matches several profiles is theirs.

    Raises:
        ProfileError: the profile is unknown, or its kind is ambiguous.
    """
    if name.endswith(".toml") or "/" in name:
        return _find_kind_of_file(Path(name), folders)
    kinds = [kind for kind in KINDS if name in find_profile_paths(kind, folders)]
    if len(kinds) == 1:
        return kinds[0]
    if kinds:
        raise ProfileError(
            f"{name!r} is the name of a {' and of a '.join(kinds)}",
            remedy=f"Write the kind before the name: {kinds[0]} {name}",
        )
    return _find_matching_kind(name, folders)


def _find_matching_kind(name: str, folders: Sequence[Path]) -> str:
    """Return the kind of the profiles that a text matches, by display name or by words.

    Raises:
        ProfileError: no profile matches, or profiles of several kinds match equally well.
    """
    from printer_slicer.profile.finding import find_profiles  # noqa: PLC0415 - reads all profiles

    matches = {kind: found for kind in KINDS if (found := find_profiles(kind, name, folders))}
    candidates = [kind for kind, found in matches.items() if found[0].is_sure] or list(matches)
    if len(candidates) == 1:
        return candidates[0]
    if candidates:
        shown = ", ".join(f"{kind} {matches[kind][0].name}" for kind in candidates)
        raise ProfileError(f"several profiles match {name!r}", remedy=f"Did you mean {shown}?")
    known = sorted(one for kind in KINDS for one in find_profile_paths(kind, folders))
    near = find_similar_words(name, known, most=1)
    hint = f"Did you mean {near[0]!r}? " if near else ""
    raise ProfileError(
        f"unknown profile {name!r}", remedy=f"{hint}`printer-slicer profiles` lists all profiles"
    )


def _find_kind_of_file(path: Path, folders: Sequence[Path]) -> str:
    """Return the kind of a profile's file."""
    for kind, folder in FOLDERS.items():
        if path.absolute().parent.name == folder:
            return kind
    if not path.is_file():
        raise _explain_missing_file(path)
    _check_format(path)
    values = _read_toml(path)[1]
    parent = values.get("inherits")
    if isinstance(parent, str) and not (parent.endswith(".toml") or "/" in parent):
        kinds = [kind for kind in KINDS if parent in find_profile_paths(kind, folders)]
        if len(kinds) == 1:
            return kinds[0]
    counts = {kind: len(set(values) & set(struct.__struct_fields__)) for kind, struct in KINDS.items()}
    best = max(counts, key=lambda kind: counts[kind])
    if list(counts.values()).count(counts[best]) == 1:
        return best
    raise ProfileError(
        f"{path}: cannot tell whether this is a printer, a material or a quality",
        remedy=f"Write the kind before the path (printer {path}), or move it to a folder {', '.join(FOLDERS.values())}",
    )


def merge_tables(
    base: Mapping[str, Any], over: Mapping[str, Any], *, appends: bool = False, prefix: str = ""
) -> dict[str, Any]:
    """Merge `over` into `base`, table by table; a table with another `kind` replaces the whole table.

    Args:
        base: the values with lower precedence.
        over: the values with higher precedence.
        appends: whether rules for objects and height ranges are appended instead of replaced.
        prefix: the dotted key of the tables, with a trailing dot.
    """
    result = dict(base)
    for key, value in over.items():
        old = result.get(key)
        if (
            isinstance(value, dict)
            and isinstance(old, dict)
            and value.get("kind", old.get("kind")) == old.get("kind")
        ):
            result[key] = merge_tables(old, value, appends=appends, prefix=f"{prefix}{key}.")
        elif appends and isinstance(value, list) and isinstance(old, list | tuple):
            result[key] = merge_lists(prefix + key, old, value)
        else:
            result[key] = value
    return result


def flatten_tables(values: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, object]]:
    """Yield settings as dotted key and value; lists are converted to text."""
    for key, value in values.items():
        if isinstance(value, dict):
            yield from flatten_tables(value, f"{prefix}{key}.")
        else:
            yield prefix + key, format_list(value) if isinstance(value, list | tuple) else value
