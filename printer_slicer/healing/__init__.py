"""Mesh -> Mesh: put right what keeps it from bounding a solid, and tell what was done.

Whole meshes are mended here as far as their edges tell what is missing; what stays open is closed section by section
when the mesh is cut. The steps stand in the order in which they are taken, because each relies on the ones before it.
"""

from __future__ import annotations

from collections.abc import Callable
from weakref import WeakKeyDictionary

from printer_slicer.errors import MeshError
from printer_slicer.healing.consistent_winding import orient_consistently
from printer_slicer.healing.duplicates import drop_duplicates, drop_sheets, join_corners
from printer_slicer.healing.facets import Facets
from printer_slicer.healing.holes import fill_holes
from printer_slicer.healing.orient_outward import orient_outward
from printer_slicer.healing.shells import drop_loose_facets
from printer_slicer.healing.soundness import is_sound
from printer_slicer.model import Mesh, Repair, Repairs

__all__ = ["repair", "require_no_repair"]

_Step = Callable[[Facets], tuple[Facets, list[Repair]]]
_sound: WeakKeyDictionary[Mesh, bool] = WeakKeyDictionary()
"""What came out of here, which needs not go through again, and whether it was sound to begin with."""


def repair(mesh: Mesh) -> tuple[Mesh, Repairs]:
    """Repair a mesh so that it bounds a solid as far as possible, and report what was done.

    1. Facets that are there more than once are dropped but for one, or altogether where they bound nothing.
    2. Corners at open edges are joined when they are near, see `join_corners`; then facets may be there twice again.
    3. Sheets without thickness that end at a whole surface are dropped.
    4. Loose facets that bound nothing are dropped, see `drop_loose_facets`.
    5. Neighbours face the same way: the lesser part of each patch is turned round.
    6. Holes are filled, see `fill_holes`.
    7. Shells face outward, unless they are voids, see `orient_outward`.

    A mesh that needs nothing of this is returned as it is.

    Raises:
        MeshError: the surface has one side only, or nothing is left of it.
    """
    if mesh in _sound:
        return mesh, Repairs(sound=_sound[mesh])
    mended, repairs = _repaired(mesh)
    _sound[mended] = repairs.sound
    return mended, repairs


def require_no_repair(name: str, repairs: Repairs) -> None:
    """Raise an error if a mesh needed repair.

    Raises:
        MeshError: there was one; names the first.
    """
    if repairs.count:
        first = repairs.done[0]
        x, y, z = first.places[0]
        raise MeshError(
            f"{name}: needs repair: {first.kind}: {first.count}, the first at x {x:.2f} y {y:.2f} z {z:.2f}",
            remedy="Leave out --strict to slice the repaired part, or repair it in the program that made it",
        )


def _repaired(mesh: Mesh) -> tuple[Mesh, Repairs]:
    if is_sound(mesh.triangles):
        return mesh, Repairs(sound=True)
    facets = Facets.read(mesh.triangles)
    steps: list[_Step] = [
        drop_duplicates,
        join_corners,
        drop_duplicates,
        drop_sheets,
        drop_loose_facets,
        lambda some: orient_consistently(some, mesh.name),
        fill_holes,
        orient_outward,
    ]
    done: list[Repair] = []
    for step in steps:
        facets, more = step(facets)
        done += more
    if not len(facets.corners):
        raise MeshError(
            f"{mesh.name}: the facets enclose no volume",
            remedy="Close the surface of the part, or give it a thickness",
        )
    items = tuple(item.without_facets() for item in mesh.objects)
    return (Mesh(facets.triangles, mesh.name, items), Repairs(tuple(done))) if done else (mesh, Repairs())
