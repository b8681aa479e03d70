"""The part: its surface, and what was put right in it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING
from weakref import WeakKeyDictionary

import numpy as np

from printer_slicer.arrays import Float, frozen_array
from printer_slicer.errors import MeshError, UsageError
from printer_slicer.model.plate_objects import PlateObject
from printer_slicer.repr_svg import SvgRepr
from printer_slicer.texts import describe_type

if TYPE_CHECKING:
    import trimesh

__all__ = ["Mesh", "MeshFaults", "Repair", "Repairs"]

_BLOCK = 1 << 12  # facets: what fits the cache
_ROW = 768  # coordinates compared at a time
_bounds: WeakKeyDictionary[Mesh, Float] = WeakKeyDictionary()
"""Every stage from reading to planning asks for them."""


@dataclass(frozen=True, slots=True, eq=False, weakref_slot=True)
class Mesh(SvgRepr):
    """The surface of the part as loose triangles, as an STL file has them.

    Neighbours share the coordinates of their corners exactly.

    Attributes:
        triangles: (F, 3, 3) mm; corners counter-clockwise seen from outside.
        name: what to call the part in messages.
        items: the things that it holds, where it holds several.
    """

    triangles: Float
    name: str = "part"
    objects: tuple[PlateObject, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "triangles", frozen_array(self.triangles, np.float64, (-1, 3, 3)))

    def __repr__(self) -> str:
        x, y, z = self.size.tolist() if self.n_facets else (0, 0, 0)
        return f"<Mesh {self.name!r}: {self.n_facets} facets, {x:.4g} x {y:.4g} x {z:.4g} mm>"

    @classmethod
    def from_trimesh(cls, mesh: trimesh.Trimesh, name: str = "part") -> Mesh:
        """The surface of a trimesh, with the same coordinates, in mm.

        Args:
            mesh: of triangles; its transforms, colours and metadata are not looked at.
            name: what to call the part in messages.

        Raises:
            UsageError: it is no trimesh of triangles, such as a point cloud or a path.
            MeshError: it has no facets, or a coordinate that is no number.
        """
        if not hasattr(mesh, "triangles"):
            raise UsageError(
                f"{name}: from_trimesh wants a trimesh.Trimesh, not {describe_type(mesh)}",
                remedy="give it a mesh of triangles: trimesh.load_mesh(path)",
            )
        triangles = np.asarray(mesh.triangles, np.float64)
        if not len(triangles) or not np.isfinite(triangles).all():
            raise MeshError(
                f"{name}: this trimesh has {'a coordinate that is no number' if len(triangles) else 'no facets'}",
                remedy="look at its faces and vertices",
            )
        return cls(triangles, name)

    def to_trimesh(self) -> trimesh.Trimesh:
        """The same surface as a trimesh; corners with equal coordinates are one vertex.

        The first call imports trimesh, which takes about half a second.
        """
        import trimesh  # noqa: PLC0415 - the slicer does without

        corners = self.triangles.reshape(-1, 3)
        vertices, number = np.unique(corners, axis=0, return_inverse=True)
        return trimesh.Trimesh(vertices, number.reshape(-1, 3), process=False, metadata={"name": self.name})

    @property
    def n_facets(self) -> int:
        """Number of facets."""
        return len(self.triangles)

    @property
    def bounds(self) -> Float:
        """(2, 3) lowest and highest corner of the envelope, mm."""
        if self not in _bounds:
            _bounds[self] = frozen_array(self._ends(), np.float64, (2, 3))
        return _bounds[self]

    def _ends(self) -> Float:
        """The same, looked for among all corners."""
        # Long rows first: numbers that stand side by side are compared several at a time.
        flat = self.triangles.reshape(-1)
        n = len(flat) - len(flat) % _ROW
        ends = []
        for extreme in (np.minimum, np.maximum):
            rows = extreme.reduce(flat[:n].reshape(-1, _ROW), axis=0) if n else flat[:0]
            ends.append(extreme.reduce(np.concatenate([rows, flat[n:]]).reshape(-1, 3), axis=0))
        return np.array(ends)

    @property
    def size(self) -> Float:
        """(3,) edge lengths of the envelope, mm."""
        low, high = self.bounds
        return np.asarray(high - low)

    @property
    def height(self) -> float:
        """Top of the part over z = 0, mm."""
        return float(self.bounds[1, 2])

    @property
    def volume(self) -> float:
        """Signed volume, mm³; negative when the facets face inward."""
        # In blocks, coordinate by coordinate: seven times as fast as whole arrays, and no second copy of a large mesh.
        # Seen from the middle of the first facet: turned inside out, an open mesh has exactly the opposite volume too.
        middle = self.triangles[:1].mean(axis=(0, 1)) if self.n_facets else np.zeros(3)
        total, origin = 0.0, np.tile(middle, 3)[:, None]
        for start in range(0, self.n_facets, _BLOCK):
            block = self.triangles[start : start + _BLOCK].reshape(-1, 9)
            a, b, c = np.subtract(block.T, origin, order="C").reshape(3, 3, -1)
            total += sum(float(a[i] @ (b[i - 2] * c[i - 1] - b[i - 1] * c[i - 2])) for i in range(3))
        return total / 6

    def moved(self, by: Float | tuple[float, float, float]) -> Mesh:
        """The same part, shifted by (x, y, z) mm."""
        items = tuple(item.moved(np.asarray(by, dtype=np.float64)) for item in self.objects)
        return Mesh(self.triangles + np.asarray(by, dtype=np.float64), self.name, items)


@dataclass(frozen=True, slots=True, eq=False)
class MeshFaults:
    """What keeps a mesh from bounding a solid, each as middle points (n, 3) of edges, mm.

    Attributes:
        open_edges: edges with a facet on one side only.
        flipped_edges: edges whose two facets face opposite ways.
        crowded_edges: edges that more than two facets share; solids that touch along an edge have them too.
    """

    open_edges: Float
    flipped_edges: Float
    crowded_edges: Float

    def __post_init__(self) -> None:
        for name in ("open_edges", "flipped_edges", "crowded_edges"):
            object.__setattr__(self, name, frozen_array(getattr(self, name), np.float64, (-1, 3)))

    @property
    def count(self) -> int:
        """How many edges in all."""
        return len(self.open_edges) + len(self.flipped_edges) + len(self.crowded_edges)


@dataclass(frozen=True, slots=True, eq=False)
class Repair:
    """What was done to a mesh for one reason.

    Attributes:
        kind: what, in words: "facets turned round".
        places: (n, 3) mm, one for each time it was done.
        widest: the farthest that a corner was moved, or the largest hole that was closed, mm; 0 where neither.
        area: mm² of surface that was guessed.
    """

    kind: str
    places: Float
    widest: float = 0.0
    area: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "places", frozen_array(self.places, np.float64, (-1, 3)))

    @property
    def count(self) -> int:
        """How often."""
        return len(self.places)


@dataclass(frozen=True, slots=True)
class Repairs:
    """What was put right in a mesh before it was cut.

    Attributes:
        done: all of it, in the order in which it was done.
        sound: whether the mesh was one shell.
    """

    done: tuple[Repair, ...] = ()
    sound: bool = False

    @property
    def count(self) -> int:
        """How many places in all."""
        return sum(repair.count for repair in self.done)
