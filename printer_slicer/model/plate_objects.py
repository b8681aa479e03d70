"""Objects on a plate, with the facets and the moves of each object."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from printer_slicer.arrays import Float, Int, frozen_array
from printer_slicer.deprecation import accept_former_fields
from printer_slicer.values import Struct, force_setattr, replace

if TYPE_CHECKING:
    from printer_slicer.model.volumes import Volumes

__all__ = ["Labels", "PlateObject"]


class PlateObject(Struct, frozen=True):
    """One object of a mesh.

    Attributes:
        name: name of the object.
        low, high: corners of its bounding box, mm.
        first, count: range of its facets in the mesh; count 0: unknown, because the mesh was repaired.
        volumes: volumes and painted facets that apply to this object only, in coordinates of the mesh.
    """

    name: str
    low: tuple[float, float, float]
    high: tuple[float, float, float]
    first: int = 0
    count: int = 0
    volumes: Volumes | None = None

    @classmethod
    def of(
        cls, name: str, bounds: Float, first: int, count: int, volumes: Volumes | None = None
    ) -> PlateObject:
        """Build an object from its range of facets and its bounding box `bounds` (2, 3), mm."""
        (x, y, z), (right, back, top) = bounds.tolist()
        return cls(name, (x, y, z), (right, back, top), first, count, volumes)

    @property
    def facets(self) -> slice:
        """The range of its facets in the mesh."""
        return slice(self.first, self.first + self.count)

    def moved(self, by: Float) -> PlateObject:
        """Return the object shifted by (x, y, z) mm."""
        volumes = self.volumes and self.volumes.moved(by)
        return PlateObject.of(
            self.name, np.array([self.low, self.high]) + by, self.first, self.count, volumes
        )

    def map_volumes(self, change: Callable[[Float], Float]) -> PlateObject:
        """Return the object with its volumes changed by a function that takes and returns triangles, mm."""
        return replace(self, volumes=self.volumes.map_triangles(change)) if self.volumes else self

    def with_facets_before(self, facets: int) -> PlateObject:
        """Return the object for a mesh in which `facets` more facets precede those of the object."""
        return replace(self, first=self.first + facets)

    def without_facets(self) -> PlateObject:
        """Return the object without its range of facets, for a mesh whose facets changed."""
        return replace(self, first=0, count=0)


@accept_former_fields(item="object_id")
class Labels(Struct, frozen=True, eq=False):
    """The object of each move.

    Attributes:
        names: unique names of the objects, of letters, digits, `_` and `-`.
        boxes: (O, 2, 2) their bounding boxes seen from above, mm.
        object_id: (K,) index of the object that a move prints; -1 for travels, skirt, brim and raft.
    """

    names: tuple[str, ...]
    boxes: Float
    object_id: Int

    def __post_init__(self) -> None:
        force_setattr(self, "boxes", frozen_array(self.boxes, np.float64, (len(self.names), 2, 2)))
        force_setattr(self, "object_id", frozen_array(self.object_id, np.int64, (-1,)))
