"""Ten solids on which the paper's area test fails, as exact meshes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import cos, pi, radians, sin, tan
from typing import Final, NamedTuple

import numpy as np

from printer_slicer.arrays import Float
from printer_slicer.model import Mesh
from tests.parts import case_study, joined, loft, sheared_prism

__all__ = ["SOLIDS", "Solid", "cylinder", "draft", "flange", "hemisphere", "slot", "two_wedges"]

HEIGHT = 20.0  # mm, of most of them


def _square(side: float, at: float = 0.0) -> Float:
    corners: Float = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * side / 2
    return np.asarray(corners + np.array([at, 0.0]))


def _polygon(radius: float, corners: int) -> Float:
    turn = 2 * pi * np.arange(corners) / corners
    return radius * np.column_stack([np.cos(turn), np.sin(turn)])


def two_wedges() -> Mesh:
    """Two blocks side by side with one leaning side each, 1 mm in 2: one grows by as much as the other shrinks."""

    def block(low: float, high: float, x: float) -> Mesh:
        rings = [np.array([(x, 0), (x + width, 0), (x + width, 10), (x, 10)]) for width in (low, high)]
        return Mesh(loft(rings, [0.0, HEIGHT]))

    return joined([block(10, 20, 0), block(20, 10, 30)], "two wedges")


def _stepped(sides: list[float], heights: list[float], name: str) -> Mesh:
    """Square rings one over the other; two at the same height have a flat between them."""
    return Mesh(loft([_square(side) for side in sides], heights), name)


def flange() -> Mesh:
    """A column with a thin rim that lies between two planes of the 0.1 mm grid and over half of a third."""
    return _stepped([10, 10, 14, 14, 10, 10], [0, 10.15, 10.15, 10.35, 10.35, HEIGHT], "flange")


def slot() -> Mesh:
    """A column with a narrow groove all around."""
    return _stepped([10, 10, 6, 6, 10, 10], [0, 10.12, 10.12, 10.37, 10.37, HEIGHT], "slot")


def draft(degrees: float) -> Mesh:
    """A block whose sides lean in by this much from the vertical, as moulds need it."""
    side = 20.0
    return _stepped([side, side - 2 * HEIGHT * tan(radians(degrees))], [0, HEIGHT], f"draft {degrees:g}")


def cylinder(corners: int = 96) -> Mesh:
    """Upright; the area of all sections is the same but for the rounding of its sum."""
    ring = _polygon(10.0, corners)
    return Mesh(loft([ring, ring], [0.0, HEIGHT]), "cylinder")


def hemisphere(parallels: int = 64, corners: int = 64) -> Mesh:
    """Radius 20 mm, standing on its flat side; inscribed, with a corner for a pole."""
    angles = [pi / 2 * i / parallels for i in range(parallels)]
    rings = [_polygon(HEIGHT * cos(angle), corners) for angle in angles]
    body = loft(rings, [HEIGHT * sin(angle) for angle in angles])
    # The flat lid of the loft gives way to a pole.
    lid = (body[:, :, 2] == HEIGHT * sin(angles[-1])).all(axis=1)
    rim = np.column_stack([rings[-1], np.full(corners, HEIGHT * sin(angles[-1]))])
    pole = np.broadcast_to((0.0, 0.0, HEIGHT), rim.shape)
    cap = np.stack([rim, np.roll(rim, -1, axis=0), pole], axis=1)
    return Mesh(np.concatenate([body[~lid], cap]), "hemisphere")


class Solid(NamedTuple):
    """A solid with what the two ways of planning it come to.

    Attributes:
        make: builds it.
        paper: layers of the literal area test with 0.1 and 0.4 mm.
        paper_error: mm, how far the worst of its wrong points is from the surface.
        best: layers of 0.1 to 0.4 mm, at most, that keep 0.05 mm and end on all flats.
    """

    make: Callable[[], Mesh]
    paper: int
    paper_error: float
    best: int


SOLIDS: Final[Mapping[str, Solid]] = {
    "sheared prism": Solid(lambda: sheared_prism(10, HEIGHT, HEIGHT), 51, 0.141, 200),
    "two wedges": Solid(two_wedges, 51, 0.100, 100),
    # 51 layers keep the tolerance on the grid, where the flats are missed; 26 + 1 + 25 end on them.
    "flange": Solid(flange, 52, 0.200, 52),
    "slot": Solid(slot, 52, 0.200, 52),
    "overshoot": Solid(case_study, 375, 0.082, 375),
    "draft 0.5": Solid(lambda: draft(0.5), 200, 0.0005, 50),
    "draft 3": Solid(lambda: draft(3.0), 200, 0.0034, 50),
    "cylinder": Solid(cylinder, 51, 0.100, 50),
    "hemisphere": Solid(hemisphere, 200, 0.050, 141),
}
"""The cylinder stands for two failures: the first thin layer shifts the grid, and rounding makes areas unequal."""
