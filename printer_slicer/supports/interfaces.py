"""Divide columns into closed layers under overhangs and on the part, and the base between them."""

from __future__ import annotations

from typing import Final

import numpy as np

from printer_slicer.geometry import Areas, difference, intersection, offset, offset_open, union

__all__ = ["divide_columns"]

_MIN_WIDTH: Final = 1.4  # mm; in narrower strips, as under slopes, lines of closed layers would be too short

_BEYOND_GROUND: Final = 0.2  # mm; the outermost line of a floor has half its width over the part


def divide_columns(
    columns: Areas, contacts: Areas, ground: Areas, n_interface: int
) -> tuple[Areas, Areas, Areas]:
    """Return the base, the interfaces under contacts, and the floors on the part.

    Args:
        columns: by support layer.
        contacts: the part of each layer that lies under an overhang.
        ground: the part just below each layer; floors hardly reach beyond it.
        n_interface: number of closed layers below each contact. Floors have one layer, if there are interfaces at all.
    """
    none = Areas.empty(columns.n_layers)
    if not n_interface:
        return columns, none, none
    below = contacts
    for step in range(1, n_interface):
        below = union(below, contacts.shift_layers(-step))
    interface = offset_open(intersection(below, columns), _MIN_WIDTH / 2)
    above_bed = columns.of_layers(np.arange(1, columns.n_layers))
    landing = difference(difference(above_bed, columns.shift_layers(1)), interface)
    floor = offset_open(intersection(landing, offset(ground, _BEYOND_GROUND)), _MIN_WIDTH / 2)
    return difference(difference(columns, interface), floor), interface, floor
