"""Find parts on one plate that overlap in the top view, which would be printed as one part."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

import numpy as np

from printer_slicer.arrays import Float, Int, consecutive
from printer_slicer.geometry import Areas, intersection, normalize
from printer_slicer.geometry.boxes import Boxes
from printer_slicer.geometry.connected_areas import split_connected
from printer_slicer.geometry.plane_sections import section_contours
from printer_slicer.model import Mesh

__all__ = ["Overlap", "find_collisions", "find_overlaps"]

_LEAST: Final = 0.01  # mm: smaller overlaps are rounding errors
_SHARED: Final = 0.1  # mm: objects that are modelled to touch may overlap by this much
_PLANES: Final = 24  # over the height that two objects share
_TILES: Final = 16  # per side of a window: many small unions are faster than one large union


class Overlap(NamedTuple):
    """Two parts that overlap.

    Attributes:
        first, second: indices of the parts.
        width: mm, extent of the largest connected overlap in x.
        depth: mm, its extent in y.
        places: number of separate overlaps, where they are counted.
    """

    first: int
    second: int
    width: float
    depth: float
    places: int = 1


def find_overlaps(meshes: Sequence[Mesh]) -> Iterator[Overlap]:
    """Yield pairs of parts whose projections onto the bed overlap by more than 0.01 mm, sorted by the second part.

    A part in a hole of another part does not overlap with it; a part over or under another part does.
    """
    low, high = (np.array([mesh.bounds[side, :2] for mesh in meshes]) for side in (0, 1))
    for second in range(1, len(meshes)):
        room = np.minimum(high[:second], high[second]) - np.maximum(low[:second], low[second])
        for first in np.flatnonzero((room > _LEAST).all(axis=1)).tolist():
            window = np.maximum(low[first], low[second]), np.minimum(high[first], high[second])
            common = intersection(*(_project_mesh(meshes[at], *window) for at in (first, second)))
            size, area = _measure_overlaps(common)
            if len(size):
                width, depth = size[np.argmax(area)].tolist()
                yield Overlap(first, second, width, depth, len(size))


def _measure_overlaps(common: Areas) -> tuple[Float, Float]:
    """Join overlaps across tiles; return the bounding box size (n, 2), mm, and area (n,), mm², of each."""
    if not common.n_rings:
        return np.zeros((0, 2)), np.zeros(0)
    whole = normalize(common.restacked(np.arange(common.n_rings), np.zeros(common.n_rings, np.int64), 1))
    areas = split_connected(whole).areas
    low, high = areas.boxes()
    size, area = high - low, areas.area()
    counts = (size > _LEAST).all(axis=1) & (area > _LEAST**2)
    return size[counts], area[counts]


def find_collisions(part: Mesh) -> Iterator[Overlap]:
    """Yield pairs of objects that intrude into each other by more than 0.1 mm, sorted by the second object.

    Objects of one file are placed relative to each other on purpose: one may stand on another or reach over it. Their
    sections are compared on 24 planes over the height that both have.
    """
    bounds = np.array([(item.low, item.high) for item in part.objects]).reshape(-1, 2, 3)
    for second in range(1, len(bounds)):
        low, high = (
            np.maximum(bounds[:second, 0], bounds[second, 0]),
            np.minimum(bounds[:second, 1], bounds[second, 1]),
        )
        for first in np.flatnonzero((high - low > _SHARED).all(axis=1)).tolist():
            z = low[first, 2] + (np.arange(_PLANES) + 0.5) * ((high - low)[first, 2] / _PLANES)
            common = intersection(*(_cut_object(part, at, z) for at in (first, second)))
            common = common.take(np.flatnonzero(np.abs(common.ring_area()) > _SHARED**2))
            boxes = Boxes.of_rings(common)
            sizes = (boxes.high - boxes.low)[(boxes.high - boxes.low > _SHARED).all(axis=1)]
            if len(sizes):
                width, depth = sizes[sizes.prod(axis=1).argmax()].tolist()
                yield Overlap(first, second, width, depth)


def _cut_object(part: Mesh, number: int, z: Float) -> Areas:
    """Return the solid sections of an object at heights (n,), mm."""
    item = part.objects[number]
    return normalize(section_contours(part.triangles[item.first : item.first + item.count], z))


def _project_mesh(mesh: Mesh, low: Float, high: Float) -> Areas:
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
