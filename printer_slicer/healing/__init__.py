"""Repair meshes so that they bound a solid, and report each repair.

This package repairs the whole mesh as far as its edges show what is missing. Gaps that remain are closed in each
section when the mesh is cut. Each step relies on the ones before it.
"""

from __future__ import annotations

from weakref import WeakKeyDictionary

from printer_slicer.arguments import check_arguments
from printer_slicer.errors import MeshError
from printer_slicer.healing.soundness import is_sound
from printer_slicer.model import Mesh, Repairs

__all__ = ["repair", "require_no_repair"]

_repaired_meshes: WeakKeyDictionary[Mesh, bool] = WeakKeyDictionary()
"""Repaired meshes, which are not repaired again, and whether each was sound from the start."""


@check_arguments(mesh=Mesh)
def repair(mesh: Mesh) -> tuple[Mesh, Repairs]:
    """Repair a mesh so that it bounds a solid as far as possible, and report what was done.

    1. Drop duplicate facets except one, or all copies if they bound nothing.
    2. Join nearby corners at open edges, see `join_corners`; then drop new duplicates.
    3. Drop sheets without thickness that end at a closed surface.
    4. Drop loose facets that bound nothing, see `drop_loose_facets`.
    5. Make neighbours face the same way: flip the smaller part of each patch.
    6. Fill holes, see `fill_holes`.
    7. Make shells face outward, except for voids, see `orient_outward`.

    Objects whose bounding boxes are apart are repaired one by one, so that their facets stay known. A mesh that needs
    no repair is returned unchanged.

    Raises:
        MeshError: the surface is one-sided, or no facets remain.
    """
    if mesh in _repaired_meshes:
        return mesh, Repairs(sound=_repaired_meshes[mesh])
    repaired, repairs = _repair_unless_sound(mesh)
    _repaired_meshes[repaired] = repairs.sound
    return repaired, repairs


def require_no_repair(name: str, repairs: Repairs) -> None:
    """Raise an error if a mesh needed repair.

    Raises:
        MeshError: the mesh was repaired; names the first repair.
    """
    if repairs.count:
        first = repairs.done[0]
        x, y, z = first.places[0]
        raise MeshError(
            f"{name}: the mesh needs repair: {first.kind}: {first.count}, the first at x {x:.2f} y {y:.2f} z {z:.2f}",
            remedy="Leave out `strict` to slice the repaired part, or repair it in the program that made it",
        )


def _repair_unless_sound(mesh: Mesh) -> tuple[Mesh, Repairs]:
    """Run the steps that `repair` lists, unless the mesh is sound."""
    if is_sound(mesh.triangles):
        return mesh, Repairs(sound=True)
    from printer_slicer.healing.separate_objects import are_separate, repair_objects  # noqa: PLC0415 - few need it
    from printer_slicer.healing.steps import run_steps  # noqa: PLC0415 - most meshes are sound

    return repair_objects(mesh) if are_separate(mesh) else run_steps(mesh)
