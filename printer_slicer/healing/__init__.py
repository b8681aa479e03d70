"""Mesh -> Mesh: put right what keeps it from bounding a solid, and tell what was done.

Whole meshes are mended here as far as their edges tell what is missing; what stays open is closed section by section
when the mesh is cut. The steps stand in the order in which they are taken, because each relies on the ones before it.
"""

from __future__ import annotations

from collections.abc import Callable
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from printer_slicer.errors import MeshError
from printer_slicer.geometry.joints import linked, welded
from printer_slicer.geometry.planes import corner_keys, directed_edges
from printer_slicer.healing.duplicates import drop_duplicates, drop_sheets, join_corners
from printer_slicer.healing.facets import Facets
from printer_slicer.healing.holes import fill_holes
from printer_slicer.healing.shells import face_alike, face_outward
from printer_slicer.model import Mesh, Repair, Repairs

__all__ = ["refuse_repaired", "repair"]

_HOLLOW = 1e-6  # of what is under all facets: a surface and its reverse hold nothing but rounding
_Step = Callable[[Facets], tuple[Facets, list[Repair]]]
_sound: WeakKeyDictionary[Mesh, bool] = WeakKeyDictionary()
"""What came out of here, which needs not go through again, and whether it was sound to begin with."""


def repair(mesh: Mesh) -> tuple[Mesh, Repairs]:
    """The mesh as a surface that bounds a solid, as far as it can be made one, and what was done to it.

    1. Facets that are there more than once are dropped but for one, or altogether where they bound nothing.
    2. Corners at open edges are joined when they are near, see `join_corners`; then facets may be there twice again.
    3. Sheets without thickness that end at a whole surface are dropped.
    4. Neighbours face the same way: the lesser part of each patch is turned round.
    5. Holes are filled, see `fill_holes`.
    6. Closed shells face outward, unless they face inward and lie within the solid: those are voids.

    A mesh that needs nothing of this is returned as it is.

    Raises:
        MeshError: the surface has one side only, or nothing is left of it.
    """
    if mesh in _sound:
        return mesh, Repairs(sound=_sound[mesh])
    mended, repairs = _repaired(mesh)
    _sound[mended] = repairs.sound
    return mended, repairs


def refuse_repaired(name: str, repairs: Repairs) -> None:
    """For those who want no repair.

    Raises:
        MeshError: there was one; names the first.
    """
    if repairs.count:
        first = repairs.done[0]
        x, y, z = first.places[0]
        raise MeshError(
            f"{name}: needs repair: {first.kind}: {first.count}, the first at x {x:.2f} y {y:.2f} z {z:.2f}",
            remedy="leave out --strict to slice it repaired, or mend it in the program that made it",
        )


def _is_sound(mesh: Mesh) -> bool:
    """Whether it is one closed surface that faces outward. This costs a quarter of cutting it."""
    if not _is_one_shell(corner_keys(mesh.triangles.reshape(-1, 3)).reshape(-1, 3)):
        return False
    # Over every facet stands a column from the lowest corner; those under facets that look down count negative.
    (ax, bx, cx), (ay, by, cy), zs = mesh.triangles.transpose(2, 1, 0)
    columns = (zs.sum(axis=0) - 3 * zs.min()) * ((bx - ax) * (cy - ay) - (cx - ax) * (by - ay))
    return float(columns.sum()) > _HOLLOW * float(np.abs(columns).sum())


def _is_one_shell(tag: NDArray[np.uint64]) -> bool:
    """Whether every edge has one facet on each side and facets hang together by edges, from the keys of corners (F, 3).

    Bodies that touch in a corner or an edge are not one: each has a side of its own that faces outward.
    """
    key, upward = directed_edges(tag)
    n_edges = len(key) // 2
    if 2 * n_edges != len(key) or np.count_nonzero(upward) != n_edges:
        return False
    number, firsts = welded(key)
    if len(firsts) != n_edges:
        return False
    beside = np.full((2, n_edges), -1, np.int32)
    for side, which in enumerate((np.flatnonzero(upward), np.flatnonzero(~upward))):
        beside[side, number[which]] = which // 3
    return int(beside.min()) >= 0 and int(linked(beside, len(tag)).max()) == 0


def _repaired(mesh: Mesh) -> tuple[Mesh, Repairs]:
    if _is_sound(mesh):
        return mesh, Repairs(sound=True)
    facets = Facets.read(mesh.triangles)
    steps: list[_Step] = [
        drop_duplicates,
        join_corners,
        drop_duplicates,
        drop_sheets,
        lambda some: face_alike(some, mesh.name),
        fill_holes,
        face_outward,
    ]
    done: list[Repair] = []
    for step in steps:
        facets, more = step(facets)
        done += more
    if not len(facets.corners):
        raise MeshError(
            f"{mesh.name}: the facets enclose no volume",
            remedy="close the surface of the part, or give it a thickness",
        )
    return (Mesh(facets.triangles, mesh.name), Repairs(tuple(done))) if done else (mesh, Repairs())
