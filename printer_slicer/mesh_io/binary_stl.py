"""Read and write binary STL files."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from printer_slicer.arguments import PATH, check_arguments
from printer_slicer.errors import MeshError, OutputError
from printer_slicer.mesh_io.limits import check_facets
from printer_slicer.mesh_io.soundness import BLOCK, COPY_AGAIN, EXPORT_AGAIN, LARGEST, facet_blocks
from printer_slicer.model import Mesh

if TYPE_CHECKING:
    import os

    from printer_slicer.arrays import Float
    from printer_slicer.mesh_io.files import ModelFile
    from printer_slicer.mesh_io.limits import Limits

__all__ = ["export_stl", "has_binary_stl_size", "read_binary_stl"]

FACET: Final = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
HEADER_SIZE: Final = 84
"""Length of the header, bytes: 80 bytes of any content and the number of facets."""

PRINTABLE: Final = bytes(range(32, 127)) + b"\t\r\n"
SMALLEST_FACET: Final = 1e-6
"""Minimum size of a facet, mm; text that is read as floats gives smaller ones."""

UNKNOWN_COUNTS: Final = (0, 0xFFFFFFFF)
"""Numbers of facets in headers of programs that did not know the number when they wrote the header."""


def has_binary_stl_size(source: ModelFile) -> bool:
    """Return whether a file is a binary STL whose length matches its header.

    The word `solid` at the start proves nothing: binary files may start with it too.
    """
    return source.size >= HEADER_SIZE and source.size == HEADER_SIZE + FACET.itemsize * _read_facet_count(
        source
    )


def _read_facet_count(source: ModelFile) -> int:
    """Read the number of facets from the header."""
    return int.from_bytes(source.head[HEADER_SIZE - 4 : HEADER_SIZE], "little")


def read_binary_stl(source: ModelFile, limits: Limits) -> tuple[Float, list[str]]:
    """Return the corners (F, 3, 3) of a binary STL, and warnings.

    Data after the last facet is allowed if it holds no facets: zeros, printable text, or mostly numbers that are not
    coordinates. A header without a facet count (0 or all ones) is allowed if only complete facets follow.

    Raises:
        MeshError: the number of facets does not match the header, or the file is not an STL.
    """
    path, head = source.path, source.head
    if source.size < HEADER_SIZE or (head.isascii() and b"\0" not in head):
        raise MeshError(f"{path}: not an STL file", remedy=EXPORT_AGAIN)
    n_announced = _read_facet_count(source)
    n_present, rest = divmod(source.size - HEADER_SIZE, FACET.itemsize)
    notes = []
    if n_announced in UNKNOWN_COUNTS and n_present and rest == 0 and not _ends_with_padding(source):
        notes.append(f"the header does not state the number of facets; all {n_present} in the file are read")
        n_announced = n_present
    tail = source.size - HEADER_SIZE - n_announced * FACET.itemsize
    has_more = tail >= FACET.itemsize and not _has_only_zeros(source, tail)
    if tail < 0 or (has_more and _may_hold_facets(source, tail)):
        raise MeshError(
            f"{path}: the header states {n_announced} facets, but the file contains {n_present}",
            remedy=COPY_AGAIN,
        )
    if has_more:
        notes.append(f"{tail} bytes after the last facet are not facets and are left out")
    check_facets(n_announced, path, limits)
    return _read_corners(source, n_announced), notes


def _read_corners(source: ModelFile, count: int) -> Float:
    """Read `count` facets; only one block is in memory besides the result."""
    corners = np.zeros((count, 3, 3))
    block = np.zeros(min(count, BLOCK), dtype=FACET)
    source.file.seek(HEADER_SIZE)
    for part in facet_blocks(count):
        n_wanted = part.stop - part.start
        data = block[:n_wanted].view(np.uint8).data
        if source.file.readinto(data) != n_wanted * FACET.itemsize:
            raise MeshError(f"{source.path}: the file became shorter while it was read", remedy=COPY_AGAIN)
        corners[part] = block["corners"][:n_wanted]
        source.report_progress(part.stop / count)
    return corners


def _ends_with_padding(source: ModelFile) -> bool:
    """Return whether the last record of the file, which is as long as a facet, is padding."""
    return _has_only_zeros(source, FACET.itemsize)


def _has_only_zeros(source: ModelFile, length: int) -> bool:
    """Return whether the last `length` bytes of the file are zero."""
    source.file.seek(source.size - length)
    while chunk := source.file.read(1 << 20):
        if chunk.strip(b"\0"):
            return False
    return True


def _may_hold_facets(source: ModelFile, length: int) -> bool:
    """Return whether the last `length` bytes of the file may be facets or another binary STL."""
    source.file.seek(source.size - length)
    header = HEADER_SIZE
    while len(piece := source.file.read(BLOCK * FACET.itemsize)) >= FACET.itemsize:
        if piece.translate(None, PRINTABLE) and any(_is_mostly_facets(piece[skip:]) for skip in (0, header)):
            return True
        header = HEADER_SIZE % FACET.itemsize
    return False


def _is_mostly_facets(piece: bytes) -> bool:
    """Return whether at least half of the non-zero records look like facets.

    The corners of a facet are finite, within the accepted range, and not all in one spot. Other data, read as 32-bit
    floats, is spread over 76 powers of ten.
    """
    corners = np.frombuffer(piece, FACET, len(piece) // FACET.itemsize)["corners"].astype(np.float64)
    near = (np.abs(corners) < LARGEST).all(axis=(1, 2))
    n_facets = np.count_nonzero(near & (np.ptp(corners, axis=1) > SMALLEST_FACET).any(axis=1))
    return bool(0 < n_facets >= np.count_nonzero(corners.any(axis=(1, 2))) / 2)


@check_arguments(mesh=Mesh, path=PATH)
def export_stl(mesh: Mesh, path: str | os.PathLike[str]) -> None:
    """Write a binary STL; the same mesh always gives the same bytes.

    Args:
        mesh: the mesh to write, in mm.
        path: the file.

    Raises:
        OutputError: the file cannot be written.
    """
    header = b"binary STL in mm".ljust(80) + mesh.n_facets.to_bytes(4, "little")
    try:
        with Path(path).open("wb") as file:
            file.write(header)
            for part in facet_blocks(mesh.n_facets):
                file.write(_build_facet_records(mesh.triangles[part]).tobytes())
    except OSError as error:
        raise OutputError(f"{path}: {error.strerror}", remedy="Write to another folder") from error


def _build_facet_records(triangles: Float) -> np.ndarray[tuple[int], np.dtype[np.void]]:
    """Return the facet records (F,) of the file, with normals."""
    facets = np.zeros(len(triangles), dtype=FACET)
    facets["corners"] = triangles
    a, b, c = facets["corners"].astype(np.float64).transpose(1, 0, 2)
    normals = np.cross(b - a, c - a)
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    facets["normal"] = np.divide(normals, lengths, out=np.zeros_like(normals), where=lengths > 0)
    return facets
