"""glTF as a text, with its numbers in it or in files beside it.

Only what is in the folder of the model, or below it, becomes part of it.
"""

from __future__ import annotations

import base64
import errno
import json
from typing import TYPE_CHECKING, Any, Final
from urllib.parse import unquote

from printer_slicer.errors import MeshError
from printer_slicer.input_files import read_input
from printer_slicer.mesh_io.files import without_byte_order_mark
from printer_slicer.mesh_io.glb import FAULTS, check_extensions, read_scene, reason_of
from printer_slicer.mesh_io.soundness import EXPORT_AGAIN

if TYPE_CHECKING:
    from pathlib import Path

    from printer_slicer.arrays import Float
    from printer_slicer.mesh_io.limits import Limits

__all__ = ["read_gltf"]

TOGETHER: Final = "Keep the files of a glTF together, or export it as GLB."


def read_gltf(
    data: bytes, path: Path, limits: Limits, unit: str | None = None
) -> tuple[Float, str, list[str]]:
    """(F, 3, 3) mm, corners of all meshes of the scene, z up; the unit, m if none is asked for; what deserves a look.

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
        _check_version(tree)
        check_extensions(tree, path)
        buffers = _buffers(tree, path, limits.file_bytes - len(data))
        return read_scene(tree, buffers, path, limits, unit)
    except FAULTS as error:
        raise MeshError(f"{path}: not a sound .gltf file: {reason_of(error)}", remedy=EXPORT_AGAIN) from error


def _check_version(tree: object) -> None:
    if not isinstance(tree, dict):
        raise TypeError("no JSON object")
    version = str(tree.get("asset", {}).get("version", "2.0"))
    if not version.startswith("2."):
        raise ValueError(f"glTF of version {version[:20]}; 2.0 is read")


def _buffers(tree: dict[str, Any], path: Path, left: int) -> dict[int, bytes]:
    """The bytes of each buffer, by its number.

    Args:
        tree: of the file.
        path: of the file.
        left: bytes that all of them may have.

    Raises:
        MeshError: one cannot be had.
    """
    found: dict[int, bytes] = {}
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
        found[number] = data
    return found


def _written_out(uri: str, number: int, path: Path) -> bytes:
    """The bytes that stand in the file itself."""
    kind, _, text = uri.partition(",")
    try:
        data = base64.b64decode(unquote(text), validate=True)
    except ValueError:
        kind = ""
    if not kind.lower().endswith(";base64"):
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
    try:
        folder = path.parent.resolve()
        # A backslash parts folders on some systems only: taken so on all, nothing is outside on one alone.
        target = (folder / unquote(uri).replace("\\", "/")).resolve()
        if ":" in uri.partition("/")[0] or not target.is_relative_to(folder):
            raise MeshError(f"{path}: names a file outside of its folder: {uri!r}", remedy=TOGETHER)
        return read_input(target, most)
    except (FileNotFoundError, IsADirectoryError, NotADirectoryError):
        raise MeshError(f"{path}: names a file that is not beside it: {uri!r}", remedy=TOGETHER) from None
    except RuntimeError:  # of older Pythons, for links that lead to each other
        raise MeshError(f"{path}: names a link in a circle: {uri!r}", remedy=TOGETHER) from None
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        if isinstance(error, OSError) and error.errno == errno.EFBIG:
            reason = f"it is longer than the {max(most, 0)} bytes left by the limit for all its files"
        raise MeshError(
            f"{path}: names a file that cannot be read: {uri!r}: {reason}", remedy=TOGETHER
        ) from None
