"""STEP, turned into facets by OpenCASCADE: the optional package cascadio, in a process of its own.

That library is written in C++ and given files from anywhere; what it does to its process it does not do to ours.
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
"""mm that facets may be off the surface they stand for; contours are simplified by about as much."""
STEP_ANGLE: Final = 0.2
"""rad between the normals of neighbouring facets of a curved surface, at most."""

_SHOWN: Final = 200  # characters of what it says

CONVERT: Final = """
import sys
import cascadio
cascadio.step_to_glb(sys.argv[1], sys.argv[2], float(sys.argv[3]), float(sys.argv[4]), False, True, False)
"""


def read_step(data: bytes, path: Path, limits: Limits) -> tuple[Float, str, list[str]]:
    """Everything in a STEP file.

    Args:
        data: the file.
        path: of the file, for messages.
        limits: of what comes out.

    Returns:
        (F, 3, 3) corners, mm; "mm"; what deserves a look.

    Raises:
        UsageError: cascadio is not installed.
        MeshError: it is no sound STEP file, or one without solids.
    """
    if not _is_installed("cascadio"):
        raise UsageError(
            f"{path}: reading STEP files needs the package cascadio",
            remedy="Run python -m pip install 'printer-slicer[step]', or export the part as STL or 3MF",
        )
    # Named by us: the library must never be given a name from elsewhere, nor guess the format by it.
    with TemporaryDirectory(prefix="printer-slicer-") as folder:
        given, made = Path(folder, "part.step"), Path(folder, "part.glb")
        given.write_bytes(data)
        _convert([str(given), str(made), str(STEP_TOLERANCE), str(STEP_ANGLE)], path, limits)
        if not made.is_file() or not (converted := made.read_bytes()):
            raise MeshError(f"{path}: not a valid STEP file, or it contains no solids", remedy=COPY_AGAIN)
    # Told by trying: it writes metres as glTF wants, but leaves z up.
    triangles, _, notes = read_glb(converted, path, limits, "m", y_up=False)
    return triangles, "mm", notes


def _is_installed(name: str) -> bool:
    """Whether a package can be imported; it is not."""
    try:
        return find_spec(name) is not None
    except (ImportError, ValueError):  # somebody forbids it
        return False


def _convert(arguments: list[str], path: Path, limits: Limits) -> None:
    """STEP to GLB, in a process of its own.

    Raises:
        MeshError: it takes too long, or it fails.
    """
    try:
        done = subprocess.run(  # noqa: S603 - ourselves, and names that we made
            [sys.executable, "-c", CONVERT, *arguments],
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
        why = words[-1][:_SHOWN] if words else f"exit code {done.returncode}"
        raise MeshError(
            f"{path}: OpenCASCADE cannot convert it: {why}",
            remedy="Export the part as STL or 3MF from CAD",
        )
