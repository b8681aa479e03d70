"""Small hand-written files of every format; most of them contain the same box."""

from __future__ import annotations

import io
import json
import struct
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from printer_slicer.arrays import Float

__all__ = [
    "BOX",
    "CORNERS",
    "FACES",
    "MIXED",
    "QUADS",
    "ascii_stl",
    "binary_stl",
    "every_format",
    "glb",
    "glb_box",
    "item",
    "mesh_xml",
    "model_xml",
    "obj",
    "off",
    "off_of",
    "ply",
    "ply_of",
    "three_mf",
    "write",
    "zipped",
]

SIZE = (2.0, 3.0, 4.0)
CORNERS = np.array([[x, y, z] for z in (0.0, 4.0) for y in (0.0, 3.0) for x in (0.0, 2.0)])
"""(8, 3) of the box from the origin to (2, 3, 4)."""
FACES = np.array(
    [
        [0, 2, 1], [1, 2, 3], [4, 5, 6], [5, 7, 6], [0, 1, 4], [1, 5, 4],
        [2, 6, 3], [3, 6, 7], [0, 4, 2], [2, 4, 6], [1, 3, 5], [3, 7, 5],
    ]
)  # fmt: skip
"""(12, 3) its facets, outside out."""
QUADS = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]
MIXED = [[0, 2, 3], [0, 3, 1], *QUADS[1:3], [2, 6, 7], [2, 7, 3], *QUADS[4:]]
"""Two sides of two triangles, four of one quad."""
BOX: Float = CORNERS[FACES]
"""(12, 3, 3)"""
CORE = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
PRODUCTION = "http://schemas.microsoft.com/3dmanufacturing/production/2015/06"
RELATIONS = (
    '<?xml version="1.0"?><Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships">'
    '<Relationship Id="r" Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel" Target="{}"/>'
    "</Relationships>"
)


def write(folder: Path, content: str | bytes, name: str) -> Path:
    path = folder / name
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


def zipped(members: Mapping[str, str | bytes], method: int = zipfile.ZIP_DEFLATED) -> bytes:
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", method) as archive:
        for name, content in members.items():
            archive.writestr(
                zipfile.ZipInfo(name), content, method
            )  # a fixed date: the same bytes every time
    return packed.getvalue()


# STL


def ascii_stl(triangles: Float = BOX, name: str = "part") -> str:
    lines = [f"solid {name}"]
    for corners in triangles.tolist():
        lines += ["facet normal 0 0 0", " outer loop"]
        lines += [f"  vertex {x!r} {y!r} {z!r}" for x, y, z in corners]
        lines += [" endloop", "endfacet"]
    return "\n".join([*lines, f"endsolid {name}", ""])


def binary_stl(triangles: Float = BOX, *, header: bytes = b"", announced: int | None = None) -> bytes:
    count = len(triangles) if announced is None else announced
    facets = b"".join(struct.pack("<12fH", 0, 0, 0, *corners.ravel(), 0) for corners in triangles)
    return header.ljust(80, b"\0") + struct.pack("<I", count) + facets


# 3MF


def mesh_xml(corners: Float = CORNERS, faces: Any = FACES) -> str:
    vertices = "".join(f'<vertex x="{x!r}" y="{y!r}" z="{z!r}"/>' for x, y, z in np.asarray(corners).tolist())
    facets = "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in np.asarray(faces).tolist())
    return f"<mesh><vertices>{vertices}</vertices><triangles>{facets}</triangles></mesh>"


def item(number: int, matrix: Sequence[float] = (), more: str = "") -> str:
    """A build item; the matrix has 12 numbers."""
    transform = f' transform="{" ".join(map(str, matrix))}"' if len(matrix) else ""
    return f'<item objectid="{number}"{transform}{more}/>'


def model_xml(objects: Mapping[int, str], build: str, *, unit: str = "millimeter", more: str = "") -> str:
    resources = "".join(f'<object id="{number}">{text}</object>' for number, text in objects.items())
    return (
        f'<?xml version="1.0" encoding="UTF-8"?><model unit="{unit}" xmlns="{CORE}" xmlns:p="{PRODUCTION}"{more}>'
        f"<resources>{resources}</resources><build>{build}</build></model>"
    )


def three_mf(model: str, more: Mapping[str, str | bytes] | None = None) -> bytes:
    members = {"_rels/.rels": RELATIONS.format("/3D/3dmodel.model"), "3D/3dmodel.model": model}
    return zipped(members | dict(more or {}))


# GLB


def glb(tree: Mapping[str, Any], binary: bytes) -> bytes:
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    binary += b"\0" * (-len(binary) % 4)
    chunks = struct.pack("<LL", len(text), 0x4E4F534A) + text
    chunks += struct.pack("<LL", len(binary), 0x004E4942) + binary if binary else b""
    return struct.pack("<4sLL", b"glTF", 2, 12 + len(chunks)) + chunks


def glb_box(**changes: Any) -> bytes:
    """The box as one mesh of one node, metres; changes replace top entries of the tree."""
    points, faces = CORNERS.astype("<f4").tobytes(), FACES.astype("<u2").tobytes()
    tree: dict[str, Any] = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 8, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5123, "count": 36, "type": "SCALAR"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": len(points)},
            {"buffer": 0, "byteOffset": len(points), "byteLength": len(faces)},
        ],
        "buffers": [{"byteLength": len(points) + len(faces)}],
    }
    return glb(tree | changes, points + faces)


# OBJ, PLY, OFF


def obj() -> str:
    points = "".join(f"v {x} {y} {z}\n" for x, y, z in CORNERS.tolist())
    return points + "".join(f"f {a + 1} {b + 1} {c + 1}\n" for a, b, c in FACES.tolist())


def ply(*, binary: bool = False) -> bytes:
    kind = "binary_little_endian" if binary else "ascii"
    head = (
        f"ply\nformat {kind} 1.0\nelement vertex 8\nproperty float x\nproperty float y\nproperty float z\n"
        "element face 12\nproperty list uchar int vertex_indices\nend_header\n"
    ).encode()
    if binary:
        return (
            head
            + CORNERS.astype("<f4").tobytes()
            + b"".join(struct.pack("<Biii", 3, *face) for face in FACES)
        )
    points = "".join(f"{x} {y} {z}\n" for x, y, z in CORNERS.tolist())
    return head + (points + "".join(f"3 {a} {b} {c}\n" for a, b, c in FACES.tolist())).encode()


def off() -> str:
    points = "".join(f"{x} {y} {z}\n" for x, y, z in CORNERS.tolist())
    return "OFF\n8 12 0\n" + points + "".join(f"3 {a} {b} {c}\n" for a, b, c in FACES.tolist())


def off_of(vertices: Float, faces: list[list[int]], more: str = "") -> str:
    points = "".join(f"{x} {y} {z}{more}\n" for x, y, z in vertices.tolist())
    lines = "".join(f"{len(face)} {' '.join(map(str, face))}{more}\n" for face in faces)
    return f"OFF\n{len(vertices)} {len(faces)} 0\n{points}{lines}"


def ply_of(vertices: Float, faces: list[list[int]], kind: str, *, extras: bool = False) -> bytes:
    """As a PLY; with extras there are other columns, lists and elements between those that matter."""
    head = [f"ply\nformat {kind} 1.0\ncomment made by hand\nelement vertex {len(vertices)}"]
    head += ["property double x\nproperty double y\nproperty double z"]
    head += ["property uchar red"] * extras
    if extras:
        head += ["element material 2\nproperty list ushort short flags\nproperty float shine"]
    head += [f"element face {len(faces)}"]
    head += ["property short group"] * extras
    head += ["property list uchar uint vertex_indices"]
    head += ["property list uint float texcoord"] * extras
    rows: list[list[tuple[str, float]]] = [
        [*(("d", x) for x in point), *[("B", 7)] * extras] for point in vertices.tolist()
    ]
    if extras:
        rows += [[("H", 1), ("h", -5), ("f", 0.5)], [("H", 3), ("h", 1), ("h", 2), ("h", 3), ("f", 0.5)]]
    for face in faces:
        row: list[tuple[str, float]] = [("h", -1)] * extras
        row += [("B", len(face)), *(("I", corner) for corner in face)]
        row += [("I", 2 * len(face)), *[("f", 0.25)] * (2 * len(face))] if extras else []
        rows.append(row)
    if kind == "ascii":
        body = "".join(" ".join(str(value) for _, value in row) + "\n" for row in rows).encode()
    else:
        order = "<" if "little" in kind else ">"
        body = b"".join(struct.pack(order + code, value) for row in rows for code, value in row)
    return "\n".join([*head, "end_header", ""]).encode() + body


def every_format() -> dict[str, bytes]:
    """Name -> a good file of every kind that is read without an extra."""
    grouped = model_xml(
        {
            1: mesh_xml(),
            2: '<components><component objectid="1" transform="1 0 0 0 1 0 0 0 1 9 0 0"/></components>',
        },
        item(1) + item(2, (0, 1, 0, -1, 0, 0, 0, 0, 1, 0, 0, 0)) + item(1, more=' printable="0"'),
        unit="inch",
    )
    return {
        "binary.stl": binary_stl(),
        "ascii.stl": ascii_stl().encode(),
        "utf16.stl": ascii_stl(BOX[:4]).encode("utf-16"),
        "deflated.3mf": three_mf(grouped),
        "stored.3mf": zipped({"3D/3dmodel.model": grouped}, zipfile.ZIP_STORED),
        "part.obj": obj().encode(),
        "ascii.ply": ply(),
        "binary.ply": ply(binary=True),
        "part.off": off().encode(),
        "mixed.ply": ply_of(CORNERS, MIXED, "binary_big_endian", extras=True),
        "mixed.off": off_of(CORNERS, MIXED).encode(),
        "part.glb": glb_box(),
    }
