"""OFF: vertices and polygons, one in a line, as text, or as numbers of four bytes, the highest first.

Written after the description of the format in the manual of Geomview. Normals and colours, of vertices and of faces,
are behind what is read: in a text only the end of a line tells colours of faces from the next face. Where vertices and
faces do not stand one in a line, the numbers are read by their counts, if there are exactly as many as that makes.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Final

import numpy as np

from printer_slicer.mesh_io.limits import check_facets
from printer_slicer.mesh_io.polygons import triangulate_polygons, whole
from printer_slicer.mesh_io.tables import Bytes, Column, Element, Property, TableBody, Words, read_table

if TYPE_CHECKING:
    from pathlib import Path

    from printer_slicer.arrays import Float, Int
    from printer_slicer.mesh_io.limits import Limits

__all__ = ["read_off"]

KEYWORD: Final = re.compile(r"\s*(?:(ST)?(C)?(N)?(4?n?)OFF\b)?")
"""What a file begins with; it may also begin with its counts."""
BINARY: Final = re.compile(rb"\s*(ST)?(C)?(N)?(4?n?)OFF[ \t]+BINARY[ \t]*\r?\n")
BEHIND: Final = (2, 4, 3)
"""Numbers behind the coordinates of a vertex: of its place in a picture (ST), its colour (C), its normal (N)."""
CORNERS: Final = Property("corners", "i4", "i4")
COLOUR: Final = Property("colour", "f4", "i4")
"""What a face consists of."""


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
    if keyword is None or keyword[4]:
        raise ValueError("its points do not have three coordinates")
    body = text[keyword.end() :]
    try:
        return _read_lines(body, path, limits)
    except ValueError:
        triangles = _read_counted(body, _behind(keyword), path, limits)
        if triangles is None:
            raise
        return triangles


def _read_lines(text: str, path: Path, limits: Limits) -> Float:
    """The facets of what follows the keyword, where every vertex and every face has a line."""
    lines = [line for line in text.splitlines() if line and not line.isspace()]
    announced = lines[0].split() if lines else []
    if len(announced) < 2 or not all(word.isdecimal() for word in announced[:2]):
        raise ValueError("the numbers of vertices and faces are missing at the start")
    n_vertices, n_faces = int(announced[0]), int(announced[1])
    if n_vertices + n_faces > len(lines) - 1:
        raise ValueError(
            f"{n_vertices} vertices and {n_faces} faces are stated, but only {len(lines) - 1} lines follow"
        )
    check_facets(n_faces, path, limits)
    vertices = _numbers(lines[1 : n_vertices + 1], range(3), "vertex")
    counts, corners = _faces(lines[n_vertices + 1 : n_vertices + n_faces + 1])
    return triangulate_polygons(vertices, counts, corners, path, limits)


def _read_counted(text: str, n_behind: int, path: Path, limits: Limits) -> Float | None:
    """The same by the numbers of vertices, of faces and of their corners; None where these do not use up all numbers.

    What breaks off or lacks a number must not become another part: files with as many lines as that makes are not read
    so, nor faces of less than three corners, and the number of edges may only be missing where it would end its line.
    """
    lines = [line for line in text.splitlines() if line and not line.isspace()]
    begin = 2 if lines and len(lines[0].split()) == 2 else 3
    try:
        body = Words(text.encode())
        announced = body.number(0, ""), body.number(1, "")
        vertices, faces, end = _tables(body, announced, begin, n_behind, (CORNERS,))
        whole_rows = len(lines) == 1 + sum(announced)
        if end == body.end and not whole_rows and (faces.counts >= 3).all():
            return triangulate_polygons(vertices, faces.counts, whole(faces.values), path, limits)
    except (ValueError, LookupError, OverflowError):
        pass
    return None


def _read_binary(data: bytes, head: re.Match[bytes], path: Path, limits: Limits) -> Float:
    """The same, of what follows the first line."""
    if head[4]:
        raise ValueError("its points do not have three coordinates")
    body = Bytes(data, ">")
    if body.end < 12:
        raise ValueError("the numbers of vertices and faces are missing at the start")
    announced = body.number(0, "i4"), body.number(4, "i4")
    check_facets(announced[1], path, limits)
    vertices, faces, _ = _tables(body, announced, 12, _behind(head), (CORNERS, COLOUR))
    return triangulate_polygons(vertices, faces.counts, faces.values.astype(np.int64), path, limits)


def _behind(head: re.Match[bytes] | re.Match[str]) -> int:
    """Numbers behind the coordinates of each vertex."""
    return sum(number for number, given in zip(BEHIND, head.groups(), strict=False) if given)


def _tables(
    body: TableBody, announced: tuple[int, int], begin: int, n_behind: int, face: tuple[Property, ...]
) -> tuple[Float, Column, int]:
    """Vertices (V, 3), the corners of the faces, and where these end in the body.

    Args:
        body: what is behind the first line, or the first word.
        announced: vertices and faces.
        begin: where the vertices begin in it.
        n_behind: numbers behind the coordinates of each vertex.
        face: what each face consists of.
    """
    columns = ["x", "y", "z", *(f"behind {k}" for k in range(n_behind))]
    vertex = Element("vertex", announced[0], tuple(Property(name, "f4") for name in columns))
    vertices, at = read_table(body, vertex, begin, "xyz")
    faces, end = read_table(body, Element("face", announced[1], face), at, (CORNERS.name,))
    if not vertices or not faces:
        nothing = np.zeros(0, np.int64)
        return np.zeros((0, 3)), Column(nothing, nothing), end
    xyz = np.stack([vertices[name].values for name in "xyz"], axis=1).astype(np.float64)
    return xyz, faces[CORNERS.name], end


def _faces(lines: list[str]) -> tuple[Int, Int]:
    """(F,) corners of each face, and all of them."""
    counts = np.zeros(len(lines), np.int64)
    for number, line in enumerate(lines):
        word = line.split(None, 1)[0]
        if not (word.isdecimal() and len(word) < 10 and 2 * int(word) < len(line)):
            raise ValueError(f"face {number + 1} is malformed: '{line.strip()[:60]}'")
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
        raise ValueError(f"a {what} does not have {len(columns)} numbers in its line") from None
    return numbers
