"""The manifest of a batch: one line of JSON per task that ended, so that a batch can be continued."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable
from hashlib import file_digest
from pathlib import Path
from typing import Final

from printer_slicer.batching.tasks import BatchResult, SlicedFile
from printer_slicer.errors import OutputError
from printer_slicer.values import as_dict, replace

__all__ = ["MANIFEST", "Manifest", "read_manifest"]

MANIFEST: Final = "manifest.jsonl"
"""Name of the file in the folder of the G-code."""


class Manifest:
    """A manifest that is written; each line is on the disk before the next task is noted.

    Args:
        folder: folder of the G-code, which exists.
        kept: results of an earlier run that are kept.

    Raises:
        OutputError: the file cannot be written.
    """

    def __init__(self, folder: Path, kept: Iterable[BatchResult] = ()) -> None:
        self.path = folder / MANIFEST
        try:
            self._file = self.path.open("w", encoding="utf-8")
        except OSError as error:
            raise OutputError(
                f"{self.path}: {error.strerror or error}", remedy="Choose another folder"
            ) from None
        for result in kept:
            self.add(result)

    def add(self, result: BatchResult) -> None:
        """Write the line of a result.

        Raises:
            OutputError: the disk is full.
        """
        plain = as_dict(replace(result, picture=b"", files=()))
        plain["files"] = [as_dict(replace(one, content=b"")) for one in result.files]
        for one in (plain, *plain["files"]):
            one.pop("picture" if one is plain else "content")
        try:
            self._file.write(json.dumps(plain) + "\n")
            self._file.flush()
            os.fsync(self._file.fileno())
        except OSError as error:
            raise OutputError(f"{self.path}: {error.strerror or error}", remedy="Free some space") from None

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def read_manifest(folder: Path) -> dict[str, BatchResult]:
    """Return key -> result of the tasks that are done, and whose files are unchanged in the folder.

    A line that is damaged, such as one that was cut off when the machine stopped, counts as not done.
    """
    try:
        lines = (folder / MANIFEST).read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return {}
    found = [_parse_line(line) for line in lines]
    return {
        one.key: one
        for one in found
        if one is not None and not one.problem and all(_is_unchanged(folder, file) for file in one.files)
    }


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
