"""Pairs of connected pieces of neighbouring layers that lie over each other."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from printer_slicer.arrays import Float, Int, concatenate_pairs
from printer_slicer.geometry import ConnectedAreas, intersection, offset
from printer_slicer.geometry.boxes import Boxes

__all__ = ["EDGE", "find_overlaps", "find_touching"]

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
