"""Split the areas of a stack into connected pieces."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from printer_slicer.arrays import Float, Int, frozen_array
from printer_slicer.geometry.areas import Areas
from printer_slicer.geometry.boxes import Boxes
from printer_slicer.geometry.ring_queries import find_enclosing_rings
from printer_slicer.values import Struct, force_setattr

__all__ = ["ConnectedAreas", "split_connected"]


class ConnectedAreas(Struct, frozen=True, eq=False):
    """Connected pieces of areas, stored like the layers of a stack.

    Attributes:
        areas: P pieces in place of layers, each one outer ring with its holes.
        layer: (P,) layer of each piece, ascending.
        of_ring: (R,) piece of each ring of the stack, or -1.
    """

    areas: Areas
    layer: Int
    of_ring: Int

    def __post_init__(self) -> None:
        force_setattr(self, "layer", frozen_array(self.layer, np.int64, (self.areas.n_layers,)))
        force_setattr(self, "of_ring", frozen_array(self.of_ring, np.int64, (-1,)))

    def take(self, which: Int) -> ConnectedAreas:
        """Return the pieces with the given indices (n,), ascending."""
        number = np.full(self.count + 1, -1)  # the last entry is for rings without a piece
        number[which] = np.arange(len(which))
        return ConnectedAreas(self.areas.copy_layers(which), self.layer[which], number[self.of_ring])

    @classmethod
    def joined(cls, parts: Sequence[ConnectedAreas]) -> tuple[ConnectedAreas, Int]:
        """Join the pieces of several stacks, by layer.

        Returns:
            The pieces, whose `of_ring` covers the rings of all stacks, and the (P,) index of each piece's stack.
        """
        layer = np.concatenate([part.layer for part in parts])
        count = [part.count for part in parts]
        source = np.repeat(np.arange(len(parts)), count)
        order = np.argsort(layer, kind="stable")
        number = np.zeros(len(layer) + 1, np.int64)
        number[order] = np.arange(len(layer))
        number[-1] = -1
        first = np.cumsum([0, *count]).tolist()
        piece = np.concatenate(
            [number[part.areas.ring_layer + n] for part, n in zip(parts, first, strict=False)]
        )
        sizes = np.concatenate([np.diff(part.areas.ring_start) for part in parts])
        xy = np.concatenate([part.areas.xy for part in parts])
        rings = Areas(xy, np.append(0, np.cumsum(sizes)), np.zeros_like(piece), 1)
        sorted_rings = np.argsort(piece, kind="stable")
        areas = rings.restacked(sorted_rings, piece[sorted_rings], len(layer))
        of_ring = [
            number[np.where(part.of_ring < 0, -1, part.of_ring + n)]
            for part, n in zip(parts, first, strict=False)
        ]
        return cls(areas, layer[order], np.concatenate(of_ring)), source[order]

    @property
    def count(self) -> int:
        """Number of pieces."""
        return len(self.layer)

    def mean_width(self) -> Float:
        """Return the (P,) width of a long strip with the same area and outline length, mm."""
        return np.asarray(2 * self.areas.area() / self.areas.length())

    def select_nearby_rings(self, areas: Areas) -> Areas:
        """Return for each piece the rings of `areas` on its layer whose bounding boxes overlap that of the piece."""
        low, high = self.areas.boxes()
        own = Boxes(low, high, self.layer)
        piece, ring = own.find_overlapping(Boxes.of_rings(areas))
        order = np.lexsort((ring, piece))
        return areas.restacked(ring[order], piece[order], self.count)

    def on_layers(self, n_layers: int, which: Int) -> Areas:
        """Return the pieces `which` (n,), ascending, on their layers of the stack."""
        rings = np.flatnonzero(np.isin(self.areas.ring_layer, which))
        return self.areas.restacked(rings, self.layer[self.areas.ring_layer[rings]], n_layers)


def split_connected(areas: Areas) -> ConnectedAreas:
    """Return the connected pieces of clean areas, by layer and in the order of their outer rings.

    Areas that touch only in a point are separate pieces.
    """
    outer = areas.ring_area() > 0
    solids, holes = np.flatnonzero(outer), np.flatnonzero(~outer)
    owner = np.zeros(areas.n_rings, np.int64)
    owner[solids] = np.arange(len(solids))
    if len(holes):
        # Holes may touch their outer ring at corners, but not along sides.
        first = areas.ring_start[holes]
        probes = (areas.xy[first] + areas.xy[first + 1]) / 2
        found = find_enclosing_rings(areas.take(solids), probes, areas.ring_layer[holes])
        owner[holes] = found
    # Leave out rings without area that lie in no other ring.
    order = np.argsort(owner, kind="stable")[int((owner < 0).sum()) :]
    entries = areas.restacked(order, owner[order], len(solids))
    return ConnectedAreas(entries, areas.ring_layer[solids], owner)
