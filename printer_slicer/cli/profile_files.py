"""Profiles that are written: where they go, the folders that they need, and the schemas beside them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from printer_slicer.cli.common import write_file
from printer_slicer.errors import UsageError
from printer_slicer.saving import make_folder

__all__ = ["kept_schemas", "make_folder", "own_folder", "write_schemas"]


def own_folder(named: Sequence[Path], what: str, remedy: str) -> Path:
    """The folder that a person's new profiles go to: the first that was named, or their own.

    Args:
        named: folders that were typed.
        what: is to be done, for the message.
        remedy: for it.

    Raises:
        UsageError: there is none.
    """
    from printer_slicer.profile.folders import own_folders

    folders = [*named, *own_folders()]
    if not folders:
        raise UsageError(f"{what}: there is no folder of your own", remedy=remedy)
    return folders[0]


def write_schemas(folder: Path) -> list[Path]:
    """The schemas of all kinds as files of a folder, which is made; their paths.

    Raises:
        OutputError: the folder cannot be made, or not be written to.
    """
    from printer_slicer.profile import KINDS
    from printer_slicer.profile.schema import schema_name, schema_text

    make_folder(folder)
    paths = [folder / schema_name(kind) for kind in KINDS]
    for kind, path in zip(KINDS, paths, strict=True):
        write_file(path, schema_text(kind).encode())
    return paths


def kept_schemas(root: Path | None) -> Path | None:
    """Where files of profiles find their schemas: None: beside the folders of profiles, where they are written now.

    Args:
        root: the folder of a person's own profiles; None: the files go anywhere, and find those that are shipped.
    """
    from printer_slicer.profile.folders import SCHEMAS, profile_root

    if root is None:
        return profile_root() / SCHEMAS
    write_schemas(root / SCHEMAS)
    return None
