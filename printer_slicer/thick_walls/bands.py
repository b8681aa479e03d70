"""Where perimeters of neighbouring layers lie in the same place.

Every perimeter is drawn with a narrow pen. What the drawings of several layers have in common is a band as long as the
perimeters agree, and the wider the nearer they are to each other; what is narrower than two that lie as far apart as
they may is left out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from printer_slicer.arrays import Float, Int
from printer_slicer.geometry import (
    Areas,
    Pieces,
    difference,
    offset,
    offset_open,
    pieces_of,
    stroked,
    window_intersection,
)
from printer_slicer.grouping import last_layers
from printer_slicer.model import Regions, Sections, Toolpaths
from printer_slicer.thick_walls.stretches import runs

__all__ = ["SAME_PLACE", "Bands", "bands_of", "common"]

SAME_PLACE = 0.03  # mm: simplified outlines of one surface differ by up to 0.025; a tenth of a bead is 0.045
_PEN = SAME_PLACE  # mm, radius: two lines that far apart have a band of half its width in common
_SHORTEST = 20.0  # mm of perimeter: cutting out less costs more for starts and travels than it saves


@dataclass(frozen=True, slots=True, eq=False)
class Bands:
    """Bands along perimeters, about 0.06 mm wide.

    Attributes:
        standing: for each layer what stands in the same place on the layer below.
        seen: for each layer what does not lie under the next one.
    """

    standing: Areas
    seen: Areas

    def shared(self, first: Int, last: Int) -> Areas:
        """For each layer k what stands in one place from `first[k]` up to `last[k]`; nothing where equal."""
        several = last > first
        own = np.arange(len(first))
        window = window_intersection(
            self.standing, np.where(several, first + 1, own), np.where(several, last + 1, own + 1)
        )
        hidden = self.seen.for_each(last)
        return difference(window.of_layers(several), hidden.of_layers(several))

    def savings(self, lowest: Int) -> Float:
        """(n, L) mm of perimeters saved by laying `extra` (row) layers and the one after them (column) as one.

        `lowest` (L,) is where the highest groups that end with each layer begin.
        """
        own = np.arange(len(lowest))
        saved = np.zeros((int((own - lowest).max(initial=0)) + 1, len(own)))
        for extra in range(1, len(saved)):
            fits = own - extra >= lowest
            saved[extra] = extra * self.shared(np.where(fits, own - extra, own), own).area() / (2 * _PEN)
        return saved


def bands_of(inner: Toolpaths, sections: Sections, regions: Regions, width: float) -> Bands:
    """The bands of inner perimeters; what hangs over air anywhere has none.

    Bridges, over air or over sparse infill, need the perimeters on which they end on the layer below: what is next to
    one does not stand on what is under it.

    Args:
        inner: the perimeters.
        sections: of the part.
        regions: what is inside the perimeters.
        width: mm, of a bead.
    """
    n, own = inner.plan.n_layers, np.arange(inner.plan.n_layers)
    xy, start, layer = runs(inner)
    drawn = stroked(xy, start, layer, np.full(len(layer), _PEN), n)
    both = window_intersection(drawn, own - 1, own + 1)
    bridges = offset(regions.bridge.merge(regions.internal_bridge), width)
    above = window_intersection(sections.solid, own + 1, own + 2)
    return Bands(_wide(difference(both, bridges)), difference(drawn, offset(above, -width / 2)))


def common(bands: Bands, groups: Int) -> Pieces:
    """What of the perimeters of each group of layers is worth to be laid together, grown around the perimeters.

    Each piece, on the last layer of its group, holds a stretch of perimeter on every layer of the group.
    """
    own = np.arange(len(groups))
    shared = _wide(bands.shared(np.where(last_layers(groups) == own, groups, own), own))
    pieces = pieces_of(shared)
    rings = np.bincount(pieces.areas.ring_layer, minlength=pieces.count)
    worth = (rings > 1) | (pieces.areas.area() >= 2 * _PEN * _SHORTEST)
    kept = pieces.on_layers(shared.n_layers, np.flatnonzero(worth))
    return pieces_of(offset(kept, 1.5 * _PEN))


def _wide(bands: Areas) -> Areas:
    return offset_open(bands, (2 * _PEN - SAME_PLACE) / 2)
