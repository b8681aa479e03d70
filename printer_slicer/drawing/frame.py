"""Where things stand in a picture: panels, and round numbers along axes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from printer_slicer.arrays import Float

__all__ = ["Panel", "ZAxis", "marks"]


@dataclass(frozen=True, slots=True)
class Panel:
    """A part of the picture, px."""

    left: float
    right: float
    top: float
    bottom: float

    @property
    def width(self) -> float:
        """From left to right, px."""
        return self.right - self.left

    @property
    def height(self) -> float:
        """From top to bottom, px."""
        return self.bottom - self.top


@dataclass(frozen=True, slots=True)
class ZAxis:
    """Height over the bed as height in the picture.

    Attributes:
        floor: px, where z = 0 is.
        scale: px per mm.
        total: mm, where the last layer ends.
    """

    floor: float
    scale: float
    total: float

    def y(self, z: float) -> float:
        """Where z, mm, is in the picture, px."""
        return self.floor - self.scale * z

    def rows(self, z: Float) -> Float:
        """Where many z, mm, are in the picture, px."""
        return self.floor - self.scale * z


def marks(end: float, count: int) -> Float:
    """Round numbers from 0 to `end`, at most `count` + 1 of them."""
    raw = end / count
    power = 10.0 ** np.floor(np.log10(raw))
    step = power * min(m for m in (1, 2, 5, 10) if m * power >= raw * (1 - 1e-12))
    return np.asarray(np.arange(int(end / step * (1 + 1e-12)) + 1) * step)
