"""OFF: vertices and polygons, one in a line, as text, or as numbers of four bytes, the highest first.

Written after the description of the format in the manual of Geomview. Normals and colours, of vertices and of faces,
are behind what is read.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Final

import numpy as np

from printer_slicer.mesh_io.limits import check_facets
from printer_slicer.mesh_io.polygons import triangulated, whole
from printer_slicer.mesh_io.tables import Bytes, Element, Property, read_table

if TYPE_CHECKING:
    from pathlib import Path

    from printer_slicer.mesh_io.limits import Limits
    from printer_slicer.model import Float, Int

__all__ = ["read_off"]

KEYWORD: Final = re.compile(r"\s*(?:(?:ST)?C?N?(4?n?)OFF\b)?")
"""What a file begins with; it may also begin with its counts."""
BINARY: Final = re.compile(rb"\s*(ST)?(C)?(N)?(4?n?)OFF[ \t]+BINARY[ \t]*\r?\n")
BEHIND: Final = (2, 4, 3)
"""Numbers behind the coordinates of a vertex: of its place in a picture (ST), its colour (C), its normal (N)."""


def read_off(data: bytes, path: Path, limits: Limits) -> Float:
    """(F, 3, 3) corners of the facets; polygons are cut into fans.

    Raises:
        MeshError: too many facets.
        ValueError: it is no sound file; says why.
    """
    if head := BINARY.match(data):
        return _read_binary(data[head.end() :], head, path, limits)
    text = re.sub(rb"#[^\r\n]*", b"", data).decode("ascii", "replace")
    keyword = KEYWORD.match(text)
    if keyword is None or keyword[1]:
        raise ValueError("its points have other than three coordinates")
    lines = [line for line in text[keyword.end() :].splitlines() if line and not line.isspace()]
    announced = lines[0].split() if lines else []
    if len(announced) < 2 or not all(word.isdecimal() for word in announced[:2]):
        raise ValueError("the numbers of vertices and faces do not stand at its beginning")
    n_vertices, n_faces = int(announced[0]), int(announced[1])
    if n_vertices + n_faces > len(lines) - 1:
        raise ValueError(f"{n_vertices} vertices and {n_faces} faces in {len(lines) - 1} lines")
    check_facets(n_faces, path, limits)
    vertices = _numbers(lines[1 : n_vertices + 1], range(3), "vertex")
    counts, corners = _faces(lines[n_vertices + 1 : n_vertices + n_faces + 1])
    return triangulated(vertices, counts, corners, path, limits)


def _read_binary(data: bytes, head: re.Match[bytes], path: Path, limits: Limits) -> Float:
    """The same, of what follows the first line."""
    if head[4]:
        raise ValueError("its points have other than three coordinates")
    body = Bytes(data, ">")
    if body.end < 12:
        raise ValueError("the numbers of vertices and faces do not stand at its beginning")
    n_vertices, n_faces = body.number(0, "i4"), body.number(4, "i4")
    check_facets(n_faces, path, limits)
    n_behind = sum(number for number, given in zip(BEHIND, head.groups(), strict=False) if given)
    columns = ["x", "y", "z", *(f"behind {k}" for k in range(n_behind))]
    vertex = Element("vertex", n_vertices, tuple(Property(name, "f4") for name in columns))
    face = Element("face", n_faces, (Property("corners", "i4", "i4"), Property("colour", "f4", "i4")))
    vertices, at = read_table(body, vertex, 12, "xyz")
    faces, _ = read_table(body, face, at, ("corners",))
    if not n_vertices or not n_faces:
        return np.zeros((0, 3, 3))
    xyz = np.stack([vertices[name].values for name in "xyz"], axis=1).astype(np.float64)
    return triangulated(xyz, faces["corners"].counts, faces["corners"].values.astype(np.int64), path, limits)


def _faces(lines: list[str]) -> tuple[Int, Int]:
    """(F,) corners of each face, and all of them."""
    counts = np.zeros(len(lines), np.int64)
    for number, line in enumerate(lines):
        word = line.split(None, 1)[0]
        if not (word.isdecimal() and len(word) < 10 and 2 * int(word) < len(line)):
            raise ValueError(f"face {number + 1}: '{line.strip()[:60]}'")
        counts[number] = int(word)
    begin = np.cumsum(counts) - counts
    corners = np.zeros(int(counts.sum()), np.int64)
    by_size = np.argsort(counts, kind="stable")
    for start, end in pairwise(np.flatnonzero(np.diff(counts[by_size], prepend=-1, append=-1)).tolist()):
        rows, size = by_size[start:end], int(counts[by_size[start]])
        if size:
            part = _numbers([lines[row] for row in rows.tolist()], range(1, size + 1), "face")
            corners[begin[rows, None] + np.arange(size)] = whole(part)
    return counts, corners


def _numbers(lines: Sequence[str], columns: range, what: str) -> Float:
    """(L, C) the numbers in these columns of each line."""
    if not lines:
        return np.zeros((0, len(columns)))
    try:
        numbers: Float = np.loadtxt(lines, usecols=columns, ndmin=2, comments=None)
    except ValueError:
        raise ValueError(f"a {what} without {len(columns)} numbers in its line") from None
    return numbers
