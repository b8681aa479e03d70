"""Protocol of the geometry engines, and the constants that they share."""

from __future__ import annotations

from typing import Any, Final, Literal, Protocol

import numpy as np

from printer_slicer.arrays import Float, Int
from printer_slicer.geometry.areas import Areas

__all__ = [
    "CLEARANCE",
    "MITER_LIMIT",
    "ROUND_TOLERANCE",
    "STEPS_PER_MM",
    "Join",
    "Layers",
    "OpenLines",
    "Operation",
    "Polygons",
    "gather_lines",
]

Join = Literal["miter", "round"]
Operation = Literal["union", "difference", "intersection"]
Layers = Any
"""The areas of all layers in the internal format of an engine."""

OpenLines = tuple[Float, Int, Int]
"""Points (N, 2) in mm of open lines, the number of points (M,) and the layer (M,) of each."""

STEPS_PER_MM: Final = 100_000
"""Grid to which areas are rounded: 0.01 µm; 64 bits still cover 10^13 mm."""

MITER_LIMIT: Final = 2.01
"""Corners with a point farther away than this many distances are cut off square: those sharper than 60°.

Slightly over 2, the value for 60°, so that the result for equilateral triangles does not depend on rounding.
"""

ROUND_TOLERANCE: Final = 0.005
"""Largest deviation of the chords of a round join from the circle, mm."""


CLEARANCE: Final = 1e-4
"""mm by which an opened outline is grown more than it was shrunk.

With these ten grid steps it lies clearly outside the original outline. So their intersection keeps the points of the
original, without crossings caused by rounding.
"""


class Polygons(Protocol):
    """Operations of a geometry engine.

    An engine keeps layers in its own format from `load` to `store`, so that steps can follow each other without
    rounding and conversion.
    """

    def load(self, areas: Areas) -> Layers:
        """Convert clean areas to the format of the engine."""

    def load_any(self, areas: Areas) -> Layers:
        """Convert any rings to areas in the format of the engine: everything with a positive winding number."""

    def store(self, layers: Layers) -> Areas:
        """Convert layers to clean areas."""

    def take(self, layers: Layers, indices: Int) -> Layers:
        """Return the layers with these indices (n,), in this order."""

    def concatenate(self, layers: Layers, others: Layers) -> Layers:
        """Return the layers followed by the others."""

    def combine(self, operation: Operation, a: Layers, b: Layers) -> Layers:
        """Return the union, difference or intersection, layer by layer."""

    def outlines_within(self, outlines: Areas, layers: Layers) -> OpenLines:
        """Return the parts of `outlines` inside the areas of their layer, by layer."""

    def offset(self, layers: Layers, distance: Float, join: Join) -> Layers:
        """Move the outlines of each layer outward by its distance, mm."""

    def offset_open(self, layers: Layers, distance: Float, limit: float) -> Layers:
        """Shrink each layer by its distance, mm, grow it again, and intersect the result with the layer.

        Corners with a point farther away than `limit` distances are cut off.
        """

    def stroke(self, xy: Float, start: Int, layer: Int, radius: Float, n_layers: int) -> Layers:
        """Return for each layer the area within a radius of its open polylines."""


def gather_lines(found: list[list[Float]]) -> OpenLines:
    """Return the open lines (n, 2) of each layer as arrays."""
    lines = [line for layer in found for line in layer]
    layer = np.repeat(np.arange(len(found)), [len(layer) for layer in found])
    return (
        np.concatenate([np.zeros((0, 2)), *lines]),
        np.array([len(line) for line in lines], np.int64),
        layer,
    )
