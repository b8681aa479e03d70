"""The manifest of a batch: one line of JSON per task that ended, so that a batch can be continued."""

from __future__ import annotations

import errno
import io
import json
import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from hashlib import file_digest
from pathlib import Path
from typing import Final

from printer_slicer.batching.tasks import BatchResult, SlicedFile
from printer_slicer.errors import OutputError
from printer_slicer.process_lock import ProcessLock
from printer_slicer.saving import save
from printer_slicer.values import as_dict, replace

__all__ = ["MANIFEST", "Manifest", "lock_folder", "read_manifest"]

MANIFEST: Final = "manifest.jsonl"
"""Name of the file in the folder of the G-code."""


@contextmanager
def lock_folder(folder: Path) -> Iterator[None]:
    """Keep other batches from writing into a folder.

    Raises:
        OutputError: another one does, or the folder cannot be written.
    """
    lock = ProcessLock(folder / f".{MANIFEST}.lock")
    try:
        is_free = lock.acquire()
    except OSError as error:
        raise OutputError(
            f"{folder}: cannot be written: {error.strerror or error}", remedy="Choose another folder"
        ) from None
    if not is_free:
        raise OutputError(
            f"{folder}: another batch writes into this folder", remedy="Wait for it, or choose another"
        )
    try:
        yield
    finally:
        lock.release()


class Manifest:
    """A manifest that is written; each line is on the disk before the next task is noted.

    The manifest of an earlier run is replaced at once, so it is never lost.

    Args:
        folder: folder of the G-code, which exists.
        kept: results of an earlier run that are kept.

    Raises:
        OutputError: the file cannot be written.
    """

    def __init__(self, folder: Path, kept: Iterable[BatchResult] = ()) -> None:
        self.path = folder / MANIFEST
        save(self.path, "".join(map(_format_line, kept)).encode())
        with self._explain_errors():
            # Without a buffer, a line that did not fit on the disk is not tried again when the file is closed.
            self._file = self.path.open("ab", buffering=0)
        self._write("")

    def add(self, result: BatchResult) -> None:
        """Write the line of a result.

        Raises:
            OutputError: the disk is full.
        """
        self._write(_format_line(result))

    def _write(self, text: str) -> None:
        """Write text, and wait until it is on the disk; if that fails, close the file."""
        with self._explain_errors():
            try:
                _write_to_disk(self._file, text.encode())
            except OSError:
                self._file.close()
                raise

    @contextmanager
    def _explain_errors(self) -> Iterator[None]:
        """Raise errors of the file system as `OutputError`."""
        try:
            yield
        except OSError as error:
            raise OutputError(
                f"{self.path}: {error.strerror or error}", remedy="Free some space, then resume the batch"
            ) from None

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def _write_to_disk(file: io.FileIO, data: bytes) -> None:
    """Write to a file without a buffer, and wait until it is on the disk.

    Raises:
        OSError: it was not written, or not whole.
    """
    if file.write(data) < len(data):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    os.fsync(file.fileno())


def read_manifest(folder: Path) -> dict[str, BatchResult]:
    """Return the results of the tasks that are done and whose files in the folder are unchanged, by name of the task.

    A line that is damaged, such as one that was cut off when the machine stopped, counts as not done.
    """
    try:
        lines = (folder / MANIFEST).read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return {}
    found = [_parse_line(line) for line in lines]
    return {
        one.task: one
        for one in found
        if one is not None and not one.problem and all(_is_unchanged(folder, file) for file in one.files)
    }


def _format_line(result: BatchResult) -> str:
    """Return the line of a result."""
    plain = as_dict(replace(result, picture=b"", files=()))
    plain["files"] = [as_dict(replace(one, content=b"")) for one in result.files]
    for one in (plain, *plain["files"]):
        one.pop("picture" if one is plain else "content")
    return json.dumps(plain) + "\n"


def _parse_line(line: str) -> BatchResult | None:
    """Return the result in a line; None if the line is damaged."""
    try:
        values = json.loads(line)
        files = tuple(SlicedFile(**one) for one in values.pop("files"))
        return BatchResult(**values | {"warnings": tuple(values["warnings"]), "files": files})
    except (ValueError, TypeError, KeyError, AttributeError):
        return None


def _is_unchanged(folder: Path, file: SlicedFile) -> bool:
    """Return whether a file is in the folder, with the content that was written."""
    try:
        with (folder / Path(file.name).name).open("rb") as opened:
            return file_digest(opened, "sha256").hexdigest() == file.sha256
    except OSError:
        return False
