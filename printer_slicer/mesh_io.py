"""A file becomes a `Mesh`, and a `Mesh` a file.

STL is read here, binary ones as one array. Every other format goes through trimesh, which is imported only
then: that import alone takes longer than reading and slicing a small part.

What a file may contain and still be a part: it has facets, all coordinates are finite, it extends in x, y and
z and it encloses a volume. Facets with two equal corners are dropped. A part whose facets all face inward is
turned inside out without a word, since only its sign is wrong. Whether the surface is closed is for the
slicer to find.
"""

from __future__ import annotations

import io
import re
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from printer_slicer.errors import MeshError, OutputError, UsageError
from printer_slicer.model import Mesh

if TYPE_CHECKING:
    import os

    from printer_slicer.model import Float, Int

__all__ = ["FORMATS", "export_stl", "load_mesh"]

FORMATS: Final = ("stl", "3mf", "obj", "ply", "off", "glb")
"""Extensions of the formats that can be read, without dot."""

MAGIC: Final = ((b"PK\x03\x04", "3mf"), (b"ply", "ply"), (b"OFF", "off"), (b"glTF", "glb"))
"""How files without a known extension begin."""

MM: Final[Mapping[str, float]] = {
    "micron": 0.001,
    "millimeter": 1.0,
    "millimeters": 1.0,
    "mm": 1.0,
    "centimeter": 10.0,
    "inch": 25.4,
    "foot": 304.8,
    "meter": 1000.0,
    "meters": 1000.0,
}
"""mm in the units that 3MF and glTF files are written in."""

Y_UP: Final = frozenset({"glb"})
"""Formats whose y axis points up by definition."""

FACET: Final = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
HEADER_SIZE: Final = 84
"""80 bytes of anything and the number of facets."""

GRAMMAR: Final = (
    b"facet normal # # # outer loop vertex # # # vertex # # # vertex # # # endloop endfacet".split()
)
"""Words of one facet of an ASCII STL; # is a number."""
COORDINATES: Final = (8, 9, 10, 12, 13, 14, 16, 17, 18)
"""Places in GRAMMAR of the nine coordinates."""

LARGEST: Final = 1e7
"""mm; a coordinate beyond 10 km is damage, and its cube would drown the volume."""

THINNEST: Final = 1e-6
"""A part that fills less than this share of its envelope is a folded sheet."""

EXPORT_AGAIN: Final = "Export the part again from the program that made it."
COPY_AGAIN: Final = "Copy or download the file again; if that does not help, export the part again."


def load_mesh(path: str | os.PathLike[str]) -> Mesh:
    """Mesh in a file, in mm, where the file has it: it is not moved to the bed.

    Binary and ASCII STL, 3MF, OBJ, PLY, OFF and GLB, known by extension and else by content. Several solids
    or objects in a file become one mesh; 3MF build items and their transforms are followed, and units are
    turned into mm where the format has any.

    Raises:
        UsageError: the file cannot be read, or its format is not known.
        MeshError: what is in the file is not a part.
    """
    path = Path(path)
    data = _read_bytes(path)
    if not data:
        raise MeshError(f"{path}: the file is empty", remedy=COPY_AGAIN)
    kind = _kind(path, data)
    if kind != "stl":
        triangles = _read_other(data, kind, path)
    elif _announces_its_size(data) or not _looks_like_ascii_stl(data):
        triangles = _read_binary_stl(data, path)
    else:
        triangles = _read_ascii_stl(data, path)
    return Mesh(_sound(triangles, path), path.stem)


def export_stl(mesh: Mesh, path: str | os.PathLike[str]) -> None:
    """Write a binary STL; the same mesh always gives the same bytes.

    Raises:
        OutputError: the file cannot be written.
    """
    facets = np.zeros(mesh.n_facets, dtype=FACET)
    facets["corners"] = mesh.triangles
    a, b, c = facets["corners"].astype(np.float64).transpose(1, 0, 2)
    normals = np.cross(b - a, c - a)
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    facets["normal"] = np.divide(normals, lengths, out=np.zeros_like(normals), where=lengths > 0)
    header = b"binary STL in mm".ljust(80) + len(facets).to_bytes(4, "little")
    try:
        Path(path).write_bytes(header + facets.tobytes())
    except OSError as error:
        raise OutputError(f"{path}: {error.strerror}", remedy="Choose another place to write to.") from error


# What kind of file


def _read_bytes(path: Path) -> bytes:
    """Contents of the file, or a `UsageError` that says why not."""
    try:
        return path.read_bytes()
    except FileNotFoundError as error:
        raise UsageError(f"{path}: no such file", remedy="Check the name and the folder.") from error
    except IsADirectoryError as error:
        raise UsageError(f"{path}: is a folder, not a file", remedy="Name one file in it.") from error
    except PermissionError as error:
        raise UsageError(f"{path}: reading it is not allowed", remedy="Check its permissions.") from error
    except OSError as error:
        raise UsageError(f"{path}: cannot be read: {error.strerror}", remedy="Check the path.") from error
    except ValueError as error:  # a zero byte in the name
        raise UsageError(f"{str(path)!r}: not a possible file name", remedy="Check the name.") from error


def _kind(path: Path, data: bytes) -> str:
    """Find the extension that fits the file: its own if known, else judged by what is inside."""
    suffix = path.suffix.lower().removeprefix(".")
    if suffix in FORMATS:
        return suffix
    if _announces_its_size(data) or _looks_like_ascii_stl(data):
        return "stl"
    for magic, kind in MAGIC:
        if data.startswith(magic):
            return kind
    if re.search(rb"(?m)^v\s+[-+.\d]", data) and re.search(rb"(?m)^f\s+-?\d", data):
        return "obj"
    names = ", ".join(f".{name}" for name in FORMATS)
    raise UsageError(f"{path}: not a mesh in any known format", remedy=f"Export the part as one of {names}.")


def _announces_its_size(data: bytes) -> bool:
    """Whether this is a binary STL of exactly the announced length.

    The word `solid` at the start says nothing: binary files begin with it too.
    """
    return len(data) >= HEADER_SIZE and len(data) == HEADER_SIZE + FACET.itemsize * _n_announced(data)


def _looks_like_ascii_stl(data: bytes) -> bool:
    """Whether it begins like an ASCII STL and has no zero byte, of which every binary one has some."""
    start = data[:1024].removeprefix(b"\xef\xbb\xbf").lstrip().lower()
    return start.startswith((b"solid", b"facet")) and b"\0" not in data


# STL


def _n_announced(data: bytes) -> int:
    """Read the number of facets from the header of a binary STL."""
    return int.from_bytes(data[HEADER_SIZE - 4 : HEADER_SIZE], "little")


def _read_binary_stl(data: bytes, path: Path) -> Float:
    """(F, 3, 3) corners of a binary STL; a tail after the last facet is allowed where it holds no facets."""
    if len(data) < HEADER_SIZE or (data.isascii() and b"\0" not in data):
        raise MeshError(f"{path}: not an STL file", remedy=EXPORT_AGAIN)
    n_announced, body = _n_announced(data), len(data) - HEADER_SIZE
    n_present = body // FACET.itemsize
    tail = data[HEADER_SIZE + n_announced * FACET.itemsize :]
    if n_announced > n_present or (len(tail) >= FACET.itemsize and tail.strip(b"\0")):
        raise MeshError(
            f"{path}: the header announces {n_announced} facets, but the file holds {n_present}",
            remedy=COPY_AGAIN,
        )
    facets = np.frombuffer(data, dtype=FACET, count=n_announced, offset=HEADER_SIZE)
    return facets["corners"].astype(np.float64)


def _read_ascii_stl(data: bytes, path: Path) -> Float:
    """(F, 3, 3) corners of an ASCII STL.

    The whole file is split into words at once, and every 21st word must be the same. Only when that fails the
    file is read line by line, to say where.
    """
    text = data.removeprefix(b"\xef\xbb\xbf").lower()
    if b"\n" not in text:
        text = text.replace(b"\r", b"\n")
    words, complete = _words_between_solids(text)
    n_words, n_facets = len(GRAMMAR), len(words) // len(GRAMMAR)
    regular = len(words) == n_words * n_facets and all(
        words[place::n_words].count(word) == n_facets for place, word in enumerate(GRAMMAR) if word != b"#"
    )
    if regular and complete:
        try:
            columns = [list(map(float, words[place::n_words])) for place in COORDINATES]
        except ValueError:
            raise _ascii_fault(text, path) from None
        corners = np.array(columns, dtype=np.float64)
        if np.isfinite(corners).all():
            return corners.T.reshape(-1, 3, 3)
    raise _ascii_fault(text, path)


def _words_between_solids(text: bytes) -> tuple[list[bytes], bool]:
    """Split all but the lines `solid name` and `endsolid name`; tell whether the last of these is an end."""
    pieces, begin, at, last = [], 0, 0, b""
    while (at := text.find(b"solid", at)) >= 0:
        line = text.rfind(b"\n", 0, at) + 1
        end = text.find(b"\n", at) % (len(text) + 1)
        prefix = text[line:at].strip()
        if prefix in (b"", b"end"):
            pieces.append(text[begin:line])
            begin, last = end, prefix
        at = end
    pieces.append(text[begin:])
    return b"\n".join(pieces).split(), last == b"end"


def _ascii_fault(text: bytes, path: Path) -> MeshError:
    """Describe the first line of an ASCII STL that is not as it should be."""
    place, inside, number = 0, False, 0

    def fault(what: str, remedy: str = EXPORT_AGAIN) -> MeshError:
        return MeshError(f"{path}, line {number}: {what}", remedy=remedy)

    for number, line in enumerate(text.rstrip().split(b"\n"), start=1):  # noqa: B007 - `fault` uses it
        words = line.split()
        if words and words[0] in (b"solid", b"endsolid"):
            if place:
                return fault("the solid ends within a facet", COPY_AGAIN)
            inside = words[0] == b"solid"
            continue
        for word in words:
            wrong = _not_as_wanted(word, place)
            if wrong:
                return fault(wrong)
            place = (place + 1) % len(GRAMMAR)
    if place:
        return fault("the file ends within a facet", COPY_AGAIN)
    return fault("the file ends without 'endsolid'" if inside else "no 'solid' here", COPY_AGAIN)


def _not_as_wanted(word: bytes, place: int) -> str:
    """Say what is wrong with a word at this place of GRAMMAR; empty when nothing is."""
    wanted = GRAMMAR[place]
    found = word[:40].decode("ascii", "replace")
    if wanted != b"#":
        return "" if word == wanted else f"'{found}' where '{wanted.decode()}' should be"
    try:
        finite = np.isfinite(float(word))
    except ValueError:
        return f"'{found}' where a number should be"
    return "" if finite or place not in COORDINATES else f"vertex with the coordinate '{found}'"


# Everything else


def _read_other(data: bytes, kind: str, path: Path) -> Float:
    """(F, 3, 3) corners of a file that trimesh can read, mm, z up."""
    try:
        import trimesh  # noqa: PLC0415 - takes half a second, and most parts are STL

        options: dict[str, Any] = {"skip_materials": True} if kind == "obj" else {}
        scene: Any = trimesh.load(io.BytesIO(data), file_type=kind, force="scene", process=False, **options)
        parts = [np.zeros((0, 3, 3))]
        for node in scene.graph.nodes_geometry:
            matrix, name = scene.graph[node]
            geometry = scene.geometry[name]
            if isinstance(geometry, trimesh.Trimesh):
                parts.append(_placed(geometry.triangles, matrix, _mm(geometry.units, path)))
    except ImportError as error:
        raise UsageError(
            f"{path}: reading .{kind} needs a module that is not there: {error}",
            remedy="python -m pip install trimesh networkx lxml",
        ) from error
    except MeshError:
        raise
    except Exception as error:  # the readers of six formats fail in all ways there are
        reason = str(error).partition("\n")[0][:200] or type(error).__name__
        raise MeshError(f"{path}: not a sound .{kind} file: {reason}", remedy=COPY_AGAIN) from error
    triangles = np.concatenate(parts)
    if kind in Y_UP:
        x, y, z = np.moveaxis(triangles, 2, 0)
        triangles = np.stack([x, -z, y], axis=2)
    return triangles


def _placed(triangles: Float, matrix: Float, scale: float) -> Float:
    """Triangles moved by a 4 x 4 matrix, then scaled; a mirror image keeps its outside out."""
    placed: Float = (triangles @ matrix[:3, :3].T + matrix[:3, 3]) * scale
    return placed[:, ::-1] if np.linalg.det(matrix[:3, :3]) < 0 else placed


def _mm(units: str | None, path: Path) -> float:
    """Length of a unit in mm; files without units are taken to be in mm."""
    if units is None:
        return 1.0
    if units not in MM:
        raise MeshError(f"{path}: lengths in '{units}'", remedy="Export the part in millimetres.")
    return MM[units]


# Is it a part


def _sound(triangles: Float, path: Path) -> Float:
    """(F, 3, 3) the triangles that bound a part, outside out, or a `MeshError` that says why not."""
    if len(triangles) == 0:
        raise MeshError(f"{path}: there are no facets in it", remedy=EXPORT_AGAIN)
    wild = np.flatnonzero(~(np.abs(triangles.reshape(-1)) < LARGEST))
    if len(wild):
        facet, value = wild[0] // 9 + 1, float(triangles.reshape(-1)[wild[0]])
        raise MeshError(
            f"{path}: facet {facet} of {len(triangles)} has the coordinate {value:g}", remedy=EXPORT_AGAIN
        )
    triangles = np.delete(triangles, _folded(triangles), axis=0)
    if len(triangles) == 0:
        raise MeshError(f"{path}: none of its facets has an area", remedy=EXPORT_AGAIN)
    # Column by column: numpy takes 25 times as long over the short axis.
    sizes = [float(np.ptp(triangles[:, :, axis])) for axis in range(3)]
    for name, size in zip("xyz", sizes, strict=True):
        if size <= 0:
            raise MeshError(f"{path}: the part is flat: it does not extend in {name}", remedy=EXPORT_AGAIN)
    volume = Mesh(triangles).volume
    if abs(volume) < THINNEST * np.prod(sizes):
        raise MeshError(
            f"{path}: the facets enclose no volume",
            remedy="Close the surface of the part, or give it a thickness.",
        )
    return triangles if volume > 0 else triangles[:, ::-1]


def _folded(triangles: Float) -> Int:
    """Find the facets with two equal corners."""
    folded = [np.zeros(0, dtype=np.int64)]
    for a, b in ((0, 1), (1, 2), (2, 0)):
        near = np.flatnonzero(triangles[:, a, 0] == triangles[:, b, 0])
        folded.append(near[(triangles[near, a] == triangles[near, b]).all(axis=1)])
    return np.concatenate(folded)
