"""Find islands, which have nothing below them, and tails, which are attached to the part below at a small spot.

A piece of a section stands if it overlaps a standing piece of the section below; on the first layer all pieces stand. A
body that does not stand ends where one of its pieces overlaps a standing one.
"""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Bool, Int
from printer_slicer.geometry import (
    Areas,
    ConnectedAreas,
    difference,
    fits_circle,
    intersection,
    split_connected,
)
from printer_slicer.supports.pieces import EDGE, find_overlaps

__all__ = ["find_islands"]

_MIN_ATTACHED = 0.1  # share of a piece that lies over the part below; tails have less
_AT_ONCE = 8  # layers through which bodies are followed at once
_MAX_TAIL_AREA = 100  # squared extrusion widths; more than a tail cannot hang unnoticed


def find_islands(solid: Areas, below: Areas, air: Areas, around: Areas, width: float) -> Areas:
    """Return the lowest piece of each body that stands on nothing, and the overhangs of tails.

    A piece that lies within a step beside the section below continues a slope. It is left out.

    Args:
        solid: section of each layer.
        below: section below each layer.
        air: part of each section outside the section below, on layers where something is outside `around`.
        around: `below`, grown by the step of slopes.
        width: mm, extrusion width; a tail is attached to the part below by less than two of them.
    """
    all_pieces = split_connected(solid.of_layers(air.used))
    chosen = np.flatnonzero(air.area()[all_pieces.layer] >= (1 - _MIN_ATTACHED) * all_pieces.areas.area())
    pieces = all_pieces.take(chosen)
    pieces = pieces.take(np.flatnonzero(difference(pieces.areas, pieces.select_nearby_rings(around)).used))
    rest = intersection(pieces.areas, pieces.select_nearby_rings(below))
    shared, size = rest.area(), pieces.areas.area()
    begins = shared <= EDGE * pieces.areas.length()
    slim = ~fits_circle(rest, width) & (size <= _MAX_TAIL_AREA * width**2)
    tails = ~begins & slim & (shared < _MIN_ATTACHED * size)
    if tails.any() and begins.any():
        tails &= ~_find_carried(solid, pieces, begins)
    islands = pieces.on_layers(solid.n_layers, np.flatnonzero(begins | tails))
    return difference(islands, below)


def _find_carried(solid: Areas, chosen: ConnectedAreas, begins: Bool) -> Bool:
    """Return a mask (P,) of the chosen pieces that belong to a body that has nothing below it.

    Args:
        solid: section of each layer.
        chosen: P pieces of the sections.
        begins: (P,) whether a piece overlaps nothing below.
    """
    pieces = split_connected(solid)
    where = _match(pieces, chosen)
    stands = _mark_standing(pieces, where[begins])
    return ~stands[where]


def _match(pieces: ConnectedAreas, chosen: ConnectedAreas) -> Int:
    """Return the index of each of some chosen pieces (n,) among all pieces."""
    own, other = find_overlaps(chosen, pieces, (0,))
    where = np.zeros(chosen.count, np.int64)
    where[own] = other
    return where


def _mark_standing(pieces: ConnectedAreas, begins: Int) -> Bool:
    """Return a mask (P,) of the pieces that stand.

    Args:
        pieces: pieces of all sections.
        begins: the pieces above the first layer that overlap nothing below, ascending.
    """
    stands = [True] * pieces.count
    for piece in begins.tolist():
        stands[piece] = False
    first = 0
    while first < len(begins):
        low, hangs = int(pieces.layer[begins[first]]), True
        while hangs:
            high = low + _AT_ONCE
            lower, upper = _find_pairs(pieces, low, high)
            for piece in upper.tolist():
                stands[piece] = False
            for one, other in zip(lower.tolist(), upper.tolist(), strict=True):  # upwards
                stands[other] = stands[other] or stands[one]
            hangs = not all(stands[piece] for piece in np.flatnonzero(pieces.layer == high).tolist())
            low = high
        first = int(np.searchsorted(pieces.layer[begins], low))
    return np.array(stands, np.bool_)


def _find_pairs(pieces: ConnectedAreas, low: int, high: int) -> tuple[Int, Int]:
    """Return the pairs of pieces (n,) that overlap, the lower one from layer `low` and the upper one up to `high`."""
    some = np.flatnonzero((pieces.layer >= low) & (pieces.layer <= high))
    lower, upper = find_overlaps(pieces.take(some), pieces.take(some))
    return some[lower], some[upper]
