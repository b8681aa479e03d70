"""Find profiles in named folders, in the user's folders and among the shipped profiles, in this order.

Each folder contains `printers/NAME.toml`, `materials/NAME.toml` and `qualities/NAME.toml`. The user's folder is the
platform's configuration folder. The environment variable PRINTER_SLICER_PROFILES replaces it with other folders,
separated as in PATH; an empty value means none.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

__all__ = [
    "FOLDERS",
    "SCHEMAS",
    "VARIABLE",
    "find_profile_paths",
    "find_shipped_profiles",
    "find_user_folders",
    "list_search_folders",
]

FOLDERS: Final[Mapping[str, str]] = {"printer": "printers", "material": "materials", "quality": "qualities"}
SCHEMAS: Final = "schema"
VARIABLE: Final = "PRINTER_SLICER_PROFILES"


def find_shipped_profiles() -> Path:
    """Return the folder of the shipped profiles: beside the package in a checkout, inside it when installed."""
    package = Path(__file__).resolve().parent.parent
    beside = package.parent / "profiles"
    return (
        beside if (package.parent / "pyproject.toml").is_file() and beside.is_dir() else package / "profiles"
    )


def find_user_folders() -> list[Path]:
    """Return the user's folders, which may be missing; new profiles are stored in the first one."""
    given = os.environ.get(VARIABLE)
    if given is not None:
        return [Path(folder) for folder in given.split(os.pathsep) if folder]
    return [_find_user_folder()]


def _find_user_folder() -> Path:
    """Return the platform's configuration folder for this program."""
    configured = os.environ.get("XDG_CONFIG_HOME", "")
    home = os.environ.get("HOME", "")
    if (
        sys.platform == "linux"
        and not configured
        and Path(home).is_absolute()
        and "ANDROID_ROOT" not in os.environ
    ):
        # The usual case on Linux: the same folder without importing platformdirs and the eight modules that it uses.
        return Path(home, ".config", "printer_slicer")
    from platformdirs import user_config_path  # noqa: PLC0415 - slow, and not needed in the usual case

    return user_config_path("printer_slicer", appauthor=False)


def list_search_folders(folders: Sequence[Path] = ()) -> list[Path]:
    """Return all folders in search order, starting with the given ones."""
    return [*folders, *find_user_folders(), find_shipped_profiles()]


def find_profile_paths(kind: str, folders: Sequence[Path] = ()) -> dict[str, Path]:
    """Return the profiles of one kind (`printer`, `material`, `quality`): name -> file, sorted by name.

    `folders` are searched before the user's folders and the shipped profiles.
    """
    found: dict[str, Path] = {}
    for folder in reversed(list_search_folders(folders)):
        found |= {path.stem: path for path in (folder / FOLDERS[kind]).glob("*.toml") if path.is_file()}
    return dict(sorted(found.items()))
