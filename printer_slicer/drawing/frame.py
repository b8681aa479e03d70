"""Panels and axes of pictures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from printer_slicer.arrays import Float

__all__ = ["Panel", "ZAxis", "marks"]


@dataclass(frozen=True, slots=True)
class Panel:
    """A rectangle of the picture, px."""

    left: float
    right: float
    top: float
    bottom: float

    @property
    def width(self) -> float:
        """Return the width, px."""
        return self.right - self.left

    @property
    def height(self) -> float:
        """Return the height, px."""
        return self.bottom - self.top


@dataclass(frozen=True, slots=True)
class ZAxis:
    """A z axis.

    Attributes:
        floor: px, position of z = 0.
        scale: px per mm.
        total: mm, top of the last layer.
    """

    floor: float
    scale: float
    total: float

    def y(self, z: float) -> float:
        """Return the position of z, mm, in the picture, px."""
        return self.floor - self.scale * z

    def rows(self, z: Float) -> Float:
        """Return the positions of several z, mm, in the picture, px."""
        return self.floor - self.scale * z


def marks(end: float, count: int) -> Float:
    """Return round numbers from 0 to `end` for an axis, at most `count` + 1 of them."""
    raw = end / count
    power = 10.0 ** np.floor(np.log10(raw))
    step = power * min(m for m in (1, 2, 5, 10) if m * power >= raw * (1 - 1e-12))
    return np.asarray(np.arange(int(end / step * (1 + 1e-12)) + 1) * step)
