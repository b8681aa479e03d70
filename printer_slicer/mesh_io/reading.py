"""Read a model file of any supported format into a `Model`."""

from __future__ import annotations

import re
from pathlib import Path
from types import NoneType
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from printer_slicer.arguments import PATH, check_arguments
from printer_slicer.deprecation import renamed_method
from printer_slicer.errors import MeshError, UsageError
from printer_slicer.mesh_io.ascii_stl import is_ascii_stl, read_ascii_stl
from printer_slicer.mesh_io.binary_stl import has_binary_stl_size, read_binary_stl
from printer_slicer.mesh_io.files import ModelFile, Progress, open_model_file, strip_byte_order_mark
from printer_slicer.mesh_io.limits import LIMITS, Limits
from printer_slicer.mesh_io.soundness import COPY_AGAIN, drop_degenerate_facets, facet_blocks
from printer_slicer.mesh_io.units import UNITS, check_unit, unit_advice
from printer_slicer.model import Mesh, PlateObject
from printer_slicer.values import Struct, replace

if TYPE_CHECKING:
    import os

    from printer_slicer.arrays import Float
    from printer_slicer.model import Volumes

__all__ = ["FORMATS", "Model", "load_mesh", "load_model"]

FORMATS: Final = ("stl", "3mf", "obj", "ply", "off", "glb", "gltf", "step")
"""Extensions of the formats that can be read, without dot."""
ALIASES: Final = {"stp": "step"}

MAGIC: Final = (
    (b"PK\x03\x04", "3mf"),
    (b"glTF", "glb"),
    (b"ISO-10303-21", "step"),
    (b"ply", "ply"),
    (b"OFF", "off"),
)
"""First bytes of the formats; unambiguous ones come first."""
COMPRESSED: Final = (
    b"\x1f\x8b",
    b"7z\xbc\xaf\x27\x1c",
    b"Rar!\x1a\x07",
    b"\xfd7zXZ\0",
    b"BZh",
    b"\x28\xb5\x2f\xfd",
)
"""First bytes of compressed files: gzip, 7z, RAR, xz, bzip2, zstd."""
AMF: Final = re.compile(rb"<(\w+:)?amf[\s>]")
"""Start of an AMF file, an obsolete format that few programs still write."""
VERTEX: Final = re.compile(rb"(?<![^\r\n])[ \t]*v[ \t]+[-+.\d]")
"""Start of a vertex line in an OBJ file."""
FACE: Final = re.compile(rb"(?<![^\r\n])[ \t]*f[ \t]+[-+]?\d")
"""Start of a face line in an OBJ file."""
N_CERTAIN: Final = 3
"""Number of entries of MAGIC that take precedence over the file name."""


class Model(Struct, frozen=True, eq=False):
    """A part read from a file.

    Attributes:
        mesh: the mesh in mm, positioned as in the file.
        path: the file.
        kind: format, one of FORMATS.
        unit: unit assumed for the coordinates, a key in `UNITS`.
        n_folded: number of facets with two equal corners; they have no area and were dropped.
        notes: warnings.
    """

    mesh: Mesh
    path: Path
    kind: str
    unit: str
    n_folded: int = 0
    notes: tuple[str, ...] = ()

    def size_warning(self, room: Float | None = None) -> str:
        """Warn about an implausible size and name the probable unit; empty if the size is plausible.

        Args:
            room: (3,) build volume of the printer, mm; None: 2 m along each axis.
        """
        size = self.mesh.size
        advice = unit_advice(size, self.unit, room, certain=self.kind == "step")
        if not advice:
            return ""
        extent = " x ".join(f"{length:.4g}" for length in size.tolist())
        return (
            f"{self.path.name}: the part is only {extent} mm; {advice}"
            if float(size.max()) < 10
            else (f"{self.path.name}: the part is {extent} mm; {advice}")
        )

    doubts = renamed_method("Model.doubts", "Model.size_warning")


def _ignore_progress(_share: float) -> None:
    """Do nothing with the fraction read, when no progress is to be reported."""


@check_arguments(path=PATH, units=(str, NoneType))
def load_mesh(path: str | os.PathLike[str], *, units: str | None = None, limits: Limits = LIMITS) -> Mesh:
    """Load the mesh of a file in mm; it stays where the file places it and is not moved to the bed.

    Reads binary and ASCII STL, 3MF, OBJ, PLY, OFF, GLB, glTF and, with the extra `step`, STEP. The first bytes of the
    file decide the format, else the extension. Several solids or objects become one mesh, as the file places them.

    Args:
        path: the file.
        units: unit of the coordinates, a key in `UNITS`; None: the unit that the file states, else mm.
        limits: maximum sizes and counts.

    Raises:
        UsageError: the file cannot be read, or its format or the unit is unknown.
        MeshError: the file does not hold a part or exceeds a limit.
    """
    return load_model(path, units=units, limits=limits).mesh


@check_arguments(path=PATH, units=(str, NoneType))
def load_model(
    path: str | os.PathLike[str],
    *,
    units: str | None = None,
    limits: Limits = LIMITS,
    progress: Progress = _ignore_progress,
) -> Model:
    """Load a file like `load_mesh`, with information about the file.

    Args:
        path: the file.
        units: unit of the coordinates, see `load_mesh`.
        limits: maximum sizes and counts.
        progress: receives the fraction of a large file read so far, 0 to 1.

    Raises:
        UsageError, MeshError: see `load_mesh`.
    """
    path = Path(path)
    unit = check_unit(units) if units is not None else None
    with open_model_file(path, limits, progress) as source, np.errstate(all="ignore"):
        kind = _detect_format(source)
        triangles, own_unit, notes, *more = _READERS[kind](source, kind, unit, limits)
        facet_counts: list[tuple[str, int]] = more[0] if more else []
        volumes: list[Volumes | None] = more[1] if more else []
        items = _list_objects(facet_counts, triangles, path.stem)
        if len(items) > 1:
            given = volumes or [None] * len(items)
            items = tuple(replace(item, volumes=own) for item, own in zip(items, given, strict=True))
            volumes = []
        kept, n_folded = drop_degenerate_facets(triangles, path)
    items = tuple(item.without_facets() for item in items) if n_folded else items
    return Model(
        Mesh(kept, path.stem, items, volumes[0] if volumes else None),
        path,
        kind,
        own_unit,
        n_folded,
        tuple(notes),
    )


def _list_objects(
    facet_counts: list[tuple[str, int]], triangles: Float, name: str
) -> tuple[PlateObject, ...]:
    """Return the objects of a file; empty for a single unnamed object. `name` is for unnamed objects."""
    first, items = 0, []
    for label, count in (
        facet_counts if len(facet_counts) > 1 or (facet_counts and facet_counts[0][0]) else []
    ):
        bounds = Mesh(triangles[first : first + count]).bounds
        items.append(PlateObject.of(label or name, bounds, first, count))
        first += count
    return tuple(items)


def _detect_format(source: ModelFile) -> str:
    """Detect the format of a file by unambiguous first bytes, then by its extension, then by its content."""
    if has_binary_stl_size(source):
        return "stl"
    if source.head.startswith(COMPRESSED):
        raise UsageError(
            f"{source.path}: the file is a compressed archive, not a model",
            remedy="Unpack it and give the path of the model in it",
        )
    suffix = source.path.suffix.lower().removeprefix(".")
    suffix = ALIASES.get(suffix, suffix)
    for number, (magic, kind) in enumerate(MAGIC):
        if (
            source.head.startswith(magic)
            and (number < N_CERTAIN or suffix not in FORMATS)
            and suffix != "amf"
        ):
            return kind
    if suffix in FORMATS:
        return suffix
    if suffix == "amf" or AMF.search(source.head[:4096]):
        raise UsageError(
            f"{source.path}: AMF files are not supported", remedy="Export the part as 3MF or STL"
        )
    if is_ascii_stl(source):
        return "stl"
    if VERTEX.search(source.head) and FACE.search(source.read_all(LIMITS.text_bytes)):
        return "obj"
    names = ", ".join(f".{name}" for name in FORMATS)
    raise UsageError(
        f"{source.path}: the file is not a model in a supported format",
        remedy=f"Export the part as one of {names}",
    )


# Readers: source, format, requested unit, limits -> corners in mm, unit, warnings, and, if the file names its objects,
# the name and the number of facets of each, in order, and the volumes that are not printed.
# Each reader imports its module when it is called, because most parts are STL.

Result = tuple[Any, ...]


def _read_stl(source: ModelFile, _kind: str, unit: str | None, limits: Limits) -> Result:
    if not has_binary_stl_size(source) and is_ascii_stl(source):
        triangles, notes = read_ascii_stl(source, limits)
    else:
        triangles, notes = read_binary_stl(source, limits)
    return _scale_to_mm(triangles, unit or "mm"), unit or "mm", notes


def _read_3mf(source: ModelFile, _kind: str, unit: str | None, limits: Limits) -> Result:
    from printer_slicer.mesh_io.archive import open_archive  # noqa: PLC0415
    from printer_slicer.mesh_io.three_mf import read_three_mf  # noqa: PLC0415

    with open_archive(source, limits) as archive:
        return read_three_mf(archive, limits, unit)


def _read_glb(source: ModelFile, _kind: str, unit: str | None, limits: Limits) -> Result:
    from printer_slicer.mesh_io.gltf import read_glb  # noqa: PLC0415

    return read_glb(source.read_all(limits.text_bytes), source.path, limits, unit)


def _read_gltf(source: ModelFile, _kind: str, unit: str | None, limits: Limits) -> Result:
    from printer_slicer.mesh_io.gltf import read_gltf  # noqa: PLC0415

    return read_gltf(source.read_all(limits.text_bytes), source.path, limits, unit)


def _read_step(source: ModelFile, _kind: str, unit: str | None, limits: Limits) -> Result:
    from printer_slicer.mesh_io.step import read_step  # noqa: PLC0415

    if unit is not None:
        raise UsageError(f"{source.path}: a STEP file states its own unit", remedy="Use `scale` instead")
    return read_step(source.read_all(limits.text_bytes), source.path, limits)


def _read_obj(source: ModelFile, _kind: str, unit: str | None, limits: Limits) -> Result:
    from printer_slicer.mesh_io.obj import read_obj  # noqa: PLC0415

    triangles, notes = read_obj(source, limits)
    return _scale_to_mm(triangles, unit or "mm"), unit or "mm", notes


def _read_table(source: ModelFile, kind: str, unit: str | None, limits: Limits) -> Result:
    from printer_slicer.mesh_io.off import read_off  # noqa: PLC0415
    from printer_slicer.mesh_io.ply import read_ply  # noqa: PLC0415

    read = read_ply if kind == "ply" else read_off
    try:
        triangles = read(strip_byte_order_mark(source.read_all(limits.text_bytes)), source.path, limits)
    except MeshError:
        raise
    except (ValueError, LookupError, TypeError, ArithmeticError) as error:
        reason = str(error).partition("\n")[0][:200] or type(error).__name__
        raise MeshError(f"{source.path}: not a valid .{kind} file: {reason}", remedy=COPY_AGAIN) from error
    return _scale_to_mm(triangles, unit or "mm"), unit or "mm", []


_READERS: Final = {
    "stl": _read_stl,
    "3mf": _read_3mf,
    "obj": _read_obj,
    "ply": _read_table,
    "off": _read_table,
    "glb": _read_glb,
    "gltf": _read_gltf,
    "step": _read_step,
}


def _scale_to_mm(triangles: Float, unit: str) -> Float:
    """Scale the triangles to mm in place."""
    if UNITS[unit] != 1:
        for block in facet_blocks(len(triangles)):
            triangles[block] *= UNITS[unit]
    return triangles
