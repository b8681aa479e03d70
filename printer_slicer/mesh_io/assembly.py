"""Assemble objects that consist of other objects, each with a transform, as in 3MF and glTF."""

from __future__ import annotations

from array import array
from collections.abc import Container, Hashable, Mapping, Sequence
from typing import TYPE_CHECKING, Final

import numpy as np

from printer_slicer.errors import MeshError
from printer_slicer.mesh_io.facet_paint import split_painted_facets
from printer_slicer.mesh_io.limits import check_facets, check_instances, check_vertices
from printer_slicer.mesh_io.soundness import BLOCK, EXPORT_AGAIN
from printer_slicer.values import Struct, field, replace

if TYPE_CHECKING:
    from pathlib import Path

    from printer_slicer.arrays import Float, Int
    from printer_slicer.mesh_io.limits import Limits

__all__ = [
    "PART",
    "ObjectBuilder",
    "ObjectReference",
    "ObjectTable",
    "assemble_facets",
    "assemble_painted_facets",
    "count_facets",
    "find_original",
    "is_mirrored",
]


PART: Final = "part"
"""The type of volumes that are printed."""


class ObjectReference(Struct, frozen=True, eq=False):
    """An object placed in another one, or on the plate.

    Attributes:
        key: the key of the object.
        matrix: (4, 4) for row vectors: moved points are `[x, y, z, 1] @ matrix`. None means no transform.
        volume_type: PART, or the type of a volume that is not printed; it applies to all objects within this one.
    """

    key: Hashable
    matrix: Float | None = None
    volume_type: str = PART


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
        paint: digits of the facets that are painted for supports, by index of the facet, see `facet_paint`.
    """

    name: str
    xyz: array[float] = field(default_factory=lambda: array("d"))
    corners: array[int] = field(default_factory=lambda: array("q"))
    parts: list[ObjectReference] = field(default_factory=list)
    label: str = ""
    paint: dict[int, str] = field(default_factory=dict)

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
    *,
    volume_type: str = PART,
) -> Float:
    """Return the corners (F, 3, 3) of all objects on the plate.

    Args:
        roots: the objects placed on the plate.
        bodies: key -> object.
        path: for messages.
        limits: for the number of facets, the number of objects and their nesting.
        scale: mm per unit.
        volume_type: type of the volumes to return.

    Raises:
        MeshError: an object is missing or contains itself, or there are too many.
    """
    placed = [one for one in _list_instances(roots, bodies, path, limits) if one.volume_type == volume_type]
    indices = {id(one.body): one.body.indices(path) for one in placed}
    triangles = np.zeros((sum(len(indices[id(one.body)]) for one in placed), 3, 3))
    filled = 0
    for one in placed:
        points = _place_points(
            np.frombuffer(one.body.xyz, dtype=np.float64).reshape(-1, 3), one.matrix, scale
        )
        faces = indices[id(one.body)]
        faces = faces[:, ::-1] if one.matrix is not None and is_mirrored(one.matrix) else faces
        for start in range(0, len(faces), BLOCK):
            part = faces[start : start + BLOCK]
            # All indices are valid; with "clip", they are not checked again, and nothing is copied twice.
            np.take(points, part, axis=0, out=triangles[filled : filled + len(part)], mode="clip")
            filled += len(part)
    return triangles


def _place_points(points: Float, matrix: Float | None, scale: float) -> Float:
    """Return points (..., 3) on the plate, mm."""
    # Scale the points, not the matrix: then a point without a transform is exactly its number times the scale.
    if matrix is not None:
        points = points @ matrix[:3, :3] + matrix[3, :3]
    return points * scale if scale != 1 else points


def assemble_painted_facets(
    roots: Sequence[ObjectReference],
    bodies: Mapping[Hashable, ObjectBuilder],
    path: Path,
    limits: Limits,
    scale: float,
) -> tuple[Float, Int]:
    """Return the painted pieces (P, 3, 3) of all parts on the plate, mm, and the state of each, see `facet_paint`.

    Raises:
        MeshError: the paint of a facet is not valid, or there is too much.
    """
    placed = [
        one
        for one in _list_instances(roots, bodies, path, limits)
        if one.body.paint and one.volume_type == PART
    ]
    split: dict[int, tuple[Float, Int]] = {}
    pieces, states, count = [np.zeros((0, 3, 3))], [np.zeros(0, np.int64)], 0
    for one in placed:
        if id(one.body) not in split:
            points = np.frombuffer(one.body.xyz, dtype=np.float64).reshape(-1, 3)
            name = f"{path}: {one.body.name}"
            split[id(one.body)] = split_painted_facets(
                one.body.paint, points[one.body.indices(path)], name, limits
            )
        corners, state = split[id(one.body)]
        count += len(state)
        check_facets(count, path, limits)
        pieces.append(_place_points(corners, one.matrix, scale))
        states.append(state)
    return np.concatenate(pieces), np.concatenate(states)


def count_facets(
    root: ObjectReference, bodies: Mapping[Hashable, ObjectBuilder], path: Path, limits: Limits
) -> int:
    """Return the number of facets of an object on the plate."""
    placed = _list_instances([root], bodies, path, limits)
    return sum(len(one.body.corners) // 3 for one in placed if one.volume_type == PART)


def is_mirrored(matrix: Float) -> bool:
    """Return whether a (4, 4) or (3, 3) matrix mirrors; if so, facets must be flipped to face outward."""
    return bool(np.linalg.det(matrix[:3, :3]) < 0)


class _Instance(Struct, frozen=True, eq=False):
    """An object with facets on the plate: its transform to plate coordinates, and the type of its volume."""

    body: ObjectBuilder
    matrix: Float | None
    volume_type: str


def _list_instances(
    roots: Sequence[ObjectReference], bodies: Mapping[Hashable, ObjectBuilder], path: Path, limits: Limits
) -> list[_Instance]:
    """List every instance of each object that has facets."""
    placed: list[_Instance] = []
    n_facets = n_vertices = n_seen = 0
    waiting: list[tuple[ObjectReference, Float | None, str, int]] = [
        (use, None, PART, 0) for use in reversed(roots)
    ]
    while waiting:
        use, outer, outer_type, depth = waiting.pop()
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
        volume_type = use.volume_type if outer_type == PART else outer_type
        if len(body.corners):
            n_facets += len(body.corners) // 3
            n_vertices += len(body.xyz) // 3
            check_facets(n_facets, path, limits)
            check_vertices(n_vertices, path, limits, per_facet=3)
            placed.append(_Instance(body, matrix, volume_type))
        waiting += [(part, matrix, volume_type, depth + 1) for part in reversed(body.parts)]
    return placed


def find_original(
    use: ObjectReference, bodies: Mapping[Hashable, ObjectBuilder], copies: Container[Hashable]
) -> ObjectReference:
    """Return a reference to the original of a copy, which has its name, its volumes and its settings.

    PrusaSlicer writes a copy as an object without a name that consists of another object.

    Args:
        use: reference to an object.
        bodies: all objects.
        copies: the keys of objects that may be copies.
    """
    seen = set[Hashable]()
    while use.key in copies and use.key not in seen and use.key in bodies:
        body = bodies[use.key]
        if body.label or body.corners or len(body.parts) != 1 or body.parts[0].volume_type != PART:
            break
        seen.add(use.key)
        original = body.parts[0]
        use = replace(use, key=original.key, matrix=_compose_transforms(original.matrix, use.matrix))
    return use


def _compose_transforms(inner: Float | None, outer: Float | None) -> Float | None:
    """Return the transform that applies `inner`, then `outer`."""
    if inner is None or outer is None:
        return outer if inner is None else inner
    composed: Float = inner @ outer
    return composed


def _format_key(key: Hashable) -> str:
    return str(key[-1] if isinstance(key, tuple) else key)[:80]
