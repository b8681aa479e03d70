"""glTF as a text, with its numbers in it or in files beside it: read by trimesh, whose import takes half a second.

The files are opened here, not by trimesh: only what is in the folder of the model, or below it, becomes part of it.
"""

from __future__ import annotations

import base64
import errno
import io
import json
import logging
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Final
from urllib.parse import unquote

import numpy as np

from printer_slicer.errors import MeshError
from printer_slicer.input_files import read_input
from printer_slicer.mesh_io.files import without_byte_order_mark
from printer_slicer.mesh_io.limits import check_facets
from printer_slicer.mesh_io.soundness import EXPORT_AGAIN
from printer_slicer.mesh_io.units import UNITS

if TYPE_CHECKING:
    from pathlib import Path

    from printer_slicer.mesh_io.limits import Limits
    from printer_slicer.model import Float

__all__ = ["read_gltf"]

TOGETHER: Final = "Keep the files of a glTF together, or export it as GLB."


def read_gltf(
    data: bytes, path: Path, limits: Limits, unit: str | None = None
) -> tuple[Float, str, list[str]]:
    """(F, 3, 3) mm, corners of all meshes of the scene, z up; the unit, m if none is asked for; no notes.

    Args:
        data: the text.
        path: where it is from; files that it names are looked for in its folder.
        limits: of the bytes in all files together, and of the facets.
        unit: what the numbers mean, a key in `UNITS`.

    Raises:
        MeshError: it is no sound file, a file it names is missing or outside of its folder, or it has too many facets.
    """
    try:
        tree = json.loads(without_byte_order_mark(data))
    except (ValueError, RecursionError) as error:
        raise _unsound(path, error) from error
    if not isinstance(tree, dict):
        raise MeshError(f"{path}: not a sound .gltf file: no JSON object", remedy=EXPORT_AGAIN)
    buffers = _buffers(tree, path, limits.file_bytes - len(data))
    with _silence():
        try:
            triangles = _triangles(tree, buffers, path, limits)
        except MeshError:
            raise
        except Exception as error:  # trimesh fails in all ways there are
            raise _unsound(path, error) from error
    own = unit or "m"
    return triangles[:, :, [0, 2, 1]] * [1.0, -1.0, 1.0] * UNITS[own], own, []


def _unsound(path: Path, error: Exception) -> MeshError:
    """What to say where reading failed; of an error without words, that something does not fit."""
    reason = str(error).partition("\n")[0][:200]
    if isinstance(error, KeyError):
        reason = f"no {reason}"
    reason = reason or "what it says of its meshes does not fit together"
    return MeshError(f"{path}: not a sound .gltf file: {reason}", remedy=EXPORT_AGAIN)


def _triangles(tree: dict[str, Any], buffers: dict[str, bytes], path: Path, limits: Limits) -> Float:
    """(F, 3, 3) corners of all meshes, in units of the file; `buffers` by the names that the tree has for them."""
    import trimesh  # noqa: PLC0415 - most parts are STL

    text = io.BytesIO(json.dumps(tree).encode())
    loaded: Any = trimesh.load(
        text, file_type="gltf", resolver=buffers, force="scene", process=False, skip_materials=True
    )
    meshes = [one for one in loaded.dump() if isinstance(one, trimesh.Trimesh)]
    check_facets(sum(len(one.faces) for one in meshes), path, limits)
    return np.concatenate([np.zeros((0, 3, 3)), *(_corners(one) for one in meshes)])


def _buffers(tree: dict[str, Any], path: Path, left: int) -> dict[str, bytes]:
    """The bytes of each buffer, by its number, which becomes its name in the tree; images are taken out.

    Args:
        tree: of the file; changed.
        path: of the file.
        left: bytes that all of them may have.

    Raises:
        MeshError: one cannot be had.
    """
    found: dict[str, bytes] = {}
    tree.pop("images", None)
    buffers = tree.get("buffers", [])
    if not isinstance(buffers, list):
        raise MeshError(f"{path}: not a sound .gltf file: 'buffers' is no list", remedy=EXPORT_AGAIN)
    for number, buffer in enumerate(buffers):
        uri = buffer.get("uri") if isinstance(buffer, dict) else None
        if not isinstance(uri, str):
            raise MeshError(
                f"{path}: not a sound .gltf file: buffer {number} has no 'uri'", remedy=EXPORT_AGAIN
            )
        data = _written_out(uri, number, path) if uri[:5].lower() == "data:" else _beside(uri, path, left)
        wanted = buffer.get("byteLength")
        if isinstance(wanted, int) and len(data) < wanted:
            raise MeshError(f"{path}: buffer {number} has {len(data)} of {wanted} bytes", remedy=EXPORT_AGAIN)
        left -= len(data)
        buffer["uri"] = str(number)
        found[str(number)] = data
    return found


def _written_out(uri: str, number: int, path: Path) -> bytes:
    """The bytes that stand in the file itself."""
    kind, _, text = uri.partition(",")
    try:
        data = base64.b64decode(unquote(text), validate=True)
    except ValueError:
        kind = ""
    if not kind.endswith(";base64"):
        raise MeshError(
            f"{path}: not a sound .gltf file: buffer {number} is not valid base64", remedy=EXPORT_AGAIN
        )
    return data


def _beside(uri: str, path: Path, most: int) -> bytes:
    """The bytes of a file in the folder of the model, or below it.

    Args:
        uri: its name, relative to the folder; special characters may be encoded as in URLs.
        path: of the model.
        most: bytes to be read.

    Raises:
        MeshError: it is elsewhere, missing or too long.
    """
    folder = path.parent.resolve()
    try:
        # A backslash parts folders on some systems only: taken so on all, nothing is outside on one alone.
        target = (folder / unquote(uri).replace("\\", "/")).resolve()
        if ":" in uri.partition("/")[0] or not target.is_relative_to(folder):
            raise MeshError(f"{path}: names a file outside of its folder: {uri!r}", remedy=TOGETHER)
        return read_input(target, most)
    except (FileNotFoundError, IsADirectoryError, NotADirectoryError):
        raise MeshError(f"{path}: names a file that is not beside it: {uri!r}", remedy=TOGETHER) from None
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        if isinstance(error, OSError) and error.errno == errno.EFBIG:
            reason = f"it is longer than the {max(most, 0)} bytes left by the limit for all its files"
        raise MeshError(
            f"{path}: names a file that cannot be read: {uri!r}: {reason}", remedy=TOGETHER
        ) from None


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
