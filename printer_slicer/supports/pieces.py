"""Pairs of connected pieces of neighbouring layers that lie over each other, and the union of layers."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from printer_slicer.arrays import Float, Int, concatenate_pairs, distinct
from printer_slicer.geometry import Areas, ConnectedAreas, intersection, normalize, offset
from printer_slicer.geometry.boxes import Boxes

__all__ = ["EDGE", "find_overlaps", "find_touching", "unite_layers"]

EDGE = 1e-4  # mm; areas that overlap by narrower strips only have an edge in common


def find_overlaps(
    lower: ConnectedAreas, upper: ConnectedAreas, rises: Sequence[int] = (1,)
) -> tuple[Int, Int]:
    """Return pairs of pieces (own, other), each (n,), that overlap, seen from above.

    Args:
        lower: pieces.
        upper: pieces; those some layers above a piece of `lower` are tested.
        rises: numbers of layers.

    Returns:
        Indices in `lower`, ascending, and in `upper`.
    """
    low, high = lower.areas.boxes()
    others = Boxes(*upper.areas.boxes(), upper.layer)
    own, other = concatenate_pairs(
        Boxes(low, high, lower.layer + rise).find_overlapping(others) for rise in rises
    )
    order = np.lexsort((other, own))
    own, other = own[order], other[order]
    shared = intersection(lower.areas.copy_layers(own), upper.areas.copy_layers(other)).area()
    least = EDGE * np.minimum(lower.areas.length()[own], upper.areas.length()[other])
    found = np.flatnonzero(shared > least)
    return own[found], other[found]


def find_touching(
    pieces: ConnectedAreas, others: ConnectedAreas, reach: Float, rises: Sequence[int]
) -> tuple[Int, Int]:
    """Return pairs (piece, other), each (n,), that touch, seen from above.

    Args:
        pieces: P pieces.
        others: other pieces, or the same ones.
        reach: (P,) mm; pieces this close to each other touch.
        rises: numbers of layers by which the other piece may lie higher.
    """
    around = ConnectedAreas(offset(pieces.areas, reach), pieces.layer, pieces.of_ring)
    return find_overlaps(around, others, rises)


def unite_layers(areas: Areas) -> Areas:
    """Return the union of all layers as a stack of one layer."""
    used = distinct(areas.ring_layer)
    areas = areas.copy_layers(used)
    while areas.n_layers > 1:  # in pairs, so that few rings overlap in each step
        half = np.arange(areas.n_layers) // 2
        areas = normalize(areas.on_layers(half, int(half[-1]) + 1))
    return areas if areas.n_layers else Areas.empty(1)
