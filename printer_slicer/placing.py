"""Mesh + Printer -> Mesh: on the bed, in its middle."""

from __future__ import annotations

import numpy as np

from printer_slicer.errors import PartError
from printer_slicer.model import Mesh
from printer_slicer.profile import Printer

__all__ = ["place"]


def place(mesh: Mesh, printer: Printer) -> Mesh:
    """The part standing on z = 0 in the middle of the bed.

    Raises:
        PartError: the part is larger than the bed or higher than the printer.
    """
    room = np.array([printer.bed_x, printer.bed_y, printer.bed_z])
    low, high = mesh.bounds
    size = high - low
    if (size > room + 1e-6).any():
        raise PartError(
            f"{mesh.name}: {size[0]:.5g} x {size[1]:.5g} x {size[2]:.5g} mm does not fit {printer.name!r}, "
            f"which prints {room[0]:g} x {room[1]:g} x {room[2]:g} mm",
            remedy="choose a larger printer, or scale the part; is it in mm?",
        )
    middle = np.mean(printer.corners, axis=0)
    by = np.array([*(middle - (low + high)[:2] / 2), -low[2]])
    # To a nanometre: where the part was drawn must not decide ties between points that are the same but for rounding.
    return Mesh(np.round(mesh.triangles + by, 6), mesh.name)
