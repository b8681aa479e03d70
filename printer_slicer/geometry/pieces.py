"""The connected pieces of the areas of a stack, each as an entry of its own."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from printer_slicer.geometry.areas import Areas, Float, Int, consecutive, frozen_array
from printer_slicer.geometry.inside import rings_around

__all__ = ["Pieces", "pieces_of"]


@dataclass(frozen=True, slots=True, eq=False)
class Pieces:
    """Connected areas one by one: what can be asked of the layers of a stack can be asked of them.

    Attributes:
        areas: P entries instead of layers, one outer ring and its holes each.
        layer: (P,) ascending, the layer on which each piece lies.
        of_ring: (R,) the piece that each ring of the stack belongs to; -1 where it belongs to none.
    """

    areas: Areas
    layer: Int
    of_ring: Int

    def __post_init__(self) -> None:
        object.__setattr__(self, "layer", frozen_array(self.layer, np.int64, (self.areas.n_layers,)))
        object.__setattr__(self, "of_ring", frozen_array(self.of_ring, np.int64, (-1,)))

    def take(self, which: Int) -> Pieces:
        """Some of the pieces (n,), ascending."""
        number = np.full(self.count + 1, -1)  # the last one for rings that belong to none
        number[which] = np.arange(len(which))
        kept = self.areas.take(np.flatnonzero(number[self.areas.ring_layer] >= 0))
        areas = Areas(kept.xy, kept.ring_start, number[kept.ring_layer], len(which))
        return Pieces(areas, self.layer[which], number[self.of_ring])

    @property
    def count(self) -> int:
        """How many pieces."""
        return len(self.layer)

    def mean_width(self) -> Float:
        """(P,) mm: what a long strip of the same area and outline is wide."""
        around = np.bincount(self.areas.ring_layer, self.areas.ring_length(), minlength=self.count)
        return np.asarray(2 * self.areas.area() / around)

    def beside(self, areas: Areas) -> Areas:
        """For each piece all rings of a stack that lie on its layer."""
        bounds = areas.layer_start
        count = np.diff(bounds)[self.layer]
        rings = consecutive(bounds[self.layer], count)
        size = np.diff(areas.ring_start)[rings]
        points = consecutive(areas.ring_start[rings], size)
        start = np.append(0, np.cumsum(size))
        return Areas(areas.xy[points], start, np.repeat(np.arange(self.count), count), self.count)

    def on_layers(self, n_layers: int, which: Int) -> Areas:
        """Some of the pieces (n,), ascending, put back on the layers of the stack."""
        kept = self.areas.take(np.flatnonzero(np.isin(self.areas.ring_layer, which)))
        return Areas(kept.xy, kept.ring_start, self.layer[kept.ring_layer], n_layers)


def pieces_of(areas: Areas) -> Pieces:
    """The connected pieces of clean areas, by layer and in the order of their outer rings.

    What touches in a point only is apart.
    """
    outer = areas.ring_area() > 0
    solids, holes = np.flatnonzero(outer), np.flatnonzero(~outer)
    owner = np.zeros(areas.n_rings, np.int64)
    owner[solids] = np.arange(len(solids))
    if len(holes):
        # Holes may touch their outer ring at corners, but not along sides.
        first = areas.ring_start[holes]
        probes = (areas.xy[first] + areas.xy[first + 1]) / 2
        found = rings_around(areas.take(solids), probes, areas.ring_layer[holes])
        owner[holes] = found
    # A ring of no area that lies in none belongs to nothing.
    order = np.argsort(owner, kind="stable")[int((owner < 0).sum()) :]
    # Rings are taken from a stack without layers, so that they may come in any order.
    flat = Areas(areas.xy, areas.ring_start, np.zeros(areas.n_rings, np.int64), 1).take(order)
    entries = Areas(flat.xy, flat.ring_start, owner[order], len(solids))
    return Pieces(entries, areas.ring_layer[solids], owner)
