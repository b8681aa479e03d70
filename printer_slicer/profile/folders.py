"""Where profiles lie: folders that are named, the person's own, those that are shipped; the first that has a name wins.

Each folder holds `printers/NAME.toml`, `materials/NAME.toml` and `qualities/NAME.toml`. The person's own folder is the
platform's one for configuration; the environment variable PRINTER_SLICER_PROFILES puts others in its place, separated
as in PATH, and none where it is empty.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

__all__ = [
    "FOLDERS",
    "SCHEMAS",
    "VARIABLE",
    "own_folders",
    "profile_paths",
    "profile_root",
    "searched",
]

FOLDERS: Final[Mapping[str, str]] = {"printer": "printers", "material": "materials", "quality": "qualities"}
SCHEMAS: Final = "schema"
VARIABLE: Final = "PRINTER_SLICER_PROFILES"


def profile_root() -> Path:
    """The folder of the shipped profiles: beside the package in a checkout, inside it when installed."""
    package = Path(__file__).resolve().parent.parent
    beside = package.parent / "profiles"
    return (
        beside if (package.parent / "pyproject.toml").is_file() and beside.is_dir() else package / "profiles"
    )


def own_folders() -> list[Path]:
    """The folders of this person, which need not exist; the first is the one that new profiles are put into."""
    given = os.environ.get(VARIABLE)
    if given is not None:
        return [Path(folder) for folder in given.split(os.pathsep) if folder]
    from platformdirs import user_config_path  # noqa: PLC0415 - slow, and not needed where the variable is set

    return [user_config_path("printer_slicer", appauthor=False)]


def searched(folders: Sequence[Path] = ()) -> list[Path]:
    """All folders in the order in which a name is looked for, those named first."""
    return [*folders, *own_folders(), profile_root()]


def profile_paths(kind: str, folders: Sequence[Path] = ()) -> dict[str, Path]:
    """The profiles of one kind (`printer`, `material`, `quality`): name -> file, by name.

    `folders` are looked into before the person's own and the shipped ones.
    """
    found: dict[str, Path] = {}
    for folder in reversed(searched(folders)):
        found |= {path.stem: path for path in (folder / FOLDERS[kind]).glob("*.toml") if path.is_file()}
    return dict(sorted(found.items()))
