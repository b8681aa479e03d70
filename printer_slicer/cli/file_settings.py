"""Read settings from the files of --load."""

from __future__ import annotations

import argparse
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from printer_slicer.errors import ProfileError, UsageError
from printer_slicer.profile.files import FileSettings

__all__ = ["name_settings", "read_loaded_files"]


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


def name_settings(kind: str, values: Mapping[str, Any], folders: Sequence[Path] = ()) -> str:
    """Return the name of the profile that has exactly these settings; if there is none, their display name."""
    from printer_slicer.profile.finding import find_profile_by_display_name
    from printer_slicer.profile.inspection import has_settings

    display_name = str(values.get("name", ""))
    profile = find_profile_by_display_name(kind, display_name, folders)
    return profile if profile and has_settings(kind, profile, values, folders) else display_name
