"""Group patches of overhangs whose columns overlap, because all of a group get the same style."""

from __future__ import annotations

from typing import Final

import numpy as np

from printer_slicer.arrays import Float, Int, distinct
from printer_slicer.geometry import (
    Areas,
    ConnectedAreas,
    find_enclosing_rings,
    normalize,
    offset,
    split_connected,
)
from printer_slicer.geometry.layer_union import unite_layers
from printer_slicer.model import Overhangs, Supports
from printer_slicer.values import Struct

__all__ = ["PatchGroups", "group_patches"]

_APART: Final = 2.0  # mm; columns nearer than this are one group, so that trees have room beside columns


class PatchGroups(Struct, frozen=True, eq=False):
    """Groups of patches.

    Attributes:
        seen: the columns of all groups, seen from above, as pieces of one layer.
        of_patch: (n_patches,) group of each patch.
    """

    seen: ConnectedAreas
    of_patch: Int

    @property
    def count(self) -> int:
        """Number of groups."""
        return self.seen.count

    def find(self, points: Float) -> Int:
        """Return the group (n,) whose columns contain or are nearest to each point (n, 2), mm; at least one exists."""
        ring = find_enclosing_rings(_join_pieces(self.seen), points, np.zeros(len(points), np.int64))
        group = np.where(ring >= 0, self.seen.areas.ring_layer[ring], -1)
        outside = np.flatnonzero(group < 0)
        if len(outside):
            low, high = self.seen.areas.boxes()
            at = points[outside, None]
            away = np.maximum(np.maximum(low - at, at - high), 0.0)
            group[outside] = np.argmin((away**2).sum(axis=2), axis=1)
        return np.asarray(group)


def group_patches(overhangs: Overhangs, columns: Supports) -> PatchGroups:
    """Group the patches whose columns overlap, seen from above.

    Args:
        overhangs: at least one patch.
        columns: under all patches.
    """
    area, n = overhangs.area, overhangs.n_patches
    order = np.argsort(overhangs.ring_patch, kind="stable")
    patches = normalize(area.restacked(order, overhangs.ring_patch[order], n))
    stacks = columns.base.merge(columns.interface).merge(columns.floor)
    used = distinct(stacks.find_first_equal_layers())
    all_areas = Areas.merged([unite_layers(stacks.of_layers(used)), unite_layers(patches)])
    seen = split_connected(offset(normalize(all_areas), _APART / 2))
    first = np.searchsorted(patches.ring_layer, np.arange(n))
    points = patches.xy[patches.ring_start[first]]
    ring = find_enclosing_rings(_join_pieces(seen), points, np.zeros(n, np.int64))
    return PatchGroups(seen, seen.areas.ring_layer[ring])


def _join_pieces(pieces: ConnectedAreas) -> Areas:
    """Return pieces of one layer as a stack of one layer, with the rings in the same order."""
    areas = pieces.areas
    return Areas(areas.xy, areas.ring_start, np.zeros(areas.n_rings, np.int64), 1)
