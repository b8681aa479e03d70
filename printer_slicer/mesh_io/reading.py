"""Read a model file of any supported format into a `Model`."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from printer_slicer.errors import MeshError, UsageError
from printer_slicer.mesh_io.ascii_stl import is_ascii_stl, read_ascii_stl
from printer_slicer.mesh_io.binary_stl import is_sized_binary_stl, read_binary_stl
from printer_slicer.mesh_io.files import ModelFile, Progress, open_model_file, strip_byte_order_mark
from printer_slicer.mesh_io.limits import LIMITS, Limits
from printer_slicer.mesh_io.soundness import COPY_AGAIN, blocks, drop_folded_facets
from printer_slicer.mesh_io.units import UNITS, check_unit, unit_advice
from printer_slicer.model import Mesh, PlateObject

if TYPE_CHECKING:
    import os

    from printer_slicer.arrays import Float

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
"""How files begin; those that no other format can begin with come first."""
PACKED: Final = (
    b"\x1f\x8b",
    b"7z\xbc\xaf\x27\x1c",
    b"Rar!\x1a\x07",
    b"\xfd7zXZ\0",
    b"BZh",
    b"\x28\xb5\x2f\xfd",
)
"""How files that programs have packed begin: gzip, 7z, RAR, xz, bzip2, zstd."""
AMF: Final = re.compile(rb"<(\w+:)?amf[\s>]")
"""What an AMF begins with, a format that was given up: few programs still write it."""
VERTEX: Final = re.compile(rb"(?<![^\r\n])[ \t]*v[ \t]+[-+.\d]")
FACE: Final = re.compile(rb"(?<![^\r\n])[ \t]*f[ \t]+[-+]?\d")
"""How lines of an OBJ begin."""
N_CERTAIN: Final = 3
"""So many entries of MAGIC say more than the name of the file does."""


@dataclass(frozen=True, slots=True, eq=False)
class Model:
    """A part as it was read.

    Attributes:
        mesh: in mm, where the file has it.
        path: the file.
        kind: its format, one of FORMATS.
        unit: what its numbers were taken to mean, a key in `UNITS`.
        n_folded: facets with two equal corners; they have no area and were left out.
        notes: what deserves a look, for people.
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
            room: (3,) what the printer prints, mm; None: 2 m each way.
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


def _quiet(_share: float) -> None:
    """A `progress` that says nothing."""


def load_mesh(path: str | os.PathLike[str], *, units: str | None = None, limits: Limits = LIMITS) -> Mesh:
    """Mesh in a file, in mm, where the file has it: it is not moved to the bed.

    Binary and ASCII STL, 3MF, OBJ, PLY, OFF, GLB, glTF and, with the extra `step`, STEP, known by what they begin with
    and else by extension. Several solids or objects in a file become one mesh, as the file places them.

    Args:
        path: of the file.
        units: what the numbers in the file mean, a key in `UNITS`; None: what the file says, else mm.
        limits: beyond which a file is refused.

    Raises:
        UsageError: the file cannot be read, its format is not known, or the unit is not.
        MeshError: what is in the file is not a part, or goes beyond a limit.
    """
    return load_model(path, units=units, limits=limits).mesh


def load_model(
    path: str | os.PathLike[str],
    *,
    units: str | None = None,
    limits: Limits = LIMITS,
    progress: Progress = _quiet,
) -> Model:
    """The same as `load_mesh`, with what is known about the file.

    Args:
        path: of the file.
        units: what the numbers in the file mean, as for `load_mesh`.
        limits: beyond which a file is refused.
        progress: is told the share of a large file that has been read, 0 to 1.

    Raises:
        UsageError, MeshError: as for `load_mesh`.
    """
    path = Path(path)
    unit = check_unit(units) if units is not None else None
    with open_model_file(path, limits, progress) as source, np.errstate(all="ignore"):
        kind = _kind(source)
        triangles, own_unit, notes, *shares = _READERS[kind](source, kind, unit, limits)
        items = _items(shares[0] if shares else [], triangles, path.stem)
        kept, n_folded = drop_folded_facets(triangles, path)
    items = tuple(item.without_facets() for item in items) if n_folded else items
    return Model(Mesh(kept, path.stem, items), path, kind, own_unit, n_folded, tuple(notes))


def _items(shares: list[tuple[str, int]], triangles: Float, name: str) -> tuple[PlateObject, ...]:
    """The things in a file, if there are several, or one with a name; others are called as the file."""
    begin, items = 0, []
    for label, count in shares if len(shares) > 1 or (shares and shares[0][0]) else []:
        bounds = Mesh(triangles[begin : begin + count]).bounds
        items.append(PlateObject.of(label or name, bounds, begin, count))
        begin += count
    return tuple(items)


def _kind(source: ModelFile) -> str:
    """The format: by what the file begins with where that is certain, else by its extension, else by its content."""
    if is_sized_binary_stl(source):
        return "stl"
    if source.head.startswith(PACKED):
        raise UsageError(
            f"{source.path}: a compressed archive, not a model",
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
    if VERTEX.search(source.head) and FACE.search(source.whole(LIMITS.text_bytes)):
        return "obj"
    names = ", ".join(f".{name}" for name in FORMATS)
    raise UsageError(
        f"{source.path}: not a model in a supported format", remedy=f"Export the part as one of {names}"
    )


# Readers: source, format, unit asked for, limits -> corners in mm, unit, notes, and where a file says so, the names of
# the things in it with the number of their facets, which come in turn.
# Each imports its module when it is called: most parts are STL.

Result = tuple["Float", str, list[str]] | tuple["Float", str, list[str], list[tuple[str, int]]]


def _read_stl(source: ModelFile, _kind: str, unit: str | None, limits: Limits) -> Result:
    if not is_sized_binary_stl(source) and is_ascii_stl(source):
        triangles, notes = read_ascii_stl(source, limits)
    else:
        triangles, notes = read_binary_stl(source, limits)
    return _scaled(triangles, unit or "mm"), unit or "mm", notes


def _read_zip(source: ModelFile, _kind: str, unit: str | None, limits: Limits) -> Result:
    from printer_slicer.mesh_io.archive import open_archive  # noqa: PLC0415
    from printer_slicer.mesh_io.three_mf import read_three_mf  # noqa: PLC0415

    with open_archive(source, limits) as archive:
        return read_three_mf(archive, limits, unit)


def _read_glb(source: ModelFile, _kind: str, unit: str | None, limits: Limits) -> Result:
    from printer_slicer.mesh_io.gltf import read_glb  # noqa: PLC0415

    return read_glb(source.whole(limits.text_bytes), source.path, limits, unit)


def _read_gltf(source: ModelFile, _kind: str, unit: str | None, limits: Limits) -> Result:
    from printer_slicer.mesh_io.gltf import read_gltf  # noqa: PLC0415

    return read_gltf(source.whole(limits.text_bytes), source.path, limits, unit)


def _read_step(source: ModelFile, _kind: str, unit: str | None, limits: Limits) -> Result:
    from printer_slicer.mesh_io.step import read_step  # noqa: PLC0415

    if unit is not None:
        raise UsageError(f"{source.path}: a STEP file states its own unit", remedy="Use --scale instead")
    return read_step(source.whole(limits.text_bytes), source.path, limits)


def _read_obj(source: ModelFile, _kind: str, unit: str | None, limits: Limits) -> Result:
    from printer_slicer.mesh_io.obj import read_obj  # noqa: PLC0415

    triangles, notes = read_obj(source, limits)
    return _scaled(triangles, unit or "mm"), unit or "mm", notes


def _read_table(source: ModelFile, kind: str, unit: str | None, limits: Limits) -> Result:
    from printer_slicer.mesh_io.off import read_off  # noqa: PLC0415
    from printer_slicer.mesh_io.ply import read_ply  # noqa: PLC0415

    read = read_ply if kind == "ply" else read_off
    try:
        triangles = read(strip_byte_order_mark(source.whole(limits.text_bytes)), source.path, limits)
    except MeshError:
        raise
    except (ValueError, LookupError, TypeError, ArithmeticError) as error:
        reason = str(error).partition("\n")[0][:200] or type(error).__name__
        raise MeshError(f"{source.path}: not a valid .{kind} file: {reason}", remedy=COPY_AGAIN) from error
    return _scaled(triangles, unit or "mm"), unit or "mm", []


_READERS: Final = {
    "stl": _read_stl,
    "3mf": _read_zip,
    "obj": _read_obj,
    "ply": _read_table,
    "off": _read_table,
    "glb": _read_glb,
    "gltf": _read_gltf,
    "step": _read_step,
}


def _scaled(triangles: Float, unit: str) -> Float:
    """The triangles in mm, in place."""
    if UNITS[unit] != 1:
        for block in blocks(len(triangles)):
            triangles[block] *= UNITS[unit]
    return triangles
