"""The outline of a part as seen from above: the projection of all its facets onto the bed."""

from __future__ import annotations

from typing import Final

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, consecutive
from printer_slicer.geometry import Areas, normalize
from printer_slicer.geometry.connectivity import find_cycles
from printer_slicer.geometry.layer_union import unite_layers
from printer_slicer.model import Mesh

__all__ = ["project_from_above", "project_in_tiles"]

_TILES: Final = 16  # per side of a window: many small unions are faster than one large union
_MAX_BORDER: Final = 20_000  # edges
_BESIDE: Final = 1.0  # mm around the part


def project_from_above(mesh: Mesh) -> Areas:
    """Return the outline of a part, with holes where one can look through it, as one layer; mm.

    The upward facets cover each point as often as the winding number of their common border says. So only this border
    is united, which has far fewer edges than the facets.
    """
    low, high = mesh.bounds[:, :2]
    border = _trace_border(mesh)
    if len(border.xy) > _MAX_BORDER:  # as of facets that share no edges
        return unite_layers(project_in_tiles(mesh, low - _BESIDE, high + _BESIDE))
    return normalize(border)


def _trace_border(mesh: Mesh) -> Areas:
    """Return the border of the upward facets as seen from above, as closed rings that may cross, in one layer."""
    xy = mesh.triangles[:, :, :2]
    xy = xy[_find_upward(mesh)]
    corners = xy.reshape(-1, 2) + 0.0  # -0.0 becomes 0.0
    _, first, point = np.unique(corners[:, 0] + 1j * corners[:, 1], return_index=True, return_inverse=True)
    begin = point.ravel()
    end = np.roll(begin.reshape(-1, 3), -1, axis=1).ravel()
    n_points = max(len(first), 1)
    key, edge = np.unique(np.minimum(begin, end) * n_points + np.maximum(begin, end), return_inverse=True)
    count = np.bincount(edge.ravel(), np.sign(end - begin), len(key)).astype(np.int64)
    low, high = np.divmod(key, n_points)
    kept = np.repeat(np.arange(len(key)), np.abs(count))
    begin, end = np.where(count[kept] > 0, (low[kept], high[kept]), (high[kept], low[kept]))
    # As many edges end at a point as begin there, so both orders list the same points.
    following = np.zeros(len(kept), np.int64)
    following[np.argsort(end, kind="stable")] = np.argsort(begin, kind="stable")
    lowest, steps = find_cycles(following)
    order = np.lexsort((steps, lowest))
    start = np.append(np.flatnonzero(np.diff(lowest[order], prepend=-1)), len(order))
    return Areas(corners[first[begin[order]]], start, np.zeros(len(start) - 1, np.int64), 1)


def _find_upward(mesh: Mesh) -> Bool:
    """Return which facets (F,) face up."""
    xy = mesh.triangles[:, :, :2]
    one, two = xy[:, 1] - xy[:, 0], xy[:, 2] - xy[:, 0]
    return np.asarray(one[:, 0] * two[:, 1] > one[:, 1] * two[:, 0])


def project_in_tiles(mesh: Mesh, low: Float, high: Float) -> Areas:
    """Project the upward facets in a window from `low` to `high` (2,), mm; each tile of the window becomes a layer.

    Facets that touch a tile are projected whole; two meshes in one window have the same tiles.
    """
    xy = mesh.triangles[:, :, :2]
    ends = xy.min(axis=1), xy.max(axis=1)
    seen = _find_upward(mesh) & (ends[1] > low).all(axis=1)
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
