"""Unpack members of untrusted ZIP archives, block by block and within limits."""

from __future__ import annotations

import struct
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Final

from printer_slicer.errors import MeshError
from printer_slicer.mesh_io.soundness import COPY_AGAIN, EXPORT_AGAIN

if TYPE_CHECKING:
    from printer_slicer.mesh_io.files import ModelFile
    from printer_slicer.mesh_io.limits import Limits

__all__ = ["Archive", "open_archive"]

CHUNK_BYTES: Final = 1 << 20
"""Bytes unpacked at a time."""
DIRECTORY_ENTRY_BYTES: Final = 46
"""Minimum length of an entry in the directory of an archive, bytes."""
LONGEST_ENTRY_TEXT: Final = 1024
"""Maximum average length of the name, extra fields and comment of a directory entry, bytes."""
END_RECORD_BYTES: Final = 22
"""Length of the record at the end of an archive without its comment, bytes."""


class Archive:
    """The members of a ZIP archive; names ignore case and a leading slash."""

    def __init__(self, source: ModelFile, limits: Limits) -> None:
        self.path = source.path
        self._limits = limits
        self._source = source
        self._expanded = 0
        _check_directory(source, limits)
        self._zip = zipfile.ZipFile(source.file)
        self._members = {_normalize_name(info.filename): info for info in self._zip.infolist()}

    @property
    def names(self) -> list[str]:
        """Return the names of the members in lower case."""
        return list(self._members)

    def __contains__(self, name: str) -> bool:
        return _normalize_name(name) in self._members

    def read_chunks(self, name: str) -> Iterator[bytes]:
        """Yield the content of a member in chunks.

        Raises:
            MeshError: the member does not exist, or unpacking it would exceed a limit.
        """
        info = self._members.get(_normalize_name(name))
        if info is None:
            raise MeshError(f"{self.path}: the archive does not contain '{name[:200]}'", remedy=EXPORT_AGAIN)
        self._check_member(info)
        with self._zip.open(info) as file:
            while piece := file.read(CHUNK_BYTES):
                self._expanded += len(piece)
                if self._expanded > self._limits.expanded_bytes:  # the directory may understate the size
                    raise self._expansion_error(
                        f"the archive unpacks to more than {self._limits.expanded_bytes} bytes, the limit"
                    )
                yield piece
                self._source.report_progress(min(file.tell() / max(info.file_size, 1), 1.0))

    def _check_member(self, info: zipfile.ZipInfo) -> None:
        """Reject a member that is encrypted, too large, or compressed with an unsupported method."""
        if info.flag_bits & 1:
            raise MeshError(
                f"{self.path}: the archive is encrypted", remedy="Export the part again without a password"
            )
        if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
            raise MeshError(
                f"{self.path}: a file in the archive is compressed with a method that 3MF does not allow"
                f" ({info.compress_type})",
                remedy="Pack it again as an ordinary ZIP archive",
            )
        if self._expanded + info.file_size > self._limits.expanded_bytes:
            raise self._expansion_error(
                f"the archive unpacks to {self._expanded + info.file_size} bytes; the limit is"
                f" {self._limits.expanded_bytes}"
            )
        if info.file_size > max(CHUNK_BYTES, self._limits.expansion * info.compress_size):
            raise self._expansion_error(
                f"a file in the archive unpacks from {info.compress_size} to {info.file_size} bytes; at most"
                f" {self._limits.expansion:g} times the packed size is allowed"
            )

    def _expansion_error(self, what: str) -> MeshError:
        """Return the error for an archive that unpacks to too many bytes."""
        return MeshError(
            f"{self.path}: {what}",
            remedy="Do not trust the file; if it is your own, export it as binary STL",
        )


def _normalize_name(name: str) -> str:
    return name.replace("\\", "/").lstrip("/").lower()


def _check_directory(source: ModelFile, limits: Limits) -> None:
    """Reject an archive whose directory is too long, according to the record at the end of the file."""
    source.file.seek(max(0, source.size - (1 << 16) - END_RECORD_BYTES))
    end = source.file.read()
    at = end.rfind(b"PK\5\6")
    if at < 0 or len(end) < at + END_RECORD_BYTES:
        raise MeshError(f"{source.path}: not a valid ZIP archive: it has no directory", remedy=COPY_AGAIN)
    (length,) = struct.unpack_from("<L", end, at + 12)
    large = end.rfind(b"PK\6\6", 0, at)
    if length == 0xFFFFFFFF and large >= 0 and len(end) >= large + 48:
        (length,) = struct.unpack_from("<Q", end, large + 40)
    limit = limits.members * (DIRECTORY_ENTRY_BYTES + LONGEST_ENTRY_TEXT)
    if length > min(limit, source.size):
        raise MeshError(
            f"{source.path}: the directory of the archive has {length} bytes; the limit is {limit}",
            remedy=COPY_AGAIN,
        )


@contextmanager
def open_archive(source: ModelFile, limits: Limits) -> Iterator[Archive]:
    """Open the archive in a file.

    Raises:
        MeshError: the archive is not valid or has too many members.
    """
    try:
        archive = Archive(source, limits)
        if len(archive.names) > limits.members:
            raise MeshError(
                f"{source.path}: {len(archive.names)} files in the archive; the limit is {limits.members}",
                remedy="Do not trust the file; if it is your own, export it as binary STL",
            )
        yield archive
    except (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError, ValueError) as error:
        reason = str(error).partition("\n")[0][:200] or type(error).__name__
        raise MeshError(f"{source.path}: not a valid ZIP archive: {reason}", remedy=COPY_AGAIN) from error
