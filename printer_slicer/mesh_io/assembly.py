"""Assemble objects that consist of other objects, each with a transform, as in 3MF and glTF."""

from __future__ import annotations

from array import array
from collections.abc import Hashable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from printer_slicer.errors import MeshError
from printer_slicer.mesh_io.limits import check_facets, check_instances, check_vertices
from printer_slicer.mesh_io.soundness import BLOCK, EXPORT_AGAIN
from printer_slicer.values import Struct, field

if TYPE_CHECKING:
    from pathlib import Path

    from printer_slicer.arrays import Float, Int
    from printer_slicer.mesh_io.limits import Limits

__all__ = [
    "ObjectBuilder",
    "ObjectReference",
    "ObjectTable",
    "assemble_facets",
    "count_facets_by_object",
    "is_mirrored",
]


class ObjectReference(Struct, frozen=True, eq=False):
    """An object placed in another one, or on the plate.

    Attributes:
        key: the key of the object.
        matrix: (4, 4) for row vectors: moved points are `[x, y, z, 1] @ matrix`. None means no transform.
    """

    key: Hashable
    matrix: Float | None = None


class ObjectTable:
    """The objects read so far, by number; their counts are checked against the limits."""

    def __init__(self, path: Path, limits: Limits) -> None:
        self.bodies: dict[Hashable, ObjectBuilder] = {}
        self._path, self._limits = path, limits
        self._last = ObjectBuilder("no object")
        self._n_numbers = [0, 0]
        self._n_references = 0

    def add_object(self, key: Hashable, name: str) -> ObjectBuilder:
        """Add an object.

        Raises:
            ValueError: an object with this key exists already.
        """
        if key in self.bodies:
            raise ValueError(f"{name} is defined twice")
        self._n_numbers = self._count_coordinates_and_corners()
        self._last = self.bodies[key] = ObjectBuilder(name)
        self.count_reference()
        return self._last

    def count_reference(self) -> None:
        """Count one more object or one more placement.

        Raises:
            MeshError: there are too many.
        """
        self._n_references += 1
        check_instances(self._n_references, self._path, self._limits)

    def check_limits(self) -> None:
        """Check the number of vertices and facets; call this regularly while reading.

        Raises:
            MeshError: there are too many.
        """
        n_coordinates, n_corners = self._count_coordinates_and_corners()
        check_vertices(n_coordinates // 3, self._path, self._limits)
        check_facets(n_corners // 3, self._path, self._limits)

    def _count_coordinates_and_corners(self) -> list[int]:
        """Return the number of coordinates and of corners in all objects read so far."""
        return [self._n_numbers[0] + len(self._last.xyz), self._n_numbers[1] + len(self._last.corners)]


class ObjectBuilder(Struct, eq=False):
    """An object that is being read.

    Attributes:
        name: the name used in messages.
        xyz: coordinates of its vertices, three per vertex.
        corners: vertex indices of its facets, three per facet.
        parts: the objects it consists of.
        label: the name in the file.
    """

    name: str
    xyz: array[float] = field(default_factory=lambda: array("d"))
    corners: array[int] = field(default_factory=lambda: array("q"))
    parts: list[ObjectReference] = field(default_factory=list)
    label: str = ""

    def indices(self, path: Path) -> Int:
        """Return the vertex indices (F, 3) of the facets.

        Raises:
            MeshError: a facet uses a vertex that does not exist.
        """
        indices: Int = np.frombuffer(self.corners, dtype=np.int64).reshape(-1, 3)
        n_vertices = len(self.xyz) // 3
        if len(indices) and not (indices.min() >= 0 and indices.max() < n_vertices):
            facet, corner = np.argwhere((indices < 0) | (indices >= n_vertices))[0]
            raise MeshError(
                f"{path}: {self.name}: facet {facet + 1} uses vertex {indices[facet, corner]} of {n_vertices}",
                remedy=EXPORT_AGAIN,
            )
        return indices


def assemble_facets(
    roots: Sequence[ObjectReference],
    bodies: Mapping[Hashable, ObjectBuilder],
    path: Path,
    limits: Limits,
    scale: float,
) -> Float:
    """Return the corners (F, 3, 3) of all objects on the plate.

    Args:
        roots: the objects placed on the plate.
        bodies: key -> object.
        path: for messages.
        limits: for the number of facets, the number of objects and their nesting.
        scale: mm per unit.

    Raises:
        MeshError: an object is missing or contains itself, or there are too many.
    """
    placed = _list_instances(roots, bodies, path, limits)
    indices = {id(body): body.indices(path) for body, _ in placed}
    triangles = np.zeros((sum(len(indices[id(body)]) for body, _ in placed), 3, 3))
    filled = 0
    for body, matrix in placed:
        # Scale the points, not the matrix: then a point without a transform is exactly its number times the scale.
        points = np.frombuffer(body.xyz, dtype=np.float64).reshape(-1, 3)
        if matrix is not None:
            points = points @ matrix[:3, :3] + matrix[3, :3]
        points = points * scale if scale != 1 else points
        faces = indices[id(body)]
        faces = faces[:, ::-1] if matrix is not None and is_mirrored(matrix) else faces
        for start in range(0, len(faces), BLOCK):
            part = faces[start : start + BLOCK]
            # All indices are valid; with "clip", they are not checked again, and nothing is copied twice.
            np.take(points, part, axis=0, out=triangles[filled : filled + len(part)], mode="clip")
            filled += len(part)
    return triangles


def count_facets_by_object(
    roots: Sequence[ObjectReference], bodies: Mapping[Hashable, ObjectBuilder], path: Path, limits: Limits
) -> list[tuple[str, int]]:
    """Return the name and the number of facets of each object on the plate, in the order of `assemble_facets`."""
    found = []
    for root in roots:
        placed = _list_instances([root], bodies, path, limits)
        found.append((bodies[root.key].label, sum(len(body.corners) // 3 for body, _ in placed)))
    return [(name, count) for name, count in found if count]


def is_mirrored(matrix: Float) -> bool:
    """Return whether a (4, 4) or (3, 3) matrix mirrors; if so, facets must be flipped to face outward."""
    return bool(np.linalg.det(matrix[:3, :3]) < 0)


def _list_instances(
    roots: Sequence[ObjectReference], bodies: Mapping[Hashable, ObjectBuilder], path: Path, limits: Limits
) -> list[tuple[ObjectBuilder, Float | None]]:
    """List every instance of each object that has facets, with its transform to plate coordinates."""
    placed: list[tuple[ObjectBuilder, Float | None]] = []
    n_facets = n_vertices = n_seen = 0
    waiting: list[tuple[ObjectReference, Float | None, int]] = [(use, None, 0) for use in reversed(roots)]
    while waiting:
        use, outer, depth = waiting.pop()
        n_seen += 1
        body = bodies.get(use.key)
        if body is None:
            raise MeshError(
                f"{path}: object {_format_key(use.key)} is placed but not defined", remedy=EXPORT_AGAIN
            )
        if depth > limits.nesting or n_seen + len(waiting) > limits.instances:
            what = f"objects are nested more than {limits.nesting} deep" if depth > limits.nesting else ""
            raise MeshError(
                f"{path}: {body.name}: {what or f'more than {limits.instances} objects are placed'}",
                remedy="Check that no object contains itself, then export the part again",
            )
        matrix = _compose_transforms(use.matrix, outer)
        if len(body.corners):
            n_facets += len(body.corners) // 3
            n_vertices += len(body.xyz) // 3
            check_facets(n_facets, path, limits)
            check_vertices(n_vertices, path, limits, per_facet=3)
            placed.append((body, matrix))
        waiting += [(part, matrix, depth + 1) for part in reversed(body.parts)]
    return placed


def _compose_transforms(inner: Float | None, outer: Float | None) -> Float | None:
    """Return the transform that applies `inner`, then `outer`."""
    if inner is None or outer is None:
        return outer if inner is None else inner
    composed: Float = inner @ outer
    return composed


def _format_key(key: Hashable) -> str:
    return str(key[-1] if isinstance(key, tuple) else key)[:80]
