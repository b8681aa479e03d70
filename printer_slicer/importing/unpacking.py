"""Texts in ZIP archives of other slicers: 3MF projects, profiles of Cura."""

from __future__ import annotations

import zipfile
from collections.abc import Set as AbstractSet
from pathlib import Path
from typing import Final

from printer_slicer.errors import ProfileError

__all__ = ["unpacked"]

_LARGEST: Final = 20_000_000  # bytes of a text
_MOST: Final = 50  # of them


def unpacked(path: Path, names: AbstractSet[str] | None = None) -> dict[str, str]:
    """Name -> text of members of an archive.

    Args:
        path: of the archive.
        names: which; those that are not there are left out. None: all.

    Raises:
        ProfileError: it is damaged, or a text is far too large.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            there = archive.namelist()[:_MOST] if names is None else sorted(names & set(archive.namelist()))
            return {name: _text(path, archive, name) for name in there}
    except (zipfile.BadZipFile, OSError, EOFError, RuntimeError, NotImplementedError, ValueError) as error:
        raise ProfileError(f"{path}: cannot be unpacked: {error}", remedy="save the file again") from None


def _text(path: Path, archive: zipfile.ZipFile, name: str) -> str:
    with archive.open(name) as member:
        data = member.read(_LARGEST + 1)  # whatever its directory says
    if len(data) > _LARGEST:
        raise ProfileError(
            f"{path}: {name}: over {_LARGEST // 1_000_000} MB, more than any file of settings",
            remedy="save the file again",
        )
    return data.decode("utf-8", "replace")
