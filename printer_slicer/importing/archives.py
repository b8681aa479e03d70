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

_LARGEST_FILE: Final = 50_000_000  # bytes; vendors' bundles have a few million
_LARGEST_MEMBER: Final = 20_000_000  # bytes of one text in an archive
_MAX_MEMBERS: Final = 50  # texts that are read from an archive


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
    """Read texts from a ZIP archive.

    Args:
        path: path of the archive.
        names: names of the texts; missing ones are skipped. None: all texts.

    Returns:
        Name -> text.

    Raises:
        ProfileError: the archive is damaged, or a text is too large.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            present = (
                archive.namelist()[:_MAX_MEMBERS]
                if names is None
                else sorted(names & set(archive.namelist()))
            )
            return {name: _read_member(path, archive, name) for name in present}
    except (zipfile.BadZipFile, OSError, EOFError, RuntimeError, NotImplementedError, ValueError) as error:
        raise ProfileError(f"{path}: cannot be unpacked: {error}", remedy="Save the file again") from None


def _read_member(path: Path, archive: zipfile.ZipFile, name: str) -> str:
    """Read one text from an archive."""
    with archive.open(name) as member:
        data = member.read(_LARGEST_MEMBER + 1)  # the size in the archive's directory may be wrong
    if len(data) > _LARGEST_MEMBER:
        raise ProfileError(
            f"{path}: {name}: over {_LARGEST_MEMBER // 1_000_000} MB, too large for a settings file",
            remedy="Save the file again",
        )
    return data.decode("utf-8", "replace")
