"""glTF as a text, with its numbers in it or in files beside it: read by trimesh, whose import takes half a second."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np

from printer_slicer.errors import MeshError
from printer_slicer.mesh_io.limits import check_facets
from printer_slicer.mesh_io.soundness import EXPORT_AGAIN
from printer_slicer.mesh_io.units import UNITS

if TYPE_CHECKING:
    from pathlib import Path

    from printer_slicer.mesh_io.limits import Limits
    from printer_slicer.model import Float

__all__ = ["read_gltf"]


def read_gltf(path: Path, limits: Limits, unit: str | None = None) -> tuple[Float, str, list[str]]:
    """(F, 3, 3) mm, corners of all meshes of the scene, z up; the unit, m if none is asked for; no notes.

    Raises:
        MeshError: it is no sound file, a file it names is missing, or it has too many facets.
    """
    with _silence():
        import trimesh  # noqa: PLC0415 - most parts are STL

        try:
            loaded: Any = trimesh.load(
                path, file_type="gltf", force="scene", process=False, skip_materials=True
            )
            meshes = [one for one in loaded.dump() if isinstance(one, trimesh.Trimesh)]
            check_facets(sum(len(one.faces) for one in meshes), path, limits)
            triangles = np.concatenate([np.zeros((0, 3, 3)), *(_corners(one) for one in meshes)])
        except MeshError:
            raise
        except FileNotFoundError as error:
            raise MeshError(
                f"{path}: names a file that is not beside it: {error.filename}",
                remedy="Keep the files of a glTF together, or export it as GLB.",
            ) from error
        except Exception as error:  # trimesh fails in all ways there are
            reason = str(error).partition("\n")[0][:200] or type(error).__name__
            raise MeshError(f"{path}: not a sound .gltf file: {reason}", remedy=EXPORT_AGAIN) from error
    own = unit or "m"
    return triangles[:, :, [0, 2, 1]] * [1.0, -1.0, 1.0] * UNITS[own], own, []


def _corners(mesh: Any) -> Float:
    """(F, 3, 3) corners of a mesh, whose numbers trimesh does not check."""
    faces, vertices = np.asarray(mesh.faces), np.asarray(mesh.vertices, dtype=np.float64)
    if not len(faces):
        return np.zeros((0, 3, 3))
    if vertices.ndim != 2 or vertices.shape[1] != 3 or faces.ndim != 2 or faces.shape[1] != 3:
        raise ValueError(f"vertices of shape {vertices.shape}, facets of shape {faces.shape}")
    if not (faces.min() >= 0 and faces.max() < len(vertices)):
        raise ValueError(f"a facet with a vertex that is not one of {len(vertices)}")
    corners: Float = vertices[faces]
    return corners


@contextmanager
def _silence() -> Iterator[None]:
    """What trimesh logs about a file is told by our own errors, or nobody's concern."""
    log = logging.getLogger("trimesh")
    before, log.disabled = log.disabled, True
    try:
        with np.errstate(all="ignore"):
            yield
    finally:
        log.disabled = before
