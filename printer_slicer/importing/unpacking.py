"""Read texts from files of other slicers, zipped or not: presets, 3MF projects, Cura profiles."""

from __future__ import annotations

import errno
import zipfile
from collections.abc import Set as AbstractSet
from pathlib import Path
from typing import Final

from printer_slicer.errors import ProfileError
from printer_slicer.importing.ini import GIVE
from printer_slicer.input_files import read_input

__all__ = ["text_of", "unpacked"]

_LARGEST_FILE: Final = 50_000_000  # bytes; vendors' bundles have a few
_LARGEST: Final = 20_000_000  # bytes of a text in an archive
_MOST: Final = 50  # of them


def text_of(path: Path) -> str:
    """Read the text of a file.

    Raises:
        ProfileError: it cannot be read, is not text, or is too large.
    """
    try:
        data = read_input(path, _LARGEST_FILE)
    except OSError as error:
        if error.errno == errno.EFBIG:
            raise ProfileError(
                f"{path}: over {_LARGEST_FILE // 1_000_000} MB, too large for a settings file",
                remedy=GIVE,
            ) from None
        raise ProfileError(
            f"{path}: cannot be read: {error.strerror}", remedy="check name and permissions"
        ) from None
    if b"\x00" in data[:1000]:
        raise ProfileError(f"{path}: no text", remedy=GIVE)
    return data.decode("utf-8", "replace")


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
            f"{path}: {name}: over {_LARGEST // 1_000_000} MB, too large for a settings file",
            remedy="save the file again",
        )
    return data.decode("utf-8", "replace")
