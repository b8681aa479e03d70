"""Check that facets can bound a volume, in blocks, without a second copy of a large mesh."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Final

import numpy as np

from printer_slicer.errors import MeshError
from printer_slicer.mesh_io.units import UNITS
from printer_slicer.model import Mesh

if TYPE_CHECKING:
    from pathlib import Path

    from printer_slicer.arrays import Float

__all__ = ["BLOCK", "COPY_AGAIN", "EXPORT_AGAIN", "LARGEST", "drop_degenerate_facets", "facet_blocks"]

BLOCK: Final = 1 << 13
"""Number of facets processed at a time: 0.6 MiB of float64, which fits the cache."""

LARGEST: Final = 1e7
"""Maximum coordinate, mm (10 km); the cube of a larger one would make the volume meaningless."""

EXPORT_AGAIN: Final = "Export the part again from the program that made it"
TOO_FAR: Final = (
    "Give a smaller unit with `units` if the numbers are not millimetres,"
    " or move the part to the origin and export it again; the limit is 10 km"
)
COPY_AGAIN: Final = "Copy or download the file again; if that does not help, export the part again"


def facet_blocks(count: int) -> Iterator[slice]:
    """Yield slices of at most BLOCK facets that together cover `count` facets."""
    for start in range(0, count, BLOCK):
        yield slice(start, min(start + BLOCK, count))


def drop_degenerate_facets(triangles: Float, path: Path) -> tuple[Float, int]:
    """Drop facets with two equal corners, and check that the others extend in x, y and z.

    Whether the surface is closed and faces outward is checked by `healing`.

    Args:
        triangles: (F, 3, 3) mm; changed in place.
        path: path of the file, for messages.

    Returns:
        Triangles (F', 3, 3), a view of the argument; the number of dropped facets.

    Raises:
        MeshError: there are no facets, the part has no extent, or a coordinate is not finite.
    """
    if len(triangles) == 0:
        raise MeshError(f"{path}: the file contains no facets", remedy=EXPORT_AGAIN)
    kept = _move_valid_facets_to_front(triangles, path)
    if len(kept) == 0:
        raise MeshError(f"{path}: all facets in the file have zero area", remedy=EXPORT_AGAIN)
    for name, size in zip("xyz", Mesh(kept).size.tolist(), strict=True):
        if size <= 0:
            raise MeshError(f"{path}: the part is flat: it does not extend in {name}", remedy=EXPORT_AGAIN)
    return kept, len(triangles) - len(kept)


def _move_valid_facets_to_front(triangles: Float, path: Path) -> Float:
    """Move the facets with three different corners to the front and return a view of them."""
    n_kept = 0
    for block in facet_blocks(len(triangles)):
        part = triangles[block]
        flat = part.reshape(-1)
        # A nan fails both comparisons.
        if not (flat.min() > -LARGEST and flat.max() < LARGEST):
            wild = int(np.flatnonzero(~(np.abs(flat) < LARGEST))[0])
            raise MeshError(
                f"{path}: facet {block.start + wild // 9 + 1} of {len(triangles)} has the coordinate {flat[wild]:g}",
                remedy=TOO_FAR if abs(flat[wild]) < LARGEST / UNITS["micron"] else EXPORT_AGAIN,
            )
        folded = _find_degenerate(part)
        if folded.any():
            part = part[~folded]
        if n_kept != block.start or len(part) != block.stop - block.start:
            triangles[n_kept : n_kept + len(part)] = part
        n_kept += len(part)
    return triangles[:n_kept]


def _find_degenerate(part: Float) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Return which facets (F,) have two equal corners."""
    folded = np.zeros(len(part), dtype=np.bool_)
    for a, b in ((0, 1), (1, 2), (2, 0)):
        near = np.flatnonzero(part[:, a, 0] == part[:, b, 0])
        folded[near[(part[near, a] == part[near, b]).all(axis=1)]] = True
    return folded
