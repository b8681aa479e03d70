"""Find the layers of each object of a plate, if objects are printed with layers of their own."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from printer_slicer.arrays import Bool, Float, Int
from printer_slicer.geometry import Areas
from printer_slicer.geometry.segment_index import OutlineIndex
from printer_slicer.inspection.coverage.extrusions import Extrusions
from printer_slicer.inspection.coverage.stack import Stack, stack_extrusions
from printer_slicer.model import Mesh
from printer_slicer.object_plans import extract_objects, group_close_objects
from printer_slicer.surface.top_view import project_from_above
from printer_slicer.values import replace

__all__ = [
    "divide_extrusions",
    "has_own_layers",
    "join_equal_layers",
    "separate_objects",
    "stack_groups",
]

_SAME_HEIGHT: Final = 0.008  # mm; tops that differ by less are equal; files round z to 0.001 or 0.01


def separate_objects(mesh: Mesh) -> list[Mesh]:
    """Return the groups of objects that may have layers of their own: at least 1 mm apart in the top view.

    It is the whole mesh if the facets of its objects are not known.
    """
    if len(mesh.objects) < 2 or not all(item.count for item in mesh.objects):
        return [mesh]
    groups = group_close_objects(mesh)
    return [extract_objects(mesh, [mesh.objects[one] for one in group]) for group in groups]


def divide_extrusions(beads: Extrusions, parts: Sequence[Mesh]) -> Int:
    """Return for each extrusion (B,) the index of the part whose top view is nearest to its middle."""
    middle = (beads.begin + beads.end) / 2
    if not len(middle):
        return np.zeros(0, np.int64)
    low, high = middle.min(axis=0) - 1, middle.max(axis=0) + 1
    on_bed = np.zeros(len(middle), np.int64)
    distances = list[Float]()
    for part in parts:
        outline = OutlineIndex(project_from_above(part), low, high)
        distances.append(np.where(outline.is_inside(middle, on_bed), 0.0, outline.distance(middle, on_bed)))
    return np.asarray(np.argmin(distances, axis=0))


def stack_groups(beads: Extrusions, owner: Int, of_part: Bool | None = None) -> Stack:
    """Assign extrusions to layers, those of each group of objects to its own.

    Args:
        beads: the extrusions, in printing order.
        owner: (B,) number of the group of each extrusion, from 0.
        of_part: as in `stack_extrusions`.
    """
    chosen = [np.flatnonzero(owner == one) for one in range(int(owner.max(initial=0)) + 1)]
    stacks = [stack_extrusions(beads.take(own), None if of_part is None else of_part[own]) for own in chosen]
    top, bottom = (np.concatenate([getattr(one, name) for one in stacks]) for name in ("top", "bottom"))
    group = np.repeat(np.arange(len(stacks)), [one.n_layers for one in stacks])
    order = np.argsort(top, kind="stable")
    place = np.argsort(order)
    layer, height = np.full(beads.n_beads, -1), np.zeros(beads.n_beads)
    for number, (own, one) in enumerate(zip(chosen, stacks, strict=True)):
        layer[own] = np.append(place[group == number], -1)[one.layer]
        height[own] = one.beads.height
    return Stack(replace(beads, height=height), layer, top[order], bottom[order], group[order])


def has_own_layers(stack: Stack, common: Stack) -> bool:
    """Return whether a group of objects lacks some of the common layers below its top."""
    for own in stack.layers_of_groups():
        top = stack.top[own]
        lower = common.top[: len(top)]
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
