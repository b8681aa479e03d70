"""Read the facets of all objects and groups of OBJ files, in chunks.

Source: Wavefront, Advanced Visualizer manual, appendix B1. The statements `v` and `f` are read. Materials, points,
lines, curves and free-form surfaces are ignored, and so are weights and colours after the coordinates of a vertex.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from printer_slicer.errors import MeshError
from printer_slicer.mesh_io.limits import check_facets, check_vertices
from printer_slicer.mesh_io.polygons import triangulate_polygons
from printer_slicer.mesh_io.soundness import EXPORT_AGAIN
from printer_slicer.mesh_io.tables import NUMBER, convert_numbers

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from printer_slicer.arrays import Float, Int
    from printer_slicer.mesh_io.files import ModelFile
    from printer_slicer.mesh_io.limits import Limits

__all__ = ["read_obj"]

BLANK: Final = 32
"""Bytes up to this value separate words."""
LONGEST_LINE: Final = 1 << 24
"""Maximum length of a line, bytes."""
MAX_CONTINUED_LINES: Final = 1000
"""Maximum number of continued lines at the end of a chunk."""
COMMENT: Final = re.compile(rb"#[^\n]*")
INDENT: Final = re.compile(rb"(?m)^[\t\v\f ]+")
CORNER: Final = re.compile(rb"([-+]?\d+)(/\S*)?")
IGNORED_GEOMETRY: Final = {
    b"p": "points",
    b"l": "lines",
    b"curv": "curves",
    b"curv2": "curves",
    b"surf": "free-form surfaces",
}
"""Statements that define geometry without facets."""


class _MalformedError(Exception):
    """Raised for malformed text; `_find_fault` then finds the line."""


def read_obj(source: ModelFile, limits: Limits) -> tuple[Float, list[str]]:
    """Return the corners (F, 3, 3) of the facets, and warnings; polygons are split into fans.

    If something is wrong, the file is read again line by line to find the line.

    Raises:
        MeshError: there are too many facets, or the file is malformed; names the line.
    """
    vertices, counts, corners = [np.zeros((0, 3))], [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
    n_vertices = n_faces = n_facets = n_surfaces = 0
    try:
        for text in _read_chunks(source):
            lines = _StatementChunk(text)
            vertices.append(lines.read_vertices())
            size, corner = lines.read_faces(n_vertices)
            counts.append(size)
            corners.append(corner)
            n_vertices += len(vertices[-1])
            n_faces += len(size)
            n_facets += int(np.maximum(size - 2, 0).sum())
            n_surfaces += text.count(b"\nsurf ") + text.startswith(b"surf ")
            check_vertices(n_vertices, source.path, limits)
            check_facets(max(n_faces, n_facets), source.path, limits)
    except _MalformedError:
        raise _find_fault(source, None) from None
    corner = np.concatenate(corners)
    del corners
    if len(corner) and corner.max() >= n_vertices:
        raise _find_fault(source, n_vertices)
    if not n_facets:
        raise _no_facets_error(source)
    notes = [f"{n_surfaces} free-form surfaces are left out"] if n_surfaces else []
    return triangulate_polygons(
        np.concatenate(vertices), np.concatenate(counts), corner, source.path, limits
    ), notes


def _read_chunks(source: ModelFile) -> Iterator[bytes]:
    """Yield the file in chunks of complete statements; every line ends with LF."""
    rest = b""
    for chunk in source.read_text_chunks():
        text = rest + chunk if rest else chunk
        end = _find_statement_end(text)
        rest = text[end:]
        if len(rest) > LONGEST_LINE:
            raise MeshError(
                f"{source.path}: a line is longer than {LONGEST_LINE} bytes, which no OBJ needs",
                remedy=EXPORT_AGAIN,
            )
        if end:
            yield _normalize_line_ends(text[:end])
    yield _normalize_line_ends(rest + b"\n\n")  # two: the last line may be continued


def _find_statement_end(text: bytes) -> int:
    """Return the index after the last line that is not continued on the next one."""
    end = text.rfind(b"\n") + 1
    for _ in range(MAX_CONTINUED_LINES):
        if not text.endswith((b"\\\n", b"\\\r\n"), 0, end):
            return end
        end = text.rfind(b"\n", 0, end - 1) + 1
    return 0


def _normalize_line_ends(text: bytes) -> bytes:
    return text.replace(b"\r\n", b"\n").replace(b"\r", b"\n") if b"\r" in text else text


class _StatementChunk:
    """The statements of a chunk: where they start, and which are vertices or faces."""

    def __init__(self, text: bytes) -> None:
        if b"#" in text:
            text = COMMENT.sub(b" ", text)
        if b"\\\n" in text:
            text = text.replace(b"\\\n", b"  ")
        if text[:1] in (b" ", b"\t") or b"\n " in text or b"\n\t" in text:
            text = INDENT.sub(b"", text)
        self._bytes = np.frombuffer(text, np.uint8)
        ends = np.flatnonzero(self._bytes == ord("\n")) + 1
        self._begins = np.concatenate([[0], ends[:-1]])
        self._lengths = ends - self._begins
        first, second = self._bytes[self._begins], self._bytes[np.minimum(self._begins + 1, len(text) - 1)]
        self._is_vertex = (first == ord("v")) & (second <= BLANK)
        self._is_face = (first == ord("f")) & (second <= BLANK)

    def read_vertices(self) -> Float:
        """Return the vertex coordinates (V, 3)."""
        text, counts = self._select_words(self._is_vertex)
        if not len(counts):
            return np.zeros((0, 3))
        numbers = _parse_numbers(text, "f8", counts)
        if counts.min() < 3:
            raise _MalformedError
        if counts.min() == counts.max():
            return numbers.reshape(len(counts), -1)[:, :3]
        xyz: Float = numbers[(np.cumsum(counts) - counts)[:, None] + np.arange(3)]
        return xyz

    def read_faces(self, n_before: int) -> tuple[Int, Int]:
        """Return the number of corners of each face (P,), and the vertex indices of all corners, from 0.

        Args:
            n_before: number of vertices in the previous chunks.
        """
        text, counts = self._select_words(self._is_face)
        if not len(counts):
            return counts, counts
        numbers = _parse_numbers(text, "i8", counts)
        if numbers.min() >= 1:
            return counts, numbers - 1
        # -1 is the last vertex before the face.
        known = (n_before + np.cumsum(self._is_vertex))[self._is_face]
        corners = np.where(numbers < 0, np.repeat(known, counts) + numbers, numbers - 1)
        if corners.min() < 0:
            raise _MalformedError
        return counts, corners

    def _select_words(self, chosen: NDArray[np.bool_]) -> tuple[NDArray[np.uint8], Int]:
        """Return the text of the chosen statements and the number of words in each.

        Keywords are removed, and so is the rest of a word from `/` on.
        """
        lengths = self._lengths[chosen]
        text = self._bytes[np.repeat(chosen, self._lengths)]
        begins = np.cumsum(lengths) - lengths
        text[begins] = BLANK
        if not len(text):
            return text, np.zeros(0, np.int64)
        blank = text <= BLANK
        slash = text == ord("/")
        if slash.any():
            if (slash[1:] & blank[:-1]).any():
                raise _MalformedError
            marks = np.flatnonzero(blank | slash)
            behind = np.repeat(slash[marks], np.diff(marks, append=len(text)))  # the first byte is a blank
            text[behind] = BLANK
            blank |= behind
        begun = np.zeros(len(text), np.bool_)
        begun[1:] = blank[:-1] & ~blank[1:]
        return text, np.add.reduceat(begun, begins, dtype=np.int64)


def _parse_numbers(text: NDArray[np.uint8], kind: str, counts: Int) -> NDArray[Any]:
    """Convert words to numbers; `counts` are the numbers of words, which must all be numbers."""
    try:
        numbers = convert_numbers(text.tobytes(), kind)
    except ValueError:
        raise _MalformedError from None
    if len(numbers) != counts.sum():
        raise _MalformedError
    return numbers


def _read_statements(source: ModelFile) -> Iterator[tuple[int, list[bytes]]]:
    """Yield the first line number and the words of each statement; slow, used to find errors."""
    number, begun, words, is_continued = 0, 1, list[bytes](), False
    for text in _read_chunks(source):
        for line in text.split(b"\n")[:-1]:
            number += 1
            begun = begun if is_continued else number
            part = COMMENT.sub(b" ", line)
            is_continued = part.endswith(b"\\")
            words += part[: -1 if is_continued else None].split()
            if not is_continued:
                yield begun, words
                words = []


def _find_fault(source: ModelFile, n_vertices: int | None) -> MeshError:
    """Return an error that describes the first malformed statement.

    Args:
        source: the file.
        n_vertices: number of vertices in the file, to find a face that uses a missing one.
    """
    known = 0
    for number, words in _read_statements(source):
        wrong = ""
        if words[:1] == [b"v"]:
            known += 1
            wrong = _describe_vertex_fault(words[1:])
        elif words[:1] == [b"f"]:
            wrong = _describe_face_fault(words[1:], known, n_vertices)
        if wrong:
            return MeshError(f"{source.path}, line {number}: {wrong}", remedy=EXPORT_AGAIN)
    return MeshError(f"{source.path}: not a valid .obj file", remedy=EXPORT_AGAIN)


def _describe_vertex_fault(words: list[bytes]) -> str:
    """Describe what is wrong with a vertex; empty if it is valid."""
    for word in words:
        if not NUMBER.fullmatch(word):
            return f"expected a number, found '{_format_word(word)}'"
    return "" if len(words) >= 3 else f"a vertex has only {len(words)} coordinates"


def _describe_face_fault(words: list[bytes], known: int, n_vertices: int | None) -> str:
    """Describe what is wrong with a face after `known` vertices; empty if it is valid."""
    for word in words:
        match = CORNER.fullmatch(word)
        if match is None:
            return f"expected a vertex number, found '{_format_word(word)}'"
        corner = int(match[1][:20])
        if corner == 0:
            return "a face uses vertex 0; vertices are numbered from 1"
        if corner < -known:
            return f"a face uses vertex {corner}, but only {known} vertices come before it"
        if n_vertices is not None and corner > n_vertices:
            return f"a face uses vertex {corner} of {n_vertices}"
    return ""


def _format_word(word: bytes) -> str:
    return word[:60].decode("ascii", "replace")


def _no_facets_error(source: ModelFile) -> MeshError:
    """Return the error for a file without facets."""
    found = {
        IGNORED_GEOMETRY[words[0]]
        for _, words in _read_statements(source)
        if words and words[0] in IGNORED_GEOMETRY
    }
    only = f", only {' and '.join(sorted(found))}" if found else ""
    return MeshError(f"{source.path}: the file contains no facets{only}", remedy=EXPORT_AGAIN)
