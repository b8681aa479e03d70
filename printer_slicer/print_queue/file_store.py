"""Store files by the hash of their content; no name from outside is part of a path."""

from __future__ import annotations

import errno
import hashlib
import os
import secrets
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from shutil import disk_usage
from time import time
from typing import Final, NamedTuple

from printer_slicer.errors import OutputError, UsageError
from printer_slicer.saving import sync_folder

__all__ = ["DEFAULT_MAX_BYTES", "FileStore", "StoredContent", "check_free_space"]

DEFAULT_MAX_BYTES: Final = 512 * 1024 * 1024
"""Largest file, bytes."""

_FREE_BYTES: Final = 32 * 1024 * 1024  # that an upload leaves to the database and to running prints
_STEP: Final = 8 * 1024 * 1024  # bytes between two looks at the free space
_DAY: Final = 86400.0  # s
_ID_LENGTH: Final = 64  # digits of a SHA-256


class StoredContent(NamedTuple):
    """Content that was stored: its SHA-256, hexadecimal, and its size in bytes."""

    id: str
    size: int


class FileStore:
    """Files in `folder`/ab/HASH; content that is stored twice is one file.

    Args:
        folder: folder of the store, which may be missing.
        max_bytes: largest file that is accepted.
    """

    def __init__(self, folder: Path, max_bytes: int = DEFAULT_MAX_BYTES) -> None:
        self._folder, self._incoming, self._max_bytes = folder, folder / "incoming", max_bytes

    def find_path(self, file_id: str) -> Path:
        """Return the path of the content with this id, whether it exists or not.

        Raises:
            UsageError: this cannot be an id.
        """
        if len(file_id) != _ID_LENGTH or not set(file_id) <= set("0123456789abcdef"):
            raise UsageError(
                "a file is named by the 64 hexadecimal digits of its SHA-256", remedy="Add the file again"
            )
        return self._folder / file_id[:2] / file_id

    def add(self, pieces: Iterable[bytes]) -> StoredContent:
        """Store content that arrives in pieces; it is on the disk when this returns.

        Raises:
            UsageError: the content is too large.
            OutputError: it cannot be written.
        """
        try:
            self._incoming.mkdir(parents=True, exist_ok=True, mode=0o700)
            partial = self._incoming / secrets.token_hex(16)
            try:
                stored = self._write(partial, pieces)
                self._move(partial, self.find_path(stored.id))
            except BaseException:
                with suppress(OSError):
                    partial.unlink()
                raise
        except OSError as error:
            raise OutputError(
                f"the file cannot be stored in {self._folder}: {error.strerror or error}",
                remedy="Free some disk space, or check the permissions of this folder",
            ) from None
        return stored

    def contains(self, file_id: str) -> bool:
        """Return whether content with this id is stored.

        Raises:
            UsageError: this cannot be an id.
        """
        return self.find_path(file_id).is_file()

    def delete(self, file_id: str) -> None:
        """Delete content, if it is stored.

        Raises:
            UsageError: this cannot be an id.
            OutputError: it cannot be deleted.
        """
        try:
            self.find_path(file_id).unlink(missing_ok=True)
        except OSError as error:
            raise OutputError(
                f"the file cannot be deleted: {error.strerror or error}",
                remedy=f"Check the permissions of {self._folder}",
            ) from None

    def delete_interrupted_uploads(self) -> None:
        """Delete what interrupted uploads have left a day ago or earlier."""
        for path in self._incoming.glob("*"):
            with suppress(OSError):
                if path.stat().st_mtime < time() - _DAY:
                    path.unlink()

    def _write(self, partial: Path, pieces: Iterable[bytes]) -> StoredContent:
        """Write pieces to a new file, and hash them on the way."""
        flags = (
            os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_BINARY", 0)
        )
        digest, size, looked = hashlib.sha256(), 0, -_STEP
        with os.fdopen(os.open(partial, flags, 0o600), "wb") as file:
            for piece in pieces:
                size += len(piece)
                if size > self._max_bytes:
                    raise UsageError(
                        f"the file is larger than {self._max_bytes / 1e6:.3g} MB",
                        remedy="Slice it with fewer details, or split it",
                    )
                if size - looked >= _STEP:
                    looked = size
                    check_free_space(self._folder)
                digest.update(piece)
                file.write(piece)
            file.flush()
            os.fsync(file.fileno())
        return StoredContent(digest.hexdigest(), size)

    def _move(self, partial: Path, target: Path) -> None:
        """Give a complete file its final name."""
        target.parent.mkdir(exist_ok=True, mode=0o700)
        partial.replace(target)
        sync_folder(target.parent)


def check_free_space(folder: Path) -> None:
    """Check that a full disk will not stop the queue and the prints that write to it.

    Raises:
        OSError: too little is free.
    """
    if disk_usage(folder).free < _FREE_BYTES:
        raise OSError(errno.ENOSPC, f"less than {_FREE_BYTES >> 20} MB are free")
