"""Read settings from files that the command line names: G-code, and profiles of --load."""

from __future__ import annotations

import argparse
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

from printer_slicer.errors import ProfileError, UsageError

__all__ = ["FileSettings", "name_settings", "read_gcode_settings", "read_loaded_files"]

_SEARCHED_BYTES: Final = 1 << 14  # at both ends of a file, where slicers name the machine
_MACHINE: Final = re.compile(
    rb"^; ?(?:TARGET_MACHINE\.NAME:|machine_type:|printer_model = |printer_settings_id = )([^\r\n]{1,100})",
    re.MULTILINE,
)


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


def read_loaded_files(arguments: argparse.Namespace, names: dict[str, Any]) -> FileSettings:
    """Read the settings in the files of --load; the .toml files among them are added to `names` instead.

    Raises:
        UsageError: a file has no settings, several profiles of one kind, or a profile that cannot be used.
    """
    values: dict[str, Mapping[str, Any]] = {}
    files: Sequence[Path] = getattr(arguments, "load", ())
    for path in files:
        if path.suffix == ".toml":
            from printer_slicer.profile.reading import find_profile_kind

            kind = find_profile_kind(str(path.absolute()))
            names[kind] = names[kind] or str(path)
            continue
        values |= _import_file(path)
    return FileSettings(values, (), source="from --load")


def _import_file(path: Path) -> dict[str, Mapping[str, Any]]:
    """Return the settings in a file of another slicer: kind -> settings.

    Raises:
        UsageError: the file has no settings, several profiles of one kind, or a profile that cannot be used.
    """
    from printer_slicer.importing import import_profiles
    from printer_slicer.importing.results import RejectedProfile

    try:
        found = import_profiles(path)
    except ProfileError as error:
        raise UsageError(str(error.args[0]), remedy=_find_load_remedy(path, error.remedy)) from None
    values: dict[str, Mapping[str, Any]] = {}
    for one in found:
        if isinstance(one, RejectedProfile):
            remedy = _find_load_remedy(path, one.remedy)
            raise UsageError(f"--load {path}: {one.problem}", remedy=remedy)
        values[one.kind] = one.values
    if len(values) < len(found):
        raise UsageError(
            f"--load {path}: the file has {len(found)} profiles, several of one kind",
            remedy=f"Import the profiles of one printer: printer-slicer profiles import {path} --for NAME",
        )
    return values


def _find_load_remedy(path: Path, remedy: str) -> str:
    """Return the remedy for a file of --load: the import command if an option of `profiles import` helps."""
    option = re.search(r"--[a-z-]+ [^\s,;]+", remedy)
    if option is None:
        return remedy
    import shlex

    return f"Import it first: printer-slicer profiles import {shlex.quote(str(path))} {option[0]}"


def read_gcode_settings(path: Path, folders: Sequence[Path] = ()) -> FileSettings:
    """Read the settings in a G-code file that this program, PrusaSlicer or its forks wrote, or the machine it names.

    Settings that an import would reject, such as impossible temperatures, are not used.

    Args:
        path: the G-code file.
        folders: further folders of profiles.

    Raises:
        UsageError: the file is a pipe.
    """
    from printer_slicer.profile.gcode_settings import is_printer_slicer_gcode, read_settings_from_gcode

    if path.is_fifo():  # it can be read only once
        raise UsageError(
            f"{path}: is a pipe, but G-code files are read several times",
            remedy="Pipe it into stdin and use - as the file name, or write it to a file",
        )
    try:
        found = (
            FileSettings(read_settings_from_gcode(path), ())
            if is_printer_slicer_gcode(path)
            else _read_other_slicer_settings(path)
        )
    except (OSError, ValueError):  # an invalid file name
        return FileSettings({}, ())
    except ProfileError as error:
        # A file that cannot be read is reported when all of it is read.
        return FileSettings({}, (str(error.args[0]).removeprefix(f"{path}: "),) if path.is_file() else ())
    return _find_named_machine(path, folders) if found is None else found


def _read_other_slicer_settings(path: Path) -> FileSettings | None:
    """Read the profiles in a G-code file of another slicer; return None if the file has none."""
    from printer_slicer.importing import import_profiles
    from printer_slicer.importing.results import NoSettingsError, RejectedProfile

    try:
        found = import_profiles(path)
    except NoSettingsError:
        return None
    refused = [f"{one.kind}: {one.problem}" for one in found if isinstance(one, RejectedProfile)]
    return FileSettings(
        {one.kind: one.values for one in found if not isinstance(one, RejectedProfile)}, refused
    )


def _find_named_machine(path: Path, folders: Sequence[Path]) -> FileSettings:
    """Return the printer profile of the machine that a file names; if no profile has that name, only the name."""
    from printer_slicer.profile import load_profile, settings_as_dict

    try:
        with path.open("rb") as file:
            head = file.read(_SEARCHED_BYTES)
            file.seek(max(path.stat().st_size - _SEARCHED_BYTES, len(head)))
            found = _MACHINE.search(head + b"\n" + file.read())
    except (OSError, ValueError):
        return FileSettings({}, ())  # reported when all of the file is read
    name = found[1].decode("utf-8", "replace").strip() if found else ""
    profile = _find_profile_by_display_name("printer", name, folders) if name else ""
    if not profile:
        return FileSettings({}, (), name)
    return FileSettings(
        {"printer": settings_as_dict(load_profile(profile, slices=False, folders=folders))["printer"]}, ()
    )


def name_settings(kind: str, values: Mapping[str, Any], folders: Sequence[Path] = ()) -> str:
    """Return the name of the profile that has exactly these settings; if there is none, their display name."""
    from printer_slicer.profile.inspection import has_settings

    display_name = str(values.get("name", ""))
    profile = _find_profile_by_display_name(kind, display_name, folders)
    return profile if profile and has_settings(kind, profile, values, folders) else display_name


def _find_profile_by_display_name(kind: str, name: str, folders: Sequence[Path] = ()) -> str:
    """Return the name that selects the profile with a given display name; empty if there is no such profile."""
    from printer_slicer.profile import find_profile_paths
    from printer_slicer.profile.finding import read_display_name

    for typed, path in find_profile_paths(kind, folders).items():
        if read_display_name(path) == name:
            return typed
    return ""
