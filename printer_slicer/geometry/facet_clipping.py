"""Cut facets off at two heights."""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Float
from printer_slicer.geometry.slab_projection import BESIDE
from printer_slicer.geometry.vectors import cross

__all__ = ["clip_facets"]


def clip_facets(triangles: Float, low: float, high: float) -> Float:
    """Return the parts of facets between two heights, as triangles (n, 3, 3), mm.

    Clips of consecutive ranges of heights contain each horizontal facet once. One on a border, within rounding, is in
    the range where its solid is. The clipped surface is open at both heights.

    Args:
        triangles: (F, 3, 3) mm.
        low: mm.
        high: mm.
    """
    z = triangles[:, :, 2]
    least, most = z.min(axis=1), z.max(axis=1)
    is_level, is_crossing = most - least <= BESIDE, (least < high) & (most > low)
    to_second, to_third = (triangles[:, corner, :2] - triangles[:, 0, :2] for corner in (1, 2))
    faces_up = cross(to_second, to_third) > 0
    is_below = np.where(faces_up, least <= high + BESIDE, least < high - BESIDE)
    is_above = np.where(faces_up & (low > 0), least > low + BESIDE, least >= low - BESIDE)
    within = np.where(is_level, is_below & is_above, is_crossing)
    level, rest = triangles[within & is_level], triangles[within & ~is_level]
    mirror = np.array([1.0, 1.0, -1.0])
    return np.concatenate([level, _cut_below(_cut_below(rest, low) * mirror, -high) * mirror])


def _cut_below(triangles: Float, low: float) -> Float:
    """Cut off everything below a height; the orientation of facets is kept."""
    is_above = triangles[:, :, 2] >= low
    count = is_above.sum(axis=1)
    # Turn the corners so that the one that differs from both others is the first.
    odd = np.where(count == 1, is_above.argmax(axis=1), is_above.argmin(axis=1))
    turned = np.take_along_axis(triangles, ((odd[:, None] + np.arange(3)) % 3)[:, :, None], axis=1)
    one, two = (turned[count == number] for number in (1, 2))
    small = np.stack(
        [one[:, 0], _cross(one[:, 0], one[:, 1], low), _cross(one[:, 0], one[:, 2], low)], axis=1
    )
    first, last = (_cross(two[:, 0], two[:, corner], low) for corner in (1, 2))
    halves = [
        np.stack(corners, axis=1) for corners in ((first, two[:, 1], two[:, 2]), (first, two[:, 2], last))
    ]
    cut = np.concatenate([triangles[count == 3], small, *halves])
    return np.asarray(cut[np.ptp(cut[:, :, 2], axis=1) > 0])


def _cross(begin: Float, end: Float, z: float) -> Float:
    """Return the points (n, 3) at a height on lines from `begin` to `end` (n, 3)."""
    share = (z - begin[:, 2]) / np.where(end[:, 2] == begin[:, 2], 1.0, end[:, 2] - begin[:, 2])
    points: Float = begin + share[:, None] * (end - begin)
    points[:, 2] = z
    return points
