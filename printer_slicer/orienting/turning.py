"""Rotations that turn a direction of a part down to the bed."""

from __future__ import annotations

from typing import Final

import numpy as np

from printer_slicer.arrays import Float
from printer_slicer.geometry import convex_hull
from printer_slicer.geometry.raster import Float32
from printer_slicer.geometry.vectors import cosine_and_sine, norm
from printer_slicer.model import Mesh
from printer_slicer.orienting.part_shape import PartShape
from printer_slicer.orienting.stability import make_frame
from printer_slicer.placing import transform

__all__ = ["find_angles", "find_upright_frame", "turn_for_infill", "turn_mesh"]

_DIGITS: Final = 6  # of angles in degrees; 0.000 002 mm at a distance of 100 mm
_SAME: Final = 1e-6  # relative to the size; smaller differences are rounding errors
_TURNS: Final = (
    0.0,
    45.0,
    15.0,
    30.0,
    60.0,
    75.0,
)  # degrees; of turns that are about as good, the first is taken
_SAME_ENDS: Final = 0.01  # share of the ends of infill lines; turns that differ by less are about as good


def find_upright_frame(shape: PartShape, down: Float) -> Float:
    """Return the axes x, y and z (3, 3) of the turned part as rows, in the axes of a part.

    The part lies in the smallest rectangle seen from above, whose longer side is along x. Its centre of mass is left of
    the middle, or if it is in the middle, in front of it.

    Args:
        shape: the part.
        down: (3,) unit vector that points down to the bed.
    """
    flat = make_frame(down)[:2]
    outline = convex_hull(shape.hull @ flat.T).xy
    along = _find_longest_side(outline) if len(outline) else np.array([1.0, 0.0])
    x = along @ flat
    frame = np.stack([x, np.cross(-down, x), -down])
    low, high = (shape.hull @ frame.T).min(axis=0), (shape.hull @ frame.T).max(axis=0)
    offset = frame @ shape.center - (low + high) / 2
    slack = _SAME * float((high - low).max())
    is_behind = offset[0] > slack or (abs(offset[0]) <= slack and offset[1] > slack)
    frame[:2] *= -1.0 if is_behind else 1.0
    return frame


def turn_for_infill(shape: PartShape, frame: Float, infill_angle: float) -> Float:
    """Return the rows of `frame` (3, 3) turned about z by up to 75 degrees, so that infill lines have the fewest ends.

    The printer slows down at each end. A wall interrupts the more lines, the more squarely it stands to them.

    Args:
        shape: the part.
        frame: axes of the turned part in the axes of the shape.
        infill_angle: direction of the lines, degrees; those of every other layer are perpendicular.
    """
    walls = (frame[:2].astype(np.float32) @ shape.coarse.normals) * shape.coarse.area
    ends = np.array([_count_ends(walls, infill_angle - turn) for turn in _TURNS])
    c, s = cosine_and_sine(_TURNS[int((ends <= (1 + _SAME_ENDS) * ends.min()).argmax())])
    x, y, z = frame
    return np.stack([c * x - s * y, s * x + c * y, z])


def _count_ends(walls: Float32, angle: float) -> float:
    """Return a measure of the ends of lines in a direction, degrees, and perpendicular to it, between walls (2, n)."""
    c, s = cosine_and_sine(angle)
    along, across = (np.float32(a) * walls[0] + np.float32(b) * walls[1] for a, b in ((c, s), (-s, c)))
    return float(np.abs(along).sum(dtype=np.float64) + np.abs(across).sum(dtype=np.float64))


def _find_longest_side(outline: Float) -> Float:
    """Return the direction (2,) of the longer side of the smallest rectangle around a convex outline (n, 2)."""
    edges = np.roll(outline, -1, axis=0) - outline
    sides = edges / np.maximum(norm(edges), 1e-300)[:, None]
    sizes = np.stack(
        [np.ptp(outline @ sides.T, axis=0), np.ptp(outline @ np.stack([-sides[:, 1], sides[:, 0]]), axis=0)]
    )
    area = sizes.prod(axis=0)
    best = int((area <= area.min() * (1 + _SAME)).argmax())
    x, y = sides[best]
    return np.array([x, y]) if sizes[0, best] >= sizes[1, best] * (1 - _SAME) else np.array([-y, x])


def find_angles(rotation: Float) -> tuple[float, float, float]:
    """Return the angles of a rotation matrix (3, 3) about the fixed axes x, y and z, degrees, for `transform`."""
    y = np.arcsin(np.clip(-rotation[2, 0], -1.0, 1.0))
    if abs(rotation[2, 0]) < 1 - 1e-12:
        x, z = np.arctan2(rotation[2, 1], rotation[2, 2]), np.arctan2(rotation[1, 0], rotation[0, 0])
    else:  # x and z turn about the same axis, so z may be 0
        x, z = np.arctan2(-rotation[1, 2], rotation[1, 1]), 0.0
    angles = np.round(np.degrees([x, y, z]), _DIGITS) + 0.0
    rx, ry, rz = np.where(angles == -180.0, 180.0, angles).tolist()
    return rx, ry, rz


def turn_mesh(mesh: Mesh, rotate: tuple[float, float, float]) -> Mesh:
    """Rotate a part, and set it on z = 0 with the middle of its bounding box above the same place as before."""
    if not any(rotate):
        return mesh
    turned = transform(mesh, rotate=rotate)
    shift = (mesh.bounds.mean(axis=0) - turned.bounds.mean(axis=0))[:2]
    return turned.moved((*shift.tolist(), -float(turned.bounds[0, 2])))
