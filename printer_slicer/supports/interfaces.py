"""Divide columns into closed layers under overhangs and on the part, and the base between them."""

from __future__ import annotations

from typing import Final

import numpy as np

from printer_slicer.geometry import Areas, difference, intersection, offset_open, union

__all__ = ["divide_columns"]

_NARROWEST: Final = 1.0  # mm; narrower strips, as under slopes, are not worth closed layers


def divide_columns(columns: Areas, contacts: Areas, n_interface: int) -> tuple[Areas, Areas, Areas]:
    """Return the base, the interfaces under contacts, and the floors on the part.

    Args:
        columns: by support layer.
        contacts: the part of each layer that lies under an overhang.
        n_interface: number of closed layers below each contact. Floors have one layer, if there are interfaces at all.
    """
    none = Areas.empty(columns.n_layers)
    if not n_interface:
        return columns, none, none
    below = contacts
    for step in range(1, n_interface):
        below = union(below, contacts.shift_layers(-step))
    interface = offset_open(intersection(below, columns), _NARROWEST / 2)
    above_bed = columns.of_layers(np.arange(1, columns.n_layers))
    landing = difference(difference(above_bed, columns.shift_layers(1)), interface)
    floor = offset_open(landing, _NARROWEST / 2)
    return difference(difference(columns, interface), floor), interface, floor
