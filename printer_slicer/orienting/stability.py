"""Whether a part stands safely on the bed."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from printer_slicer.arrays import Bool, Float, Int
from printer_slicer.geometry import convex_hull
from printer_slicer.geometry.vectors import dot, norm
from printer_slicer.orienting.part_shape import PartShape

__all__ = ["Standing", "is_stable", "make_frame", "may_stand", "measure_standing"]

_CONTACT_HEIGHT: Final = 0.15  # mm; the contact area is the section of the convex hull at this height
_MIN_TILT: Final = 4.0  # degrees
_N_CHECKS: Final = 8  # directions in which the contact area is compared with the centre of mass at first
_SLIMNESS: Final = 12.0  # the contact area of a part this many times as high as wide is too small


class Standing(NamedTuple):
    """How a part stands.

    Attributes:
        contact_area: area of the convex hull of the part just above the bed, mm².
        tilt_deg: how far the part can be tilted before it falls over, degrees; negative: it falls over at once.
        is_stable: whether that is far enough, and the contact area is large enough for the height.
    """

    contact_area: float
    tilt_deg: float
    is_stable: bool


def may_stand(shape: PartShape, down: Float, brim: float) -> Bool:
    """Return a mask (D,) of the directions (D, 3) in which a part may stand safely; no other direction is stable.

    The contact area is compared with the centre of mass in some directions, for all at once.

    Args:
        shape: the part.
        down: unit vectors that point down.
        brim: width of a brim, mm.
    """
    corners = shape.hull - shape.center
    depth = down @ corners.T
    lowest = depth.max(axis=1)
    begin, end = _list_edges(shape.hull_facets)
    is_low = depth > (lowest - _CONTACT_HEIGHT)[:, None]
    row, edge = np.nonzero(is_low[:, begin] != is_low[:, end])
    begin, end = begin[edge], end[edge]
    share = (depth[row, begin] - lowest[row] + _CONTACT_HEIGHT) / (depth[row, begin] - depth[row, end])
    places = corners[begin] + share[:, None] * (corners[end] - corners[begin])
    frames = make_frame(down)
    along, across = (dot(places, frames[row, axis]) for axis in (0, 1))
    may = np.zeros(len(down), np.bool_)
    first = np.flatnonzero(np.diff(row, prepend=-1))
    may[row[first]] = True
    least = np.maximum(np.tan(np.radians(_MIN_TILT)) * lowest - brim, 0.0)[row[first]]
    for angle in np.linspace(0, 2 * np.pi, _N_CHECKS, endpoint=False).tolist():
        reach = (
            np.maximum.reduceat(np.cos(angle) * along + np.sin(angle) * across, first)
            if len(first)
            else least
        )
        may[row[first]] &= reach >= least
    return may


def _list_edges(facets: Int) -> tuple[Int, Int]:
    """Return both ends (E,) of the edges of a closed shape with facets (F, 3), each edge once."""
    begin, end = facets.ravel(), np.roll(facets, -1, axis=1).ravel()
    once = begin < end
    return begin[once], end[once]


def is_stable(shape: PartShape, down: Float, brim: float) -> bool:
    """Return whether a part stands safely with the direction `down` (3,) down and a brim of this width, mm."""
    frame = make_frame(down)
    return measure_standing(shape, frame, brim).is_stable


def make_frame(down: Float) -> Float:
    """Return any axes x, y, z (..., 3, 3) as rows, of which z points up, from directions (..., 3) that point down."""
    across = np.cross(np.eye(3)[np.abs(down).argmin(axis=-1)], down)
    across /= norm(across)[..., None]
    return np.stack([across, np.cross(-down, across), -down], axis=-2)


def measure_standing(shape: PartShape, frame: Float, brim: float) -> Standing:
    """Measure how a part stands that is turned so that the rows of `frame` (3, 3) are its axes x, y and z.

    Args:
        shape: the part.
        frame: axes of the turned part in the axes of the shape.
        brim: width of a brim, which makes the contact area larger, mm.
    """
    corners, center = shape.hull @ frame.T, frame @ shape.center
    lowest, height = float(corners[:, 2].min()), float(np.ptp(corners[:, 2]))
    begin, end = (corners[index] for index in _list_edges(shape.hull_facets))
    level = lowest + _CONTACT_HEIGHT
    crosses = (begin[:, 2] < level) != (end[:, 2] < level)
    begin, end = begin[crosses], end[crosses]
    share = (level - begin[:, 2]) / (end[:, 2] - begin[:, 2])
    hull = convex_hull((begin + share[:, None] * (end - begin))[:, :2])
    ring = hull.xy
    if not len(ring):
        return Standing(0.0, -90.0, False)
    edges = np.roll(ring, -1, axis=0) - ring
    outward = np.stack([edges[:, 1], -edges[:, 0]], axis=1) / norm(edges)[:, None]
    distance = float(((ring - center[:2]) * outward).sum(axis=1).min())
    tilt = float(np.degrees(np.arctan2(distance + brim, max(float(center[2] - lowest), 1e-9))))
    area = float(hull.area().sum())
    with_brim = area + brim * float(norm(edges).sum())
    return Standing(area, tilt, distance > 0 and tilt > _MIN_TILT and with_brim > (height / _SLIMNESS) ** 2)
