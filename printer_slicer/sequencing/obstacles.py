"""Objects that are in the way of the print head while others are printed.

Object B can follow object A if no shape of the head touches A while B is printed. The shape with outline P at height h
above the nozzle touches what A has above z + h within N + P (Minkowski sum), if N are the positions of the nozzle at
height z. N is replaced by its convex hull, so some orders that would just be possible are rejected.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from itertools import combinations
from typing import Final, NamedTuple

import numpy as np

from printer_slicer.arrays import Bool, Float
from printer_slicer.geometry import Areas, convex_hull, intersection, offset
from printer_slicer.profile import Printer
from printer_slicer.sequencing.extents import ObjectExtent
from printer_slicer.values import replace

__all__ = [
    "MissingDistance",
    "Obstacle",
    "list_obstacles",
    "measure_gantry_height",
    "measure_missing_distance",
]

_LONGEST: Final = 500.0  # mm; a shape that reaches farther is a gantry, from which no distance helps
_ACCURACY: Final = 0.05  # mm, of missing distances


class Obstacle(NamedTuple):
    """Object `first` must not be finished before object `later` is printed; both are indices."""

    first: int
    later: int


class _Swept(NamedTuple):
    """What one or several shapes of the head sweep while an object is printed: each area, and what it must not meet."""

    areas: Areas
    above: Areas
    height: Float


def list_obstacles(extents: Sequence[ObjectExtent], printer: Printer) -> list[Obstacle]:
    """Return all pairs of objects of which the first must not be finished before the other is printed."""
    found = []
    for pair in combinations(range(len(extents)), 2):
        for first, later in (pair, pair[::-1]):
            if _find_contacts(_sweep_head(extents[first], extents[later], printer)).any():
                found.append(Obstacle(first, later))
    return found


def _sweep_head(first: ObjectExtent, later: ObjectExtent, printer: Printer) -> _Swept:
    """Return what the head sweeps while `later` is printed, for all shapes that get below the top of `first`."""
    sums, heights, z = list[list[Float]](), list[float](), list[float]()
    for shape in printer.head_shapes:
        outline = convex_hull(np.array(shape.corners)).ring(0)
        for layer, low in enumerate(later.nozzle_level.tolist()):
            if low + shape.height >= first.top - 1e-6:
                break
            sums.append([_sum_convex(later.nozzle.ring(layer), outline)])
            heights.append(shape.height)
            z.append(low + shape.height)
    above = first.above.copy_layers(first.find_levels(np.array(z, np.float64)))
    return _Swept(Areas.from_rings(sums), above, np.array(heights))


def _sum_convex(a: Float, b: Float) -> Float:
    """Return the Minkowski sum of two convex rings (n, 2) that run counter-clockwise: their sides, by direction."""
    sides = (
        np.concatenate([np.roll(ring, -1, axis=0) - ring for ring in (a, b)]) + 0.0
    )  # no -0.0: its angle is -pi
    sides = sides[np.argsort(np.arctan2(sides[:, 1], sides[:, 0]), kind="stable")]
    # The angles begin above -pi, so the first side begins at the corner farthest back, and of those farthest left.
    begin = sum(ring[np.lexsort((-ring[:, 0], ring[:, 1]))[-1]] for ring in (a, b))
    return np.asarray(begin + np.cumsum(sides, axis=0))


def _find_contacts(swept: _Swept, margin: float = 0.0) -> Bool:
    """Return which (n,) swept areas, smaller by a margin in mm, meet what is printed there."""
    areas = offset(swept.areas, -margin) if margin and swept.areas.n_rings else swept.areas
    return intersection(areas, swept.above).used


class MissingDistance(NamedTuple):
    """By how much two objects must be farther apart, mm (inf: no distance helps), in `x`, `y` or any axis (empty)."""

    distance: float
    axis: str


def measure_missing_distance(first: ObjectExtent, later: ObjectExtent, printer: Printer) -> MissingDistance:
    """Return by how much an object must be farther from `first` to be printed after it.

    If a bar is in the way, distance along the bar does not help, so the direction is across it.
    """
    swept = _sweep_head(first, later, printer)
    if _find_contacts(swept, _LONGEST).any():
        return MissingDistance(np.inf, "")
    low, high = swept.areas.boxes()
    along = ((high - low)[_find_contacts(swept)] > 2 * _LONGEST).any(axis=0)
    if not along.any():
        return MissingDistance(_bisect(lambda margin: bool(_find_contacts(swept, margin).any())), "")
    across = np.where(along, 0.0, 1.0)
    moves = [_bisect(partial(_touches_after_move, swept, way)) for way in (across, -across)]
    return MissingDistance(min(moves), "xy"[int(across.argmax())])


def _touches_after_move(swept: _Swept, direction: Float, distance: float) -> bool:
    """Return whether swept areas meet what is printed after they are moved by a distance, mm, along a vector (2,)."""
    moved = replace(swept.areas, xy=swept.areas.xy + distance * direction)
    return bool(_find_contacts(swept._replace(areas=moved)).any())


def _bisect(touches: Callable[[float], bool]) -> float:
    """Return the smallest distance at which nothing is touched, mm."""
    low, high = 0.0, _LONGEST
    while high - low > _ACCURACY:
        middle = (low + high) / 2
        low, high = (middle, high) if touches(middle) else (low, middle)
    return high


def measure_gantry_height(first: ObjectExtent, later: ObjectExtent, printer: Printer) -> float:
    """Return the height above the nozzle of the lowest shape that touches `first` at any distance, mm."""
    swept = _sweep_head(first, later, printer)
    return float(swept.height[_find_contacts(swept, _LONGEST)].min())
