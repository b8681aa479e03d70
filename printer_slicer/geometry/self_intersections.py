"""Find outlines whose sides intersect other than at their ends, exactly, in integer arithmetic."""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Float, Int, distinct
from printer_slicer.geometry.boxes import Boxes
from printer_slicer.geometry.vectors import cross, dot

__all__ = ["find_layers_with_self_intersections"]


def find_layers_with_self_intersections(ends: Int, layer: Int) -> Int:
    """Find layers on which two sides cross, touch or overlap, except at an end that they share.

    Polygon clipping rounds corners to a grid, and occasionally moves one onto a nearby side, or across it.

    Args:
        ends: (S, 2, 2) start and end points of the sides, integers below 1e9.
        layer: (S,) layer of each side.

    Returns:
        The layers, ascending.
    """
    low, high = (_as_floats(which(ends[:, 0], ends[:, 1])) for which in (np.minimum, np.maximum))
    a, b = Boxes(low, high, layer).find_neighbours()
    first, second = ends.take(a, axis=0), ends.take(b, axis=0)
    straddled = [
        np.sign(cross(direction, other[:, 0] - one[:, 0]))
        * np.sign(cross(direction, other[:, 1] - one[:, 0]))
        for one, other, direction in (
            (first, second, first[:, 1] - first[:, 0]),
            (second, first, second[:, 1] - second[:, 0]),
        )
    ]
    meets = (straddled[0] <= 0) & (straddled[1] <= 0)
    for i, j in ((0, 0), (0, 1), (1, 0), (1, 1)):
        shared = (first[:, i] == second[:, j]).all(axis=1)
        one, other = first[:, 1 - i] - first[:, i], second[:, 1 - j] - second[:, j]
        # Sides with a shared end intersect only if they leave it in the same direction.
        meets[shared & ((cross(one, other) != 0) | (dot(_as_floats(one), _as_floats(other)) < 0))] = False
    return distinct(layer[a[meets]])


def _as_floats(values: Int) -> Float:
    return values.astype(np.float64)
