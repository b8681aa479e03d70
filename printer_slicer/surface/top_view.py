"""The outline of a part as seen from above: the projection of all its facets onto the bed."""

from __future__ import annotations

from typing import Final

import numpy as np

from printer_slicer.arrays import Float, Int, consecutive
from printer_slicer.geometry import Areas, normalize
from printer_slicer.geometry.layer_union import unite_layers
from printer_slicer.model import Mesh

__all__ = ["project_from_above", "project_in_tiles"]

_TILES: Final = 16  # per side of a window: many small unions are faster than one large union
_BESIDE: Final = 1.0  # mm around the part


def project_from_above(mesh: Mesh) -> Areas:
    """Return the outline of a part, with holes where one can look through it, as one layer; mm."""
    low, high = mesh.bounds[:, :2]
    return unite_layers(project_in_tiles(mesh, low - _BESIDE, high + _BESIDE))


def project_in_tiles(mesh: Mesh, low: Float, high: Float) -> Areas:
    """Project the upward facets in a window from `low` to `high` (2,), mm; each tile of the window becomes a layer.

    Facets that touch a tile are projected whole; two meshes in one window have the same tiles.
    """
    xy = mesh.triangles[:, :, :2]
    one, two = xy[:, 1] - xy[:, 0], xy[:, 2] - xy[:, 0]
    ends = xy.min(axis=1), xy.max(axis=1)
    seen = (one[:, 0] * two[:, 1] > one[:, 1] * two[:, 0]) & (ends[1] > low).all(axis=1)
    chosen = np.flatnonzero(seen & (ends[0] < high).all(axis=1))
    facet, tile = _assign_tiles(ends[0][chosen], ends[1][chosen], low, high)
    order = np.argsort(tile, kind="stable")
    rings = xy[chosen[facet[order]]].reshape(-1, 2)
    return normalize(Areas(rings, np.arange(0, len(rings) + 1, 3), tile[order], _TILES**2))


def _assign_tiles(first: Float, last: Float, low: Float, high: Float) -> tuple[Int, Int]:
    """Return pairs of a box (m,) and a tile (m,) of the window that touch; boxes span `first` to `last` (n, 2)."""
    size = (high - low) / _TILES
    begin, end = (
        np.clip(((corner - low) / size).astype(np.int64), 0, _TILES - 1) for corner in (first, last)
    )
    count = end - begin + 1
    boxes = np.repeat(np.arange(len(first)), count.prod(axis=1))
    nth = consecutive(np.zeros(len(first), np.int64), count.prod(axis=1))
    row, column = np.divmod(nth, count[boxes, 0])
    return boxes, (begin[boxes, 1] + row) * _TILES + begin[boxes, 0] + column
