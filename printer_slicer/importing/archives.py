"""Read texts from files of other slicers, zipped or not: presets, 3MF projects, Cura profiles."""

from __future__ import annotations

import errno
import zipfile
from collections.abc import Set as AbstractSet
from pathlib import Path
from typing import Final

from printer_slicer.errors import ProfileError
from printer_slicer.importing.ini import FILE_REMEDY
from printer_slicer.input_files import read_input

__all__ = ["read_archive", "read_text"]

_LARGEST_FILE: Final = 50_000_000  # bytes; vendors' bundles have a few
_LARGEST: Final = 20_000_000  # bytes of a text in an archive
_MOST: Final = 50  # members of an archive


def read_text(path: Path) -> str:
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
                remedy=FILE_REMEDY,
            ) from None
        raise ProfileError(
            f"{path}: cannot be read: {error.strerror}", remedy="Check its name and permissions"
        ) from None
    if b"\x00" in data[:1000]:
        raise ProfileError(f"{path}: not a text file", remedy=FILE_REMEDY)
    return data.decode("utf-8", "replace")


def read_archive(path: Path, names: AbstractSet[str] | None = None) -> dict[str, str]:
    """Read members of an archive.

    Args:
        path: path of the archive.
        names: names of the members; missing ones are skipped. None: all.

    Returns:
        Name -> text.

    Raises:
        ProfileError: the archive is damaged, or a text is too large.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            there = archive.namelist()[:_MOST] if names is None else sorted(names & set(archive.namelist()))
            return {name: _text(path, archive, name) for name in there}
    except (zipfile.BadZipFile, OSError, EOFError, RuntimeError, NotImplementedError, ValueError) as error:
        raise ProfileError(f"{path}: cannot be unpacked: {error}", remedy="Save the file again") from None


def _text(path: Path, archive: zipfile.ZipFile, name: str) -> str:
    with archive.open(name) as member:
        data = member.read(_LARGEST + 1)  # the size in the archive's directory may be wrong
    if len(data) > _LARGEST:
        raise ProfileError(
            f"{path}: {name}: over {_LARGEST // 1_000_000} MB, too large for a settings file",
            remedy="Save the file again",
        )
    return data.decode("utf-8", "replace")
