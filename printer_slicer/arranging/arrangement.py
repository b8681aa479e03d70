"""The free area of a plate, and the places of parts on plates."""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Float, Int, frozen_array
from printer_slicer.geometry import Areas
from printer_slicer.values import Struct, force_setattr

__all__ = ["Arrangement", "FreeArea"]


class FreeArea(Struct, frozen=True, eq=False):
    """The part of a bed on which parts may stand.

    Attributes:
        low, high: (2,) corners of the rectangle, mm.
        excluded: one layer of areas in which nothing may stand, for example below clips; mm.
    """

    low: Float
    high: Float
    excluded: Areas

    def __post_init__(self) -> None:
        for name in ("low", "high"):
            force_setattr(self, name, frozen_array(getattr(self, name), np.float64, (2,)))

    @property
    def size(self) -> Float:
        """Return the size (2,) of the rectangle, mm."""
        return np.asarray(self.high - self.low)


class Arrangement(Struct, frozen=True, eq=False):
    """Where each of P parts stands: rotated about the origin of its file, then shifted.

    Attributes:
        plate: (P,) number of the plate, from 0.
        angle: (P,) degrees about z, counter-clockwise.
        shift: (P, 2) mm.
    """

    plate: Int
    angle: Float
    shift: Float

    def __post_init__(self) -> None:
        force_setattr(self, "plate", frozen_array(self.plate, np.int64, (-1,)))
        force_setattr(self, "angle", frozen_array(self.angle, np.float64, (len(self.plate),)))
        force_setattr(self, "shift", frozen_array(self.shift, np.float64, (len(self.plate), 2)))

    @property
    def n_plates(self) -> int:
        """Number of plates."""
        return int(self.plate.max(initial=-1)) + 1
