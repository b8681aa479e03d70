"""Read OFF files: vertices and polygons as text, one per line, or as big-endian numbers of four bytes.

Source: the description of the format in the manual of Geomview. Normals and colours follow the data of a vertex or a
face and are ignored. In a text, only the end of a line separates the colour of a face from the next face. If vertices
and faces are not one per line, the numbers are read by their counts, provided that the total matches exactly.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Final

import numpy as np

from printer_slicer.mesh_io.limits import check_facets
from printer_slicer.mesh_io.polygons import to_integers, triangulate_polygons
from printer_slicer.mesh_io.tables import (
    BinaryBody,
    Column,
    Element,
    Property,
    TableBody,
    TextBody,
    read_table,
)

if TYPE_CHECKING:
    from pathlib import Path

    from printer_slicer.arrays import Float, Int
    from printer_slicer.mesh_io.limits import Limits

__all__ = ["read_off"]

KEYWORD: Final = re.compile(r"\s*(?:(ST)?(C)?(N)?(4?n?)OFF\b)?")
"""The keyword at the start of a file; it may be missing."""
BINARY: Final = re.compile(rb"\s*(ST)?(C)?(N)?(4?n?)OFF[ \t]+BINARY[ \t]*\r?\n")
EXTRA_NUMBERS: Final = (2, 4, 3)
"""How many numbers follow the coordinates of a vertex: for texture coordinates (ST), colour (C) and normal (N)."""
CORNERS: Final = Property("corners", "i4", "i4")
COLOUR: Final = Property("colour", "f4", "i4")
"""The properties of a face."""


def read_off(data: bytes, path: Path, limits: Limits) -> Float:
    """Return the corners (F, 3, 3) of the facets; polygons are split into fans.

    Raises:
        MeshError: there are too many facets.
        ValueError: the file is malformed; says why.
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
        triangles = _read_by_counts(body, _count_extra_numbers(keyword), path, limits)
        if triangles is None:
            raise
        return triangles


def _read_lines(text: str, path: Path, limits: Limits) -> Float:
    """Read the text after the keyword, in which every vertex and every face has its own line."""
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
    vertices = _read_columns(lines[1 : n_vertices + 1], range(3), "vertex")
    counts, corners = _read_faces(lines[n_vertices + 1 : n_vertices + n_faces + 1])
    return triangulate_polygons(vertices, counts, corners, path, limits)


def _read_by_counts(text: str, n_extra: int, path: Path, limits: Limits) -> Float | None:
    """Read the text number by number, by its counts of vertices, faces and corners; None if numbers are left over.

    A truncated file or a missing number must not produce a different part. So this does not apply to files with one
    line per vertex and face or with faces of fewer than three corners, and the number of edges may only be missing
    at the end of its line.
    """
    lines = [line for line in text.splitlines() if line and not line.isspace()]
    start = 2 if lines and len(lines[0].split()) == 2 else 3
    try:
        body = TextBody(text.encode())
        announced = body.read_integer(0, ""), body.read_integer(1, "")
        vertices, faces, end = _read_tables(body, announced, start, n_extra, (CORNERS,))
        whole_rows = len(lines) == 1 + sum(announced)
        if end == body.end and not whole_rows and (faces.counts >= 3).all():
            return triangulate_polygons(vertices, faces.counts, to_integers(faces.values), path, limits)
    except (ValueError, LookupError, OverflowError):
        pass
    return None


def _read_binary(data: bytes, head: re.Match[bytes], path: Path, limits: Limits) -> Float:
    """Read the binary data after the first line."""
    if head[4]:
        raise ValueError("its points do not have three coordinates")
    body = BinaryBody(data, ">")
    if body.end < 12:
        raise ValueError("the numbers of vertices and faces are missing at the start")
    announced = body.read_integer(0, "i4"), body.read_integer(4, "i4")
    check_facets(announced[1], path, limits)
    vertices, faces, _ = _read_tables(body, announced, 12, _count_extra_numbers(head), (CORNERS, COLOUR))
    return triangulate_polygons(vertices, faces.counts, faces.values.astype(np.int64), path, limits)


def _count_extra_numbers(head: re.Match[bytes] | re.Match[str]) -> int:
    """Return how many numbers follow the coordinates of each vertex."""
    return sum(number for number, given in zip(EXTRA_NUMBERS, head.groups(), strict=False) if given)


def _read_tables(
    body: TableBody, announced: tuple[int, int], start: int, n_extra: int, face: tuple[Property, ...]
) -> tuple[Float, Column, int]:
    """Read the vertices (V, 3) and the corners of the faces; also return where the faces end in the body.

    Args:
        body: the data after the first line or the first word.
        announced: number of vertices and of faces.
        start: where the vertices start in the body.
        n_extra: how many numbers follow the coordinates of each vertex.
        face: the properties of a face.
    """
    columns = ["x", "y", "z", *(f"behind {k}" for k in range(n_extra))]
    vertex = Element("vertex", announced[0], tuple(Property(name, "f4") for name in columns))
    vertices, at = read_table(body, vertex, start, "xyz")
    faces, end = read_table(body, Element("face", announced[1], face), at, (CORNERS.name,))
    if not vertices or not faces:
        nothing = np.zeros(0, np.int64)
        return np.zeros((0, 3)), Column(nothing, nothing), end
    xyz = np.stack([vertices[name].values for name in "xyz"], axis=1).astype(np.float64)
    return xyz, faces[CORNERS.name], end


def _read_faces(lines: list[str]) -> tuple[Int, Int]:
    """Return the number of corners of each face (F,), and the corners of all faces."""
    counts = np.zeros(len(lines), np.int64)
    for number, line in enumerate(lines):
        word = line.split(None, 1)[0]
        if not (word.isdecimal() and len(word) < 10 and 2 * int(word) < len(line)):
            raise ValueError(f"face {number + 1} is malformed: '{line.strip()[:60]}'")
        counts[number] = int(word)
    first_corner = np.cumsum(counts) - counts
    corners = np.zeros(int(counts.sum()), np.int64)
    by_size = np.argsort(counts, kind="stable")
    for start, end in pairwise(np.flatnonzero(np.diff(counts[by_size], prepend=-1, append=-1)).tolist()):
        rows, size = by_size[start:end], int(counts[by_size[start]])
        if size:
            part = _read_columns([lines[row] for row in rows.tolist()], range(1, size + 1), "face")
            corners[first_corner[rows, None] + np.arange(size)] = to_integers(part)
    return counts, corners


def _read_columns(lines: Sequence[str], columns: range, what: str) -> Float:
    """Return the numbers (L, C) in these columns of each line."""
    if not lines:
        return np.zeros((0, len(columns)))
    try:
        numbers: Float = np.loadtxt(lines, usecols=columns, ndmin=2, comments=None)
    except ValueError:
        raise ValueError(f"a {what} does not have {len(columns)} numbers in its line") from None
    return numbers
