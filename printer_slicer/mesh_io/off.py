"""OFF: vertices and polygons, one in a line, as text.

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

if TYPE_CHECKING:
    from pathlib import Path

    from printer_slicer.mesh_io.limits import Limits
    from printer_slicer.model import Float, Int

__all__ = ["read_off"]

KEYWORD: Final = re.compile(r"\s*(?:(?:ST)?C?N?(4?n?)OFF\b)?[ \t]*(BINARY\b)?")
"""What a file begins with; it may also begin with its counts."""


def read_off(data: bytes, path: Path, limits: Limits) -> Float:
    """(F, 3, 3) corners of the facets; polygons are cut into fans.

    Raises:
        MeshError: too many facets.
        ValueError: it is no sound file; says why.
    """
    text = re.sub(rb"#[^\r\n]*", b"", data).decode("ascii", "replace")
    keyword = KEYWORD.match(text)
    if keyword is None or keyword[1]:
        raise ValueError("its points have other than three coordinates")
    if keyword[2]:
        raise ValueError("binary OFF is not known here")
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
