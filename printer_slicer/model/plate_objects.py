"""Several things on one plate: which facets are whose, and which moves."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from printer_slicer.arrays import Float, Int, frozen_array

__all__ = ["Labels", "PlateObject"]


@dataclass(frozen=True, slots=True)
class PlateObject:
    """One of the things that a mesh holds, or all of it.

    Attributes:
        name: what to call it.
        low, high: corners of its envelope, mm.
        first, count: its facets among those of the mesh; count 0: they are not known any more.
    """

    name: str
    low: tuple[float, float, float]
    high: tuple[float, float, float]
    first: int = 0
    count: int = 0

    @classmethod
    def of(cls, name: str, bounds: Float, first: int, count: int) -> PlateObject:
        """The thing that some facets are, whose envelope is `bounds` (2, 3)."""
        (x, y, z), (right, back, top) = bounds.tolist()
        return cls(name, (x, y, z), (right, back, top), first, count)

    def moved(self, by: Float) -> PlateObject:
        """The same thing, shifted by (x, y, z) mm."""
        return PlateObject.of(self.name, np.array([self.low, self.high]) + by, self.first, self.count)

    def behind(self, facets: int) -> PlateObject:
        """The same thing in a mesh that has so many facets before it."""
        return replace(self, first=self.first + facets)

    def without_facets(self) -> PlateObject:
        """The same thing in a mesh whose facets are others now."""
        return replace(self, first=0, count=0)


@dataclass(frozen=True, slots=True, eq=False)
class Labels:
    """Which moves lay which of several things.

    Attributes:
        names: of the things, each another one, of letters, digits, `_` and `-`.
        boxes: (O, 2, 2) their envelopes seen from above, mm.
        item: (K,) the number of the thing that a move's bead belongs to; -1 for travels, skirt, brim and raft.
    """

    names: tuple[str, ...]
    boxes: Float
    item: Int

    def __post_init__(self) -> None:
        object.__setattr__(self, "boxes", frozen_array(self.boxes, np.float64, (len(self.names), 2, 2)))
        object.__setattr__(self, "item", frozen_array(self.item, np.int64, (-1,)))
