"""Find islands, which begin in the air, and tails, which are attached to the part below by a dot only.

A piece of a section stands if it overlaps a standing piece of the section below; on the first layer all pieces stand. A
body that does not stand ends where one of its pieces overlaps a standing one.
"""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Bool, Float, Int
from printer_slicer.geometry import (
    Areas,
    ConnectedAreas,
    difference,
    intersection,
    offset,
    split_connected,
)
from printer_slicer.supports.pieces import EDGE, find_overlaps

__all__ = ["find_islands"]

_ATTACHED = 0.1  # share of a piece that lies over the part below; tails have less
_AT_ONCE = 8  # layers through which bodies are followed at once
_LARGEST_TAIL = 100  # squared extrusion widths; more than a tail cannot hang unnoticed


def find_islands(solid: Areas, below: Areas, around: Areas, air: Float, width: float) -> Areas:
    """Return the lowest piece of each body that stands on nothing, and what hangs of tails.

    A piece that begins within a step beside the section below, and joins the part in the next layer, continues a slope.
    It is left out.

    Args:
        solid: section of each layer.
        below: section below each layer.
        around: `below`, grown by the step of slopes.
        air: (L,) area of each section outside the section below, mm².
        width: mm, extrusion width; a tail is attached to the part below by less than two of them.
    """
    pieces = split_connected(solid)
    size = pieces.areas.area()
    chosen = np.flatnonzero((pieces.layer > 0) & (air[pieces.layer] >= (1 - _ATTACHED) * size))
    some = pieces.take(chosen)
    rest = intersection(some.areas, some.select_nearby_rings(below))
    shared = rest.area()
    begins = shared <= EDGE * some.areas.length()
    slim = ~offset(rest, -width).used & (size[chosen] <= _LARGEST_TAIL * width**2)
    tails = ~begins & slim & (shared < _ATTACHED * size[chosen])
    beyond = difference(some.areas, some.select_nearby_rings(around)).used
    stands, ends = (mask[chosen] for mask in _follow_bodies(pieces, chosen[begins]))
    found = np.flatnonzero((begins & (beyond | ~ends)) | (tails & beyond & stands))
    lowest = some.take(found)
    return difference(lowest.on_layers(solid.n_layers, np.arange(len(found))), below)


def _follow_bodies(pieces: ConnectedAreas, begins: Int) -> tuple[Bool, Bool]:
    """Return two masks (P,): of the pieces that stand, and of those with a piece directly above that stands.

    Args:
        pieces: pieces of all sections.
        begins: the pieces above the first layer that overlap nothing below, ascending.
    """
    stands, ends = [True] * pieces.count, np.zeros(pieces.count, np.bool_)
    for piece in begins.tolist():
        stands[piece] = False
    first = 0
    while first < len(begins):
        low = int(pieces.layer[begins[first]])
        hangs = True
        while hangs:
            high = low + _AT_ONCE
            lower, upper = _find_pairs(pieces, low, high)
            for piece in set(upper.tolist()):
                stands[piece] = False
            for one, other in zip(lower.tolist(), upper.tolist(), strict=True):  # upwards
                stands[other] = stands[other] or stands[one]
            ends[lower[np.array(stands)[upper]]] = True
            at_end = np.flatnonzero(pieces.layer == high)
            hangs = not all(stands[piece] for piece in at_end.tolist())
            low = high
        first = int(np.searchsorted(pieces.layer[begins], low))
    return np.array(stands, np.bool_), ends


def _find_pairs(pieces: ConnectedAreas, low: int, high: int) -> tuple[Int, Int]:
    """Return the pairs of pieces (n,) that overlap, the lower one from layer `low` and the upper one up to `high`."""
    some = np.flatnonzero((pieces.layer >= low) & (pieces.layer <= high))
    lower, upper = find_overlaps(pieces.take(some), pieces.take(some))
    return some[lower], some[upper]
