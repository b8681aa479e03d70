"""Formats that are read as a whole: PLY and OFF here, OBJ by trimesh, whose import takes half a second."""

from __future__ import annotations

import io
import logging
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from printer_slicer.errors import MeshError, UsageError
from printer_slicer.mesh_io.files import without_byte_order_mark
from printer_slicer.mesh_io.limits import check_facets
from printer_slicer.mesh_io.off import read_off
from printer_slicer.mesh_io.ply import read_ply
from printer_slicer.mesh_io.soundness import COPY_AGAIN

if TYPE_CHECKING:
    from pathlib import Path

    from printer_slicer.mesh_io.limits import Limits
    from printer_slicer.model import Float

__all__ = ["read_other"]


def read_other(data: bytes, kind: str, path: Path, limits: Limits) -> Float:
    """(F, 3, 3) corners of an OBJ, PLY or OFF, in the file's unit.

    Raises:
        UsageError: trimesh is needed and not installed.
        MeshError: it is no sound file.
    """
    try:
        return _READERS[kind](without_byte_order_mark(data), path, limits)
    except ImportError as error:
        raise UsageError(
            f"{path}: reading .{kind} needs a module that is not there: {error}",
            remedy="python -m pip install trimesh",
        ) from error
    except MeshError:
        raise
    except Exception as error:  # trimesh fails in all ways there are
        reason = str(error).partition("\n")[0][:200] or type(error).__name__
        raise MeshError(f"{path}: not a sound .{kind} file: {reason}", remedy=COPY_AGAIN) from error


def _read_obj(data: bytes, path: Path, limits: Limits) -> Float:
    """The facets of all objects; trimesh is imported only here and only then."""
    # Comments in old encodings: trimesh would guess, with a package that may be missing.
    data = data.decode("utf-8", "replace").encode()
    with _silence():
        import trimesh  # noqa: PLC0415 - takes half a second, and most parts are STL

        loaded: Any = trimesh.load(
            io.BytesIO(data), file_type="obj", force="scene", process=False, skip_materials=True
        )
        meshes = [one for one in loaded.geometry.values() if isinstance(one, trimesh.Trimesh)]
        check_facets(sum(len(one.faces) for one in meshes), path, limits)
        return np.concatenate([np.zeros((0, 3, 3)), *(_corners(one) for one in meshes)])


def _corners(mesh: Any) -> Float:
    """(F, 3, 3) corners of a mesh, which trimesh does not check: points in the plane, indices from the end."""
    faces, vertices = np.asarray(mesh.faces), np.asarray(mesh.vertices, dtype=np.float64)
    if len(faces) == 0:
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


_READERS: Final = {"obj": _read_obj, "ply": read_ply, "off": read_off}
