"""Remove points of rings that do not change their shape."""

from __future__ import annotations

from typing import Final

import numpy as np

from printer_slicer.arrays import Bool
from printer_slicer.geometry.areas import Areas

__all__ = ["remove_collinear"]

# Two directions count as equal if their cross product (a small angle, radians) is below this. Coordinates of 300 mm
# are exact to 6e-14 mm, so the direction of a side of some tenths of a mm is exact to about this angle.
STRAIGHT: Final = 1e-12


def remove_collinear(areas: Areas) -> Areas:
    """Remove repeated points and points on the straight line between their neighbours."""
    while True:
        keep = _is_corner(areas)
        if keep.all():
            return areas
        areas = areas.of_points(keep)


def _is_corner(areas: Areas) -> Bool:
    """Return a mask (N,) of points that do not repeat the previous one; if none does, of points where rings turn."""
    following, previous = areas.following, areas.previous
    x, y = np.ascontiguousarray(areas.xy.T)
    ahead_x, ahead_y = x.take(following) - x, y.take(following) - y
    length = ahead_x**2 + ahead_y**2
    if not length.all():
        return np.asarray(length[previous] > 0)
    cross = ahead_x[previous] * ahead_y - ahead_y[previous] * ahead_x
    return np.asarray(cross**2 > STRAIGHT**2 * length * length[previous])
