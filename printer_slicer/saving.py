"""Write files atomically: either the whole new file, or the old one unchanged."""

from __future__ import annotations

import errno
import io
import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from printer_slicer.errors import OutputError

__all__ = ["check_writable", "make_folder", "save", "sync_folder"]


def sync_folder(folder: Path) -> None:
    """Write the names of the files in a folder to the disk, so that they survive a power cut; where systems can.

    Raises:
        OSError: the folder cannot be opened or written.
    """
    if os.name != "posix":
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


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


def save(path: Path, data: bytes | Iterable[bytes]) -> None:
    """Write a file atomically; a symbolic link is kept, and the file that it points to is written.

    Args:
        path: the file.
        data: its content, or pieces of it that are written as they are made.

    Raises:
        OutputError: the folder is missing, the disk is full, or permission is denied.
    """
    with _explain_errors(path):
        check_writable(path)
        target = path.resolve()
        is_replaceable = target.is_file() or not target.exists()  # a device or a pipe cannot be replaced
    pieces = [data] if isinstance(data, bytes) else data
    if is_replaceable:
        _replace_file(path, target, pieces)
        return
    with _explain_errors(path):
        file = target.open("wb", buffering=0)
    with file:
        _write_pieces(path, file, pieces)


@contextmanager
def _explain_errors(path: Path) -> Iterator[None]:
    """Raise errors of the file system as `OutputError`."""
    try:
        yield
    except (OSError, ValueError, RuntimeError) as error:
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise OutputError(
            f"{path}: cannot be written: {reason}",
            remedy="Check the name, the free space and the permissions, or choose another file",
        ) from None


def _write_pieces(path: Path, file: io.FileIO, pieces: Iterable[bytes]) -> None:
    """Write pieces as they are made; errors in making them are not errors of the file `path`."""
    for piece in pieces:
        left = memoryview(piece)
        with _explain_errors(path):
            while left:
                if (count := file.write(left)) is None:
                    raise BlockingIOError(errno.EAGAIN, os.strerror(errno.EAGAIN))
                left = left[count:]


def _replace_file(path: Path, target: Path, pieces: Iterable[bytes]) -> None:
    """Write a temporary file in the folder of the target, then replace the target by it; `path` is for messages."""
    # Not by `tempfile`, whose import takes as long as slicing some layers.
    partial = target.parent / f".{os.urandom(8).hex()}.partial"
    with _explain_errors(path):
        mode = target.stat().st_mode & 0o777 if target.exists() else 0o666 & ~_read_umask()
        file = open(partial, "xb", buffering=0, opener=_open_private)  # noqa: SIM115 - closed below
    with file:
        try:
            _write_pieces(path, file, pieces)
            with _explain_errors(path):
                partial.chmod(mode)
                partial.replace(target)
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
