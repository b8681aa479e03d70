"""Sides of outlines that meet elsewhere than at their ends, found exactly on whole numbers."""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Float, Int, distinct
from printer_slicer.geometry.boxes import Boxes
from printer_slicer.geometry.vectors import cross, dot

__all__ = ["layers_with_self_intersections"]


def layers_with_self_intersections(ends: Int, layer: Int) -> Int:
    """Layers on which two sides cross, touch, or lie on each other, other than by an end that they share.

    Polygon clipping rounds its corners to a grid: now and then one is rounded onto a side nearby, or across it.

    Args:
        ends: (S, 2, 2) where sides begin and end, whole numbers below 1e9.
        layer: (S,) of each.

    Returns:
        The layers, ascending.
    """
    low, high = (_as_floats(which(ends[:, 0], ends[:, 1])) for which in (np.minimum, np.maximum))
    a, b = Boxes(low, high, layer).neighbours()
    first, second = ends.take(a, axis=0), ends.take(b, axis=0)
    straddled = [
        np.sign(cross(way, other[:, 0] - one[:, 0])) * np.sign(cross(way, other[:, 1] - one[:, 0]))
        for one, other, way in (
            (first, second, first[:, 1] - first[:, 0]),
            (second, first, second[:, 1] - second[:, 0]),
        )
    ]
    meets = (straddled[0] <= 0) & (straddled[1] <= 0)
    for i, j in ((0, 0), (0, 1), (1, 0), (1, 1)):
        shared = (first[:, i] == second[:, j]).all(axis=1)
        one, other = first[:, 1 - i] - first[:, i], second[:, 1 - j] - second[:, j]
        # From a shared end they may go anywhere but the same way.
        meets[shared & ((cross(one, other) != 0) | (dot(_as_floats(one), _as_floats(other)) < 0))] = False
    return distinct(layer[a[meets]])


def _as_floats(values: Int) -> Float:
    return values.astype(np.float64)
