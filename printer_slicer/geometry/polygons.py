"""What every engine does with the areas of a stack, and the numbers they have to agree on."""

from __future__ import annotations

from typing import Any, Final, Literal, Protocol

from printer_slicer.arrays import Float, Int
from printer_slicer.geometry.areas import Areas

__all__ = [
    "CLEARANCE",
    "MITER_LIMIT",
    "ROUND_TOLERANCE",
    "STEPS_PER_MM",
    "Join",
    "Layer",
    "Operation",
    "Polygons",
]

Join = Literal["miter", "round"]
Operation = Literal["union", "difference", "intersection"]
Layer = Any
"""The area of one layer in an engine's own form."""

STEPS_PER_MM: Final = 100_000
"""The grid to which areas are rounded: 0.01 µm, and still 10^13 mm wide in 64 bits."""

MITER_LIMIT: Final = 2.01
"""Corners with a point farther away than this many distances are cut off square: those sharper than 60°.

A little over 2, the value for 60°, so that rounding does not decide over the corners of equilateral
triangles.
"""

ROUND_TOLERANCE: Final = 0.005
"""How far the chords of a round join may be from the circle, mm."""


CLEARANCE: Final = 1e-4
"""mm by which an opened outline is grown more than it was shrunk.

Ten steps of the grid: it passes clear outside the outline it came from, so that their intersection keeps the points of
the original instead of crossing it at every rounding.
"""


class Polygons(Protocol):
    """What an engine does.

    It keeps the layers in its own form from `load` to `store`, so that one step can follow another without
    rounding and converting in between.
    """

    def load(self, areas: Areas) -> list[Layer]:
        """One value per layer, from clean areas."""

    def load_any(self, areas: Areas) -> list[Layer]:
        """One value per layer, from any rings: what they wind around more often left than right."""

    def store(self, layers: list[Layer]) -> Areas:
        """Clean areas from one value per layer."""

    def combine(self, operation: Operation, a: list[Layer], b: list[Layer]) -> list[Layer]:
        """Union, difference or intersection, entry by entry."""

    def outlines_within(self, outlines: Areas, layers: list[Layer]) -> list[list[Float]]:
        """For each layer the parts of the rings of `outlines` that lie within it: open lines (n, 2), mm."""

    def offset(self, layers: list[Layer], distance: Float, join: Join) -> list[Layer]:
        """Each entry with its outlines moved outward by its distance, mm."""

    def opened(self, layers: list[Layer], distance: Float, limit: float) -> list[Layer]:
        """Each entry shrunk and grown again by its distance, mm, and what lies within the entry of that.

        Corners with a point farther away than `limit` distances are cut off.
        """

    def stroke(self, xy: Float, start: Int, layer: Int, radius: Float, n_layers: int) -> list[Layer]:
        """One value per layer: what is within its radius of any of its open polylines."""
