"""The steps that repair a mesh, in their order."""

from __future__ import annotations

from collections.abc import Callable

from printer_slicer.errors import MeshError
from printer_slicer.healing.consistent_winding import orient_consistently
from printer_slicer.healing.duplicates import drop_duplicates, drop_sheets, join_corners
from printer_slicer.healing.facets import Facets
from printer_slicer.healing.holes import fill_holes
from printer_slicer.healing.orient_outward import orient_outward
from printer_slicer.healing.shells import drop_loose_facets
from printer_slicer.model import Mesh, Repair, Repairs

__all__ = ["run_steps"]

_Step = Callable[[Facets], tuple[Facets, list[Repair]]]


def run_steps(mesh: Mesh) -> tuple[Mesh, Repairs]:
    """Repair a mesh and report what was done; see `printer_slicer.healing.repair`.

    Raises:
        MeshError: the surface is one-sided, or no facets remain.
    """
    facets = Facets.from_triangles(mesh.triangles)
    steps: list[_Step] = [
        drop_duplicates,
        join_corners,
        drop_duplicates,
        drop_sheets,
        drop_loose_facets,
        lambda surface: orient_consistently(surface, mesh.name),
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
            remedy="Close the surface of the part in CAD, or give it a thickness",
        )
    items = tuple(item.without_facets() for item in mesh.objects)
    return (
        (Mesh(facets.triangles, mesh.name, items, mesh.volumes), Repairs(tuple(done)))
        if done
        else (mesh, Repairs())
    )
