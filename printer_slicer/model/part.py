"""The part as a mesh, and the repairs made to it."""

from __future__ import annotations

from typing import TYPE_CHECKING
from weakref import WeakKeyDictionary

import numpy as np

from printer_slicer.arrays import Float, frozen_array
from printer_slicer.deprecation import accept_former_fields
from printer_slicer.errors import MeshError, UsageError
from printer_slicer.model.plate_objects import PlateObject
from printer_slicer.repr_svg import SvgRepr
from printer_slicer.texts import describe_type
from printer_slicer.values import Struct, force_setattr, replace

if TYPE_CHECKING:
    import trimesh

    from printer_slicer.model.volumes import Volumes

__all__ = ["Mesh", "MeshFaults", "Repair", "Repairs"]

_BLOCK = 1 << 12  # facets per block; a block fits the CPU cache
_ROW = 768  # coordinates per row; rows are compared at once
_bounds: WeakKeyDictionary[Mesh, Float] = WeakKeyDictionary()
"""Cached bounds, which many stages use."""


@accept_former_fields(items="objects")
class Mesh(SvgRepr, Struct, frozen=True, eq=False, weakref=True):
    """The surface of the part as unconnected triangles, as in an STL file.

    Neighbouring triangles have exactly equal corner coordinates.

    Attributes:
        triangles: (F, 3, 3) mm; corners counter-clockwise seen from outside.
        name: name of the part in messages.
        objects: the objects of a plate with several; empty if the mesh is one object.
        volumes: volumes and painted facets that steer supports or are cut out, in coordinates of the mesh. They apply
            to all objects; each object may have volumes of its own.
    """

    triangles: Float
    name: str = "part"
    objects: tuple[PlateObject, ...] = ()
    volumes: Volumes | None = None

    def __post_init__(self) -> None:
        force_setattr(self, "triangles", frozen_array(self.triangles, np.float64, (-1, 3, 3)))

    def __repr__(self) -> str:
        x, y, z = self.size.tolist() if self.n_facets else (0, 0, 0)
        return f"<Mesh {self.name!r}: {self.n_facets} facets, {x:.4g} x {y:.4g} x {z:.4g} mm>"

    @classmethod
    def from_trimesh(cls, mesh: trimesh.Trimesh, name: str = "part") -> Mesh:
        """Convert a trimesh, whose coordinates are taken as mm.

        Args:
            mesh: a mesh of triangles; transforms, colours and metadata are ignored.
            name: name of the part in messages.

        Raises:
            UsageError: `mesh` is not a trimesh of triangles, but for example a point cloud or a path.
            MeshError: the mesh has no facets, or a coordinate that is not finite.
        """
        if not hasattr(mesh, "triangles"):
            raise UsageError(
                f"{name}: from_trimesh expects a trimesh.Trimesh, not {describe_type(mesh)}",
                remedy="Pass a mesh of triangles: trimesh.load_mesh(path)",
            )
        triangles = np.asarray(mesh.triangles, np.float64)
        if not len(triangles) or not np.isfinite(triangles).all():
            raise MeshError(
                f"{name}: the trimesh has {'a coordinate that is not finite' if len(triangles) else 'no facets'}",
                remedy="Check its faces and vertices",
            )
        return cls(triangles, name)

    def to_trimesh(self) -> trimesh.Trimesh:
        """Convert to a trimesh; corners with equal coordinates become one vertex.

        The first call imports trimesh, which takes about half a second.
        """
        import trimesh  # noqa: PLC0415 - trimesh is optional

        corners = self.triangles.reshape(-1, 3)
        vertices, number = np.unique(corners, axis=0, return_inverse=True)
        return trimesh.Trimesh(vertices, number.reshape(-1, 3), process=False, metadata={"name": self.name})

    @property
    def n_facets(self) -> int:
        """Number of facets."""
        return len(self.triangles)

    @property
    def bounds(self) -> Float:
        """Return the lower and upper corner of the bounding box (2, 3), mm."""
        if self not in _bounds:
            _bounds[self] = frozen_array(self._compute_bounds(), np.float64, (2, 3))
        return _bounds[self]

    def _compute_bounds(self) -> Float:
        """Compute the bounds from all corners."""
        # Reduce long rows first, because numpy compares contiguous numbers several at a time.
        flat = self.triangles.reshape(-1)
        n = len(flat) - len(flat) % _ROW
        ends = []
        for extreme in (np.minimum, np.maximum):
            rows = extreme.reduce(flat[:n].reshape(-1, _ROW), axis=0) if n else flat[:0]
            ends.append(extreme.reduce(np.concatenate([rows, flat[n:]]).reshape(-1, 3), axis=0))
        return np.array(ends)

    @property
    def size(self) -> Float:
        """Return the size of the bounding box (3,), mm."""
        low, high = self.bounds
        return np.asarray(high - low)

    @property
    def height(self) -> float:
        """Height of the top of the part above z = 0, mm."""
        return float(self.bounds[1, 2])

    @property
    def volume(self) -> float:
        """Signed volume, mm³; negative when the facets face inward."""
        # Blocks and single coordinates are seven times as fast as whole arrays, and need no second copy of the mesh.
        # Volumes are measured from the middle of the first facet, so that inverting an open mesh exactly negates it.
        middle = self.triangles[:1].mean(axis=(0, 1)) if self.n_facets else np.zeros(3)
        total, origin = 0.0, np.tile(middle, 3)[:, None]
        for start in range(0, self.n_facets, _BLOCK):
            block = self.triangles[start : start + _BLOCK].reshape(-1, 9)
            a, b, c = np.subtract(block.T, origin, order="C").reshape(3, 3, -1)
            total += sum(float(a[i] @ (b[i - 2] * c[i - 1] - b[i - 1] * c[i - 2])) for i in range(3))
        return total / 6

    def with_volumes(self, volumes: Volumes | None) -> Mesh:
        """Return the part with these volumes added to its own."""
        return replace(self, volumes=volumes.joined([self.volumes, volumes])) if volumes else self

    @property
    def all_volumes(self) -> Volumes | None:
        """The volumes for all objects together with those of each object; None if there are none."""
        given = [one for one in (self.volumes, *(item.volumes for item in self.objects)) if one]
        return given[0].joined(given) if given else None

    def moved(self, by: Float | tuple[float, float, float]) -> Mesh:
        """Return the part shifted by (x, y, z) mm."""
        step = np.asarray(by, dtype=np.float64)
        items = tuple(item.moved(step) for item in self.objects)
        return Mesh(self.triangles + step, self.name, items, self.volumes and self.volumes.moved(step))


class MeshFaults(Struct, frozen=True, eq=False):
    """The faulty edges of a mesh; each is given by its midpoint, (n, 3), mm.

    Attributes:
        open_edges: edges with only one facet.
        flipped_edges: edges whose two facets have opposite orientation.
        crowded_edges: edges with more than two facets; also where solids touch along an edge.
    """

    open_edges: Float
    flipped_edges: Float
    crowded_edges: Float

    def __post_init__(self) -> None:
        for name in ("open_edges", "flipped_edges", "crowded_edges"):
            force_setattr(self, name, frozen_array(getattr(self, name), np.float64, (-1, 3)))

    @property
    def count(self) -> int:
        """Total number of faulty edges."""
        return len(self.open_edges) + len(self.flipped_edges) + len(self.crowded_edges)


class Repair(Struct, frozen=True, eq=False):
    """One kind of repair of a mesh.

    Attributes:
        kind: description of the repair, such as "facets turned round".
        places: (n, 3) mm, the positions of all repairs of this kind.
        widest: longest distance by which a corner was moved, or width of the largest hole that was closed, mm; 0 for
            other repairs.
        area: area of added surface, mm².
    """

    kind: str
    places: Float
    widest: float = 0.0
    area: float = 0.0

    def __post_init__(self) -> None:
        force_setattr(self, "places", frozen_array(self.places, np.float64, (-1, 3)))

    @property
    def count(self) -> int:
        """Number of repairs of this kind."""
        return len(self.places)


class Repairs(Struct, frozen=True):
    """All repairs of a mesh.

    Attributes:
        done: the repairs, in order.
        sound: whether the mesh was a single closed shell.
    """

    done: tuple[Repair, ...] = ()
    sound: bool = False

    @property
    def count(self) -> int:
        """Total number of repairs."""
        return sum(repair.count for repair in self.done)
