"""The exact distances between parts that are seen from above."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from printer_slicer.arrays import Float
from printer_slicer.geometry import Areas, intersection
from printer_slicer.geometry.segment_index import OutlineIndex

__all__ = ["find_smallest_distance"]


def find_smallest_distance(outlines: Sequence[Areas], reach: float) -> float:
    """Return the smallest distance between any two of the areas, mm; at most `reach`; 0 if two overlap.

    Args:
        outlines: one layer each, clean areas.
        reach: mm; pairs with boxes farther apart are not measured.
    """
    boxes = [(low[0], high[0]) for low, high in (one.boxes() for one in outlines)]
    smallest = reach
    for a, b in combinations(range(len(outlines)), 2):
        if _box_distance(boxes[a], boxes[b]) < smallest:
            smallest = min(smallest, _measure_distance(outlines[a], outlines[b]))
    return smallest


def _box_distance(one: tuple[Float, Float], other: tuple[Float, Float]) -> float:
    """Return the distance between two boxes, mm."""
    apart = np.maximum(np.maximum(one[0] - other[1], other[0] - one[1]), 0.0)
    return float(np.hypot(*apart))


def _measure_distance(a: Areas, b: Areas) -> float:
    """Return the distance between two areas, mm; the nearest points of disjoint areas include a corner of one."""
    if intersection(a, b).n_rings:
        return 0.0
    first, second = (_measure_corners(one, other) for one, other in ((a, b), (b, a)))
    return min(first, second)


def _measure_corners(areas: Areas, other: Areas) -> float:
    """Return the smallest distance from the corners of areas to the outlines of another, mm."""
    low, high = areas.boxes()
    distance = OutlineIndex(other, low[0], high[0]).distance(areas.xy, np.zeros(len(areas.xy), np.int64))
    return float(distance.min())
