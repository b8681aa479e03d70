"""Panels and axes of pictures."""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Float
from printer_slicer.values import Struct

__all__ = ["Panel", "ZAxis", "choose_axis_marks"]


class Panel(Struct, frozen=True):
    """A rectangle of the picture, px."""

    left: float
    right: float
    top: float
    bottom: float

    @property
    def width(self) -> float:
        """Width, px."""
        return self.right - self.left

    @property
    def height(self) -> float:
        """Height, px."""
        return self.bottom - self.top


class ZAxis(Struct, frozen=True):
    """A vertical axis for z in a picture.

    Attributes:
        floor: px, position of z = 0.
        scale: px per mm.
        total: mm, z of the top of the last layer.
    """

    floor: float
    scale: float
    total: float

    def y(self, z: float) -> float:
        """Convert z, mm, to a position in the picture, px."""
        return self.floor - self.scale * z

    def y_positions(self, z: Float) -> Float:
        """Convert several z, mm, to positions in the picture, px."""
        return self.floor - self.scale * z


def choose_axis_marks(end: float, count: int) -> Float:
    """Choose at most `count` + 1 round numbers from 0 to `end` for the marks of an axis."""
    raw = end / count
    power = 10.0 ** np.floor(np.log10(raw))
    step = power * min(m for m in (1, 2, 5, 10) if m * power >= raw * (1 - 1e-12))
    return np.asarray(np.arange(int(end / step * (1 + 1e-12)) + 1) * step)
