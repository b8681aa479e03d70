"""Convert STEP files to facets with OpenCASCADE (the optional package cascadio) in a separate process.

The library is written in C++ and reads untrusted files; a crash in it must not end this process.
"""

from __future__ import annotations

import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Final

from printer_slicer.errors import MeshError, UsageError
from printer_slicer.mesh_io.gltf import read_glb
from printer_slicer.mesh_io.soundness import COPY_AGAIN

if TYPE_CHECKING:
    from printer_slicer.arrays import Float
    from printer_slicer.mesh_io.limits import Limits

__all__ = ["STEP_ANGLE", "STEP_TOLERANCE", "read_step"]

STEP_TOLERANCE: Final = 0.01
"""Maximum deviation of the facets from the surface, mm; contours are simplified by about as much."""
STEP_ANGLE: Final = 0.2
"""Maximum angle between the normals of neighbouring facets of a curved surface, rad."""

_MAX_SHOWN: Final = 200  # characters of the output of OpenCASCADE in a message

CONVERSION_SCRIPT: Final = """
import sys
import cascadio
cascadio.step_to_glb(sys.argv[1], sys.argv[2], float(sys.argv[3]), float(sys.argv[4]), False, True, False)
"""


def read_step(data: bytes, path: Path, limits: Limits) -> tuple[Float, str, list[str]]:
    """Read all solids of a STEP file.

    Args:
        data: content of the file.
        path: path of the file, for messages.
        limits: limits for the result.

    Returns:
        Corners (F, 3, 3), mm; "mm"; warnings.

    Raises:
        UsageError: cascadio is not installed.
        MeshError: the STEP file is not valid or has no solids.
    """
    if not _is_installed("cascadio"):
        raise UsageError(
            f"{path}: reading STEP files needs the package cascadio",
            remedy="Run python -m pip install 'printer-slicer[step]', or export the part as STL or 3MF",
        )
    # Use our own file name: the library must not see an untrusted name or guess the format from it.
    with TemporaryDirectory(prefix="printer-slicer-") as folder:
        given, made = Path(folder, "part.step"), Path(folder, "part.glb")
        given.write_bytes(data)
        _run_conversion([str(given), str(made), str(STEP_TOLERANCE), str(STEP_ANGLE)], path, limits)
        if not made.is_file() or not (converted := made.read_bytes()):
            raise MeshError(f"{path}: not a valid STEP file, or it contains no solids", remedy=COPY_AGAIN)
    # Found by testing: it writes metres, as glTF requires, but leaves z up.
    triangles, _, notes = read_glb(converted, path, limits, "m", y_up=False)
    return triangles, "mm", notes


def _is_installed(name: str) -> bool:
    """Return whether a package can be imported, without importing it."""
    try:
        return find_spec(name) is not None
    except (ImportError, ValueError):  # the import is blocked
        return False


def _run_conversion(arguments: list[str], path: Path, limits: Limits) -> None:
    """Convert STEP to GLB in a separate process.

    Raises:
        MeshError: the conversion takes too long or fails.
    """
    try:
        done = subprocess.run(  # noqa: S603 - ourselves, and names that we made
            [sys.executable, "-c", CONVERSION_SCRIPT, *arguments],
            stdin=subprocess.DEVNULL,
            capture_output=True,
            timeout=limits.step_seconds,
            check=False,
        )
    except subprocess.TimeoutExpired as error:
        raise MeshError(
            f"{path}: the STEP conversion took longer than {limits.step_seconds:g} s",
            remedy="Export the part as STL or 3MF from CAD",
        ) from error
    if done.returncode:
        words = done.stderr.decode("utf-8", "replace").strip().splitlines()
        why = words[-1][:_MAX_SHOWN] if words else f"exit code {done.returncode}"
        raise MeshError(
            f"{path}: OpenCASCADE cannot convert the file: {why}",
            remedy="Export the part as STL or 3MF from CAD",
        )
