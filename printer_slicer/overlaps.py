"""Find parts on one plate that overlap in the top view, and split plates into the parts that do not."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

import numpy as np

from printer_slicer.arrays import Float
from printer_slicer.geometry import Areas, intersection, normalize
from printer_slicer.geometry.boxes import Boxes
from printer_slicer.geometry.connected_areas import split_connected
from printer_slicer.geometry.layer_union import unite_layers
from printer_slicer.geometry.plane_sections import section_contours
from printer_slicer.model import Mesh, PlateObject
from printer_slicer.surface.top_view import project_in_tiles
from printer_slicer.values import replace

__all__ = ["Overlap", "find_collisions", "find_overlaps", "name_parts", "split_separate_objects"]

_LEAST: Final = 0.01  # mm: smaller overlaps are rounding errors
_SHARED: Final = 0.1  # mm: objects that are modelled to touch may overlap by this much
_PLANES: Final = 24  # over the height that two objects share


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
            common = intersection(*(project_in_tiles(meshes[at], *window) for at in (first, second)))
            size, area = _measure_overlaps(unite_layers(common))
            if len(size):
                width, depth = size[np.argmax(area)].tolist()
                yield Overlap(first, second, width, depth, len(size))


def _measure_overlaps(common: Areas) -> tuple[Float, Float]:
    """Return the bounding box size (n, 2), mm, and area (n,), mm², of each connected overlap of one layer."""
    if not common.n_rings:
        return np.zeros((0, 2)), np.zeros(0)
    areas = split_connected(common).areas
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
    return normalize(section_contours(part.triangles[item.facets], z))


def split_separate_objects(mesh: Mesh) -> list[Mesh]:
    """Split a mesh into its objects; objects that overlap seen from above stay together.

    A mesh that was not read as several objects stays whole.
    """
    if len(mesh.objects) < 2 or not all(item.count for item in mesh.objects):
        return [mesh]
    single = [_extract_objects(mesh, [item]) for item in mesh.objects]
    group = list(range(len(single)))
    for overlap in find_overlaps(single):
        old, new = group[overlap.second], group[overlap.first]
        group = [new if one == old else one for one in group]
    members = [
        [item for item, own in zip(mesh.objects, group, strict=True) if own == one]
        for one in dict.fromkeys(group)
    ]
    return [_extract_objects(mesh, items) for items in members] if len(members) > 1 else [mesh]


def name_parts(file: str, parts: Sequence[Mesh]) -> list[str]:
    """Return the names of the parts of a file for messages: that of the file, if it is only one."""
    return [file] if len(parts) == 1 else [f"{file}, {part.name}" for part in parts]


def _extract_objects(mesh: Mesh, items: Sequence[PlateObject]) -> Mesh:
    """Return some objects of a mesh as a mesh with the same objects."""
    counts = [item.count for item in items]
    firsts = np.cumsum([0, *counts[:-1]]).tolist()
    kept = tuple(replace(item, first=first) for item, first in zip(items, firsts, strict=True))
    triangles = np.concatenate([mesh.triangles[item.facets] for item in items])
    return replace(mesh, triangles=triangles, name=items[0].name, objects=kept)
