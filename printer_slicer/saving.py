"""Write files atomically: either the whole new file, or the old one unchanged."""

from __future__ import annotations

import os
from pathlib import Path

from printer_slicer.errors import OutputError

__all__ = ["check_writable", "make_folder", "save"]


def check_writable(path: Path) -> None:
    """Check, before long work starts, that a file can be written to a path.

    Raises:
        OutputError: the path is a folder, or its folder is missing.
    """
    if path.is_dir():
        raise OutputError(f"{path}: is a folder", remedy="Name a file in this folder")
    if not path.parent.is_dir():
        raise OutputError(
            f"{path}: the folder {path.parent} does not exist", remedy=f"Create it: mkdir -p {path.parent}"
        )


def make_folder(path: Path) -> None:
    """Create a folder and its parents if they are missing.

    Raises:
        OutputError: the folder cannot be created, or a file with that name exists.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise OutputError(
            f"{path}: the folder cannot be created: {reason}", remedy="Check the name and the permissions"
        ) from None


def save(path: Path, data: bytes) -> None:
    """Write a file atomically; a symbolic link is kept, and the file that it points to is written.

    Raises:
        OutputError: the folder is missing, the disk is full, or permission is denied.
    """
    try:
        check_writable(path)
        _replace_file(path.resolve(), data)
    except (OSError, ValueError, RuntimeError) as error:
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise OutputError(
            f"{path}: cannot be written: {reason}",
            remedy="Check the name, the free space and the permissions, or choose another file with -o",
        ) from None


def _replace_file(path: Path, data: bytes) -> None:
    """Write a temporary file in the folder of the target, then replace the target by it."""
    if path.exists() and not path.is_file():  # a device or a pipe cannot be replaced
        path.write_bytes(data)
        return
    mode = path.stat().st_mode & 0o777 if path.exists() else 0o666 & ~_read_umask()
    # Not by `tempfile`, whose import takes as long as slicing some layers.
    partial = path.parent / f".{os.urandom(8).hex()}.partial"
    with open(partial, "xb", opener=_open_private) as file:
        try:
            file.write(data)
            file.flush()
            partial.chmod(mode)
            partial.replace(path)
        except BaseException:
            partial.unlink(missing_ok=True)
            raise


def _open_private(path: str, flags: int) -> int:
    """Open a new file that only its owner can read and write."""
    return os.open(path, flags, 0o600)


def _read_umask() -> int:
    """Return the umask of this process, which can be read only by setting it."""
    mask = os.umask(0)
    os.umask(mask)
    return mask
