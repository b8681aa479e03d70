"""Open model files and read them as bytes, in blocks or whole."""

from __future__ import annotations

import codecs
import os
import stat
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from io import BufferedRandom, BufferedReader
from typing import TYPE_CHECKING, Final

from printer_slicer.errors import MeshError, UsageError
from printer_slicer.input_files import open_input

if TYPE_CHECKING:
    from pathlib import Path

    from printer_slicer.mesh_io.limits import Limits

__all__ = ["CHUNK", "ModelFile", "Progress", "open_model_file", "strip_byte_order_mark"]

Progress = Callable[[float], None]
"""Receives the fraction of the file read so far, 0 to 1."""

CHUNK: Final = 1 << 20
"""Bytes read at a time."""
PROGRESS_BYTES: Final = 1 << 23
"""Minimum file size for which progress is reported, bytes."""

UTF_16: Final = {codecs.BOM_UTF16_LE: "utf-16-le", codecs.BOM_UTF16_BE: "utf-16-be"}
"""Byte order mark -> encoding."""


class ModelFile:
    """An open file of known length.

    Attributes:
        path: for messages.
        size: bytes.
        head: the first 64 KiB.
    """

    def __init__(self, path: Path, file: BufferedReader | BufferedRandom, progress: Progress) -> None:
        self.path = path
        self.file = file
        self.size = os.fstat(file.fileno()).st_size
        self.head = file.read(1 << 16)
        self._progress = progress

    def read_all(self, limit: int) -> bytes:
        """Return the whole content.

        Raises:
            MeshError: it is longer than `limit`, bytes.
        """
        if self.size > limit:
            raise _length_error(self.path, self.size, limit)
        self.file.seek(0)
        return self.file.read(limit + 1)

    def read_chunks(self) -> Iterator[bytes]:
        """Yield the content in chunks."""
        self.file.seek(0)
        done = 0
        while chunk := self.file.read(CHUNK):
            yield chunk
            done += len(chunk)
            self.report_progress(done / max(self.size, done))

    def read_text_chunks(self) -> Iterator[bytes]:
        """Yield the content in chunks of UTF-8 without a byte order mark; all line endings become LF."""
        coding = next((name for mark, name in UTF_16.items() if self.head.startswith(mark)), "")
        decoder = codecs.getincrementaldecoder(coding)("replace") if coding else None
        old_lines = b"\r" in self.head and b"\n" not in self.head
        for number, raw in enumerate(self.read_chunks()):
            chunk = decoder.decode(raw).encode("utf-8", "replace") if decoder else raw
            if number == 0:
                chunk = chunk.removeprefix(codecs.BOM_UTF8)
            yield chunk.replace(b"\r", b"\n") if old_lines else chunk

    def report_progress(self, share: float) -> None:
        """Report the fraction read so far; small files report nothing."""
        if self.size > PROGRESS_BYTES:
            self._progress(share)


def _length_error(path: Path, size: int, limit: int) -> MeshError:
    """Return the error for a file that is too long."""
    return MeshError(
        f"{path}: the file has {size} bytes; the limit for this format is {limit}",
        remedy="Export the part with fewer facets, or as binary STL",
    )


def _open_file(path: Path, limits: Limits) -> BufferedReader:
    """Open a file at its first byte.

    Raises:
        UsageError: the file cannot be opened.
    """
    try:
        return open_input(path, limits.pipe_seconds)
    except FileNotFoundError as error:
        remedy = "Use /dev/stdin to read from a pipe" if str(path) == "-" else "Check the name and the folder"
        raise UsageError(f"{path}: no such file", remedy=remedy) from error
    except IsADirectoryError as error:
        raise UsageError(
            f"{path}: is a folder, not a file", remedy="Give the path of a file in it"
        ) from error
    except PermissionError as error:
        raise UsageError(f"{path}: permission denied", remedy="Check its permissions") from error
    except TimeoutError as error:
        raise UsageError(
            f"{path}: {error.strerror}", remedy="Start the program that writes to it first"
        ) from error
    except OSError as error:
        raise UsageError(f"{path}: cannot be read: {error.strerror}", remedy="Check the path") from error
    except ValueError as error:  # the name contains a zero byte
        raise UsageError(f"{str(path)!r}: not a valid file name", remedy="Check the name") from error


@contextmanager
def open_model_file(path: Path, limits: Limits, progress: Progress) -> Iterator[ModelFile]:
    """Open a model file.

    Raises:
        UsageError: the file cannot be read.
        MeshError: the file is empty or too long.
    """
    file = _open_file(path, limits)
    with file, ExitStack() as stack:
        try:
            if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
                from tempfile import TemporaryFile  # noqa: PLC0415 - slow, and only needed for pipes

                spool = stack.enter_context(TemporaryFile())
                source = ModelFile(path, _spool_pipe(file, spool, path, limits), progress)
            else:
                source = ModelFile(path, file, progress)
            if not source.head:
                raise MeshError(
                    f"{path}: the file is empty",
                    remedy="Copy or download the file again; if that does not help, export the part again",
                )
            if source.size > limits.file_bytes:
                raise _length_error(path, source.size, limits.file_bytes)
            yield source
        except OSError as error:
            raise UsageError(f"{path}: cannot be read: {error.strerror}", remedy="Check the disk") from error


def _spool_pipe(pipe: BufferedReader, spool: BufferedRandom, path: Path, limits: Limits) -> BufferedRandom:
    """Copy a pipe to a temporary file, which has a length and can be read twice."""
    length = 0
    while chunk := pipe.read(CHUNK):
        length += len(chunk)
        if length > limits.file_bytes:
            raise _length_error(path, length, limits.file_bytes)
        spool.write(chunk)
    spool.seek(0)
    return spool


def strip_byte_order_mark(data: bytes) -> bytes:
    """Return UTF-8 text without its byte order mark."""
    for mark, name in UTF_16.items():
        if data.startswith(mark):
            return data[len(mark) :].decode(name, "replace").encode("utf-8", "replace")
    return data.removeprefix(codecs.BOM_UTF8)
