"""Files are written whole, or what was there before stays untouched."""

from __future__ import annotations

import os
from pathlib import Path
from tempfile import NamedTemporaryFile

from printer_slicer.errors import OutputError

__all__ = ["check_writable", "make_folder", "save"]


def check_writable(path: Path) -> None:
    """Refuse an output for which there is no place, before long work begins.

    Raises:
        OutputError: it is a folder, or its folder is missing.
    """
    if path.is_dir():
        raise OutputError(f"{path}: is a folder", remedy="name a file in it")
    if not path.parent.is_dir():
        raise OutputError(
            f"{path}: the folder {path.parent} does not exist", remedy=f"mkdir -p {path.parent}"
        )


def make_folder(path: Path) -> None:
    """Create a folder and its parents if they are missing.

    Raises:
        OutputError: it cannot be created, or a file has its name.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise OutputError(
            f"{path}: the folder cannot be created: {reason}", remedy="check name and permissions"
        ) from None


def save(path: Path, data: bytes) -> None:
    """Write a whole file, or leave what was there before untouched; links stay links.

    Raises:
        OutputError: the folder is missing, the disk full, or writing not allowed.
    """
    try:
        check_writable(path)
        _write(path.resolve(), data)
    except (OSError, ValueError, RuntimeError) as error:
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise OutputError(
            f"{path}: cannot be written: {reason}", remedy="check name, free space and permissions, or use -o"
        ) from None


def _write(path: Path, data: bytes) -> None:
    """Write beside the file first: what stands there is good until the new one is whole."""
    if path.exists() and not path.is_file():  # a device or a pipe: there is nothing to keep
        path.write_bytes(data)
        return
    with NamedTemporaryFile(dir=path.parent, prefix=".", suffix=".partial", delete=False) as partial:
        try:
            partial.write(data)
            partial.flush()
            # Temporary files are private; this one becomes what the person asked for, with the usual permissions.
            Path(partial.name).chmod(path.stat().st_mode & 0o777 if path.exists() else 0o666 & ~_umask())
            Path(partial.name).replace(path)
        except BaseException:
            Path(partial.name).unlink(missing_ok=True)
            raise


def _umask() -> int:
    """The permissions that this process takes away from new files; asking means setting."""
    mask = os.umask(0)
    os.umask(mask)
    return mask
