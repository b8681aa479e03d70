"""Find the corners of an outline for mouse ears, at a coarser scale than its points."""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Float, Int
from printer_slicer.geometry.vectors import cross, dot
from printer_slicer.model import Areas

__all__ = ["find_sharp_corners"]

_STEPS_PER_SCALE = 12  # tested positions per `scale`
_SCALES_PER_RING = 6  # on short outlines the scale is their length divided by this


def find_sharp_corners(outlines: Areas, angle_deg: float, scale: float) -> tuple[Float, Int]:
    """Find convex corners of outer rings where the smoothed outline turns by more than 180 - `angle_deg` degrees.

    The angle at a position is that between the chord from `scale` mm before it and the chord to `scale` mm after it,
    along the outline. A corner rounded with a radius of less than about half the scale still counts; a circle turns by
    scale / radius and has corners only if it is small. The corner is the position with the largest turn; there is no
    other within `scale` of it.

    Args:
        outlines: outer rings on any layers.
        angle_deg: widest angle of the solid that counts as a corner.
        scale: mm; on rings shorter than six times that, a sixth of their length.

    Returns:
        (n, 2) points on the rings, in the order of the rings, and (n,) the layer of each.
    """
    found = [
        _find_corners(outlines.ring(i), np.deg2rad(180.0 - angle_deg), scale) for i in range(outlines.n_rings)
    ]
    layer = np.repeat(outlines.ring_layer, [len(some) for some in found])
    return np.concatenate([np.zeros((0, 2)), *found]), layer


def _find_corners(ring: Float, smallest_turn: float, scale: float) -> Float:
    """Return the corners (n, 2) of one ring, where it turns by more than `smallest_turn` radians."""
    side = np.hypot(*(np.roll(ring, -1, axis=0) - ring).T)
    mark = np.append(0.0, np.cumsum(side))
    length = float(mark[-1])
    reach = min(scale, length / _SCALES_PER_RING)
    # Test the corners, and positions between them for rounded corners.
    place = np.unique(np.append(mark[:-1], np.arange(0.0, length, reach / _STEPS_PER_SCALE)))
    here = _points_along(place, ring, mark)
    to, on = here - _points_along(place - reach, ring, mark), _points_along(place + reach, ring, mark) - here
    turn = np.arctan2(cross(to, on), dot(to, on))
    chosen: list[int] = []
    left = turn > smallest_turn
    while left.any():
        corner = int(np.argmax(np.where(left, turn, -np.inf)))
        chosen.append(corner)
        gap = np.abs(place - place[corner])
        left &= np.minimum(gap, length - gap) > reach
    return here[sorted(chosen)]


def _points_along(place: Float, ring: Float, mark: Float) -> Float:
    """Return the points (P, 2) at these distances along a ring, mm; distances may exceed its length."""
    around = np.mod(place, mark[-1])
    closed = np.concatenate([ring, ring[:1]])
    return np.column_stack([np.interp(around, mark, closed[:, axis]) for axis in range(2)])
