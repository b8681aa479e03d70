"""Enlarge parts that were drawn in another unit."""

from __future__ import annotations

from printer_slicer.model import Mesh

__all__ = ["printable"]

_SMALLEST, _ENLARGED = 10.0, 60.0  # mm, largest edge of a part's envelope


def printable(mesh: Mesh) -> tuple[Mesh, str]:
    """Return the mesh, enlarged if it is too small to print, and a line that says so, or an empty one."""
    largest = float(mesh.size.max())
    if largest >= _SMALLEST:
        return mesh, ""
    note = f"{mesh.name}: {largest:.3g} mm, drawn in another unit? enlarged to {_ENLARGED:g} mm"
    return Mesh(mesh.triangles * (_ENLARGED / largest), mesh.name), note
