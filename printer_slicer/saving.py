"""Write files atomically: either the whole new file, or the old one unchanged."""

from __future__ import annotations

import os
from pathlib import Path
from tempfile import NamedTemporaryFile

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
    with NamedTemporaryFile(dir=path.parent, prefix=".", suffix=".partial", delete=False) as partial:
        try:
            partial.write(data)
            partial.flush()
            # Temporary files are private; give the new file the usual permissions.
            Path(partial.name).chmod(path.stat().st_mode & 0o777 if path.exists() else 0o666 & ~_read_umask())
            Path(partial.name).replace(path)
        except BaseException:
            Path(partial.name).unlink(missing_ok=True)
            raise


def _read_umask() -> int:
    """Return the umask of this process, which can be read only by setting it."""
    mask = os.umask(0)
    os.umask(mask)
    return mask
