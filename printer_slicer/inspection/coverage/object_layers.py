"""Find the layers of each object of a plate, or of each feature of a part, if these have layers of their own."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from printer_slicer.arrays import Bool, Float, Int
from printer_slicer.feature_ranges import FeatureRange, clip_features, find_feature_ranges
from printer_slicer.geometry import Areas
from printer_slicer.geometry.facet_clipping import clip_facets
from printer_slicer.geometry.segment_index import OutlineIndex
from printer_slicer.inspection.coverage.extrusions import Extrusions
from printer_slicer.inspection.coverage.matching import shift_areas
from printer_slicer.inspection.coverage.stack import Stack, stack_extrusions
from printer_slicer.inspection.deposition.marks import Purpose
from printer_slicer.model import Mesh
from printer_slicer.object_plans import extract_objects, group_close_objects
from printer_slicer.surface.top_view import project_from_above
from printer_slicer.values import Struct, replace

__all__ = [
    "OwnPart",
    "divide_extrusions",
    "has_own_layers",
    "has_thick_perimeters",
    "join_equal_layers",
    "separate_features",
    "separate_objects",
    "stack_groups",
]

_SAME_HEIGHT: Final = 0.008  # mm; tops that differ by less are equal; files round z to 0.001 or 0.01
_SEPARATE_SHARE: Final = (
    0.05  # of the external perimeters; more means that some parts have layers of their own
)
_ROUNDING: Final = 0.01  # mm; files round heights by up to this
_Z_STEP: Final = 0.0025  # mm; printers move by a multiple of this
_SHORTEST_RANGE: Final = 0.5  # mm; planners give no layers of their own to features that are not so high


class OwnPart(Struct, frozen=True, eq=False):
    """A part of a mesh that may have layers of its own: a group of objects, a feature, or what is below or above these.

    Attributes:
        mesh: its surface.
        outline: what it covers as seen from above, in one layer.
        low, high: mm; its layers end above `low`, at `high` or below. Infinite if they may end anywhere.
    """

    mesh: Mesh
    outline: Areas
    low: float = -np.inf
    high: float = np.inf

    def moved(self, by: tuple[float, float]) -> OwnPart:
        """Return the part moved by x and y, mm."""
        return replace(self, mesh=self.mesh.moved((*by, 0.0)), outline=shift_areas(self.outline, by))


def has_thick_perimeters(beads: Extrusions, stack: Stack) -> bool:
    """Return whether comments say that many external perimeters are thicker than the common layers of a file.

    Args:
        beads: the extrusions, with the heights in comments.
        stack: the common layers.
    """
    external = (stack.layer >= 0) & (beads.purpose == Purpose.EXTERNAL_PERIMETER)
    thick = external & (beads.height > stack.height[stack.layer] + _ROUNDING)
    return bool(beads.length[thick].sum() > _SEPARATE_SHARE * beads.length[external].sum())


def separate_objects(mesh: Mesh) -> list[OwnPart]:
    """Return the groups of objects that may have layers of their own: at least 1 mm apart in the top view.

    It is the whole mesh if the facets of its objects are not known.
    """
    if len(mesh.objects) < 2 or not all(item.count for item in mesh.objects):
        return [_make_part(mesh)]
    groups = group_close_objects(mesh)
    return [_make_part(extract_objects(mesh, [mesh.objects[one] for one in group])) for group in groups]


def _make_part(mesh: Mesh) -> OwnPart:
    """Return a part whose layers may end anywhere."""
    return OwnPart(mesh, project_from_above(mesh))


def separate_features(mesh: Mesh, tops: Float) -> list[OwnPart]:
    """Return the features that may have layers of their own, and what is below, between and above them.

    Args:
        mesh: a part that is a single object.
        tops: (L,) tops of all layers, mm. Features begin and end at some of these.
    """
    z = float(mesh.bounds[0, 2])
    found = list[tuple[FeatureRange, list[Mesh]]]()
    standing = mesh.moved((0.0, 0.0, -z))
    for place in find_feature_ranges(standing, _Z_STEP, _SHORTEST_RANGE):
        is_met = _is_end_of_layer(place.low + z, tops) and _is_end_of_layer(place.high + z, tops)
        meshes = clip_features(standing, place) if is_met else []
        found += [(place, meshes)] if meshes else []
    if not found:
        return [_make_part(mesh)]
    whole = project_from_above(mesh)
    borders = [-np.inf, *(end for place, _ in found for end in (place.low, place.high)), np.inf]
    parts = list[OwnPart]()
    for low, high in zip(borders[::2], borders[1::2], strict=True):
        between = clip_facets(standing.triangles, max(low, -1.0), min(high, standing.height + 1))
        if low < min(high, standing.height) and len(between):
            name = f"{mesh.name}, z {max(low, 0.0):g} to {min(high, standing.height):g}"
            parts.append(_make_part_at(z, Mesh(between, name), whole, low, high))
    for place, meshes in found:
        outlines = [place.outlines.copy_layers(np.array([k])) for k in range(len(meshes))]
        parts += [_make_part_at(z, *one, place.low, place.high) for one in zip(meshes, outlines, strict=True)]
    return parts


def _is_end_of_layer(z: float, tops: Float) -> bool:
    """Return whether a layer begins or ends at a height, or all are below it."""
    return bool(z < tops[0] or z > tops[-1] or np.abs(tops - z).min() < _SAME_HEIGHT)


def _make_part_at(z: float, mesh: Mesh, outline: Areas, low: float, high: float) -> OwnPart:
    """Return a part that is z mm higher than its mesh and its range, `low` to `high`."""
    return OwnPart(mesh.moved((0.0, 0.0, z)), outline, low + z, high + z)


def divide_extrusions(beads: Extrusions, parts: Sequence[OwnPart]) -> Int:
    """Return for each extrusion (B,) the index of the part at its height whose outline is nearest to its middle."""
    middle = (beads.begin + beads.end) / 2
    if not len(middle):
        return np.zeros(0, np.int64)
    low, high = middle.min(axis=0) - 1, middle.max(axis=0) + 1
    on_bed = np.zeros(len(middle), np.int64)
    distances = list[Float]()
    for part in parts:
        outline = OutlineIndex(part.outline, low, high)
        distance = np.where(outline.is_inside(middle, on_bed), 0.0, outline.distance(middle, on_bed))
        is_there = (beads.z_top > part.low + _SAME_HEIGHT) & (beads.z_top <= part.high + _SAME_HEIGHT)
        distances.append(np.where(is_there, distance, np.inf))
    return np.asarray(np.argmin(distances, axis=0))


def stack_groups(
    beads: Extrusions, parts: Sequence[OwnPart], common: Stack, of_part: Bool | None = None
) -> Stack:
    """Assign extrusions to layers, those of each part to its own.

    Args:
        beads: the extrusions, in printing order.
        parts: the groups of the stack, in the position where they are printed.
        common: the layers of the file.
        of_part: as in `stack_extrusions`.
    """
    owner = divide_extrusions(beads, parts)
    chosen = [np.flatnonzero(owner == one) for one in range(len(parts))]
    stacks = [
        stack_extrusions(
            beads.take(own), None if of_part is None else of_part[own], _find_top_below(part.low, common)
        )
        for own, part in zip(chosen, parts, strict=True)
    ]
    top, bottom = (np.concatenate([getattr(one, name) for one in stacks]) for name in ("top", "bottom"))
    group = np.repeat(np.arange(len(stacks)), [one.n_layers for one in stacks])
    order = np.argsort(top, kind="stable")
    place = np.argsort(order)
    layer, height = np.full(beads.n_beads, -1), np.zeros(beads.n_beads)
    for number, (own, one) in enumerate(zip(chosen, stacks, strict=True)):
        layer[own] = np.append(place[group == number], -1)[one.layer]
        height[own] = one.beads.height
    return Stack(replace(beads, height=height), layer, top[order], bottom[order], group[order])


def _find_top_below(z: float, common: Stack) -> float | None:
    """Return the highest top of the file's layers up to a height, mm; None if there is none."""
    below = common.top[common.top <= z + _SAME_HEIGHT]
    return float(below[-1]) if len(below) else None


def has_own_layers(stack: Stack, common: Stack) -> bool:
    """Return whether a group lacks some of the common layers between its bottom and its top."""
    for own in stack.layers_of_groups():
        top = stack.top[own]
        lower = common.top[common.top > stack.bottom[own[0]] + _SAME_HEIGHT][: len(top)]
        if len(lower) < len(top) or (np.abs(lower - top) > _SAME_HEIGHT).any():
            return True
    return False


def join_equal_layers(stack: Stack, sections: Areas) -> tuple[Stack, Areas]:
    """Join the layers of different groups that have the same top, as a file has them.

    The height of each extrusion stays that of its group; the height of a joined layer is the largest one.
    """
    joined = stack.number - 1
    n_layers = int(stack.number.max(initial=0))
    bottom = np.full(n_layers, np.inf)
    np.minimum.at(bottom, joined, stack.bottom)
    top = np.zeros(n_layers)
    np.maximum.at(top, joined, stack.top)
    layer = np.append(joined, -1)[stack.layer]
    return Stack(stack.beads, layer, top, bottom), sections.on_layers(joined, n_layers)
