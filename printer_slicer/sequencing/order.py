"""The order in which objects can be printed one after the other, without the print head touching a finished one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from printer_slicer.errors import PartError
from printer_slicer.profile import Printer
from printer_slicer.sequencing.extents import ObjectExtent
from printer_slicer.sequencing.obstacles import (
    Obstacle,
    list_obstacles,
    measure_gantry_height,
    measure_missing_distance,
)

__all__ = ["find_print_order"]

_REMEDY: Final = "Arrange the parts farther apart, or print them layer by layer (print_order = by_layer)"
_REMEDY_FOR_GANTRY: Final = (
    "Put them on separate plates, or print them layer by layer (print_order = by_layer)"
)


def find_print_order(extents: Sequence[ObjectExtent], printer: Printer) -> tuple[int, ...]:
    """Return the indices of objects in an order in which they can be printed, lower objects first.

    Raises:
        PartError: there is no such order; the message names two objects, and how much farther apart they must be.
    """
    obstacles = list_obstacles(extents, printer)
    left, order = set(range(len(extents))), list[int]()
    while left:
        blocked = {one.first for one in obstacles if one.first in left and one.later in left}
        free = sorted(left - blocked, key=lambda index: (extents[index].top, index))
        if not free:
            raise _make_order_error(extents, printer, obstacles, left)
        order.append(free[0])
        left.remove(free[0])
    return tuple(order)


def _make_order_error(
    extents: Sequence[ObjectExtent], printer: Printer, obstacles: Sequence[Obstacle], left: set[int]
) -> PartError:
    """Return an error that describes the obstacle between objects `left` that the shortest distance would remove."""
    within = [one for one in obstacles if one.first in left and one.later in left]
    missing = [measure_missing_distance(extents[one.first], extents[one.later], printer) for one in within]
    at = int(np.argmin([one.distance for one in missing]))
    first, later = (extents[index] for index in within[at])
    text = f"{first.name} and {later.name} cannot be printed one after the other: the head would touch {first.name}"
    distance, axis = missing[at]
    if distance < np.inf:
        where = f" in {axis}" if axis else ""
        reason, remedy = f"; {np.ceil(10 * distance) / 10:g} mm more distance{where} would be enough", _REMEDY
    else:
        room = measure_gantry_height(first, later, printer)
        reason = f" at any distance, because both are higher than the {room:g} mm between nozzle and gantry"
        remedy = _REMEDY_FOR_GANTRY
    return PartError(text + reason, remedy=remedy)
