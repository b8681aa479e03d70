"""Formats that are read as a whole: PLY and OFF."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from printer_slicer.errors import MeshError
from printer_slicer.mesh_io.files import without_byte_order_mark
from printer_slicer.mesh_io.off import read_off
from printer_slicer.mesh_io.ply import read_ply
from printer_slicer.mesh_io.soundness import COPY_AGAIN

if TYPE_CHECKING:
    from pathlib import Path

    from printer_slicer.arrays import Float
    from printer_slicer.mesh_io.limits import Limits

__all__ = ["read_other"]


def read_other(data: bytes, kind: str, path: Path, limits: Limits) -> Float:
    """(F, 3, 3) corners of a PLY or OFF, in the file's unit.

    Raises:
        MeshError: it is no sound file.
    """
    try:
        return _READERS[kind](without_byte_order_mark(data), path, limits)
    except MeshError:
        raise
    except (ValueError, LookupError, TypeError, ArithmeticError) as error:
        reason = str(error).partition("\n")[0][:200] or type(error).__name__
        raise MeshError(f"{path}: not a sound .{kind} file: {reason}", remedy=COPY_AGAIN) from error


_READERS: Final = {"ply": read_ply, "off": read_off}
