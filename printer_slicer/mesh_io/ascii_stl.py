"""Read ASCII STL files in chunks.

Each chunk is split into words. A facet has 21 words, so every 21st word must be the same.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import TYPE_CHECKING, Final

import numpy as np

from printer_slicer.errors import MeshError
from printer_slicer.mesh_io.limits import check_facets
from printer_slicer.mesh_io.soundness import COPY_AGAIN, EXPORT_AGAIN

if TYPE_CHECKING:
    from printer_slicer.arrays import Float
    from printer_slicer.mesh_io.files import ModelFile
    from printer_slicer.mesh_io.limits import Limits

__all__ = ["is_ascii_stl", "read_ascii_stl"]

GRAMMAR: Final = (
    b"facet normal # # # outer loop vertex # # # vertex # # # vertex # # # endloop endfacet".split()
)
"""The words of one facet of an ASCII STL; # is a number."""
COORDINATES: Final = (8, 9, 10, 12, 13, 14, 16, 17, 18)
"""Indices of the nine coordinates in GRAMMAR."""
KEYWORDS: Final = tuple((place, word) for place, word in enumerate(GRAMMAR) if word != b"#")
"""Index and text of each word of GRAMMAR that is not a number."""
NORMAL: Final = re.compile(rb"\bfacet[ \t]+normal\b[^\n]*?(?=\bouter\b|$)", re.MULTILINE)
"""The normal of a facet; its value is ignored, because the corners determine it."""
LONGEST_LINE: Final = 1 << 24
"""Maximum length of a line, bytes."""
PADDING: Final = b"\0\x1a"
"""Bytes that programs append to a text: zeros and the end-of-file character of CP/M and DOS."""


class _MalformedError(Exception):
    """Raised for malformed text; `_find_fault` then finds the line."""


def is_ascii_stl(source: ModelFile) -> bool:
    """Return whether a file starts like an ASCII STL and has almost no zero bytes, of which binary files have many."""
    head = source.head
    if head.startswith((b"\xff\xfe", b"\xfe\xff")):
        head = head.replace(b"\0", b"")[2:]
    if b"facet" in head.lower():
        head = head.rstrip(PADDING)
    start = head[:1024].removeprefix(b"\xef\xbb\xbf").lstrip().lower()
    return start.startswith((b"solid", b"facet")) and head.count(0) * 100 < len(head)


def read_ascii_stl(source: ModelFile, limits: Limits) -> tuple[Float, list[str]]:
    """Return the corners (F, 3, 3) of all solids of an ASCII STL, and warnings.

    Some programs write normals that are not numbers; such a file is read a second time without its normals. If
    anything else is wrong, the file is read line by line to find the line. A file may end with padding, and
    `endsolid` may be missing after a complete facet.

    Raises:
        MeshError: the file is malformed; names the line.
    """
    try:
        pieces, last = _read_facets(_read_whole_lines(source), source, limits)
    except _MalformedError:
        try:
            pieces, last = _read_facets(_zero_normals(source), source, limits)
        except _MalformedError:
            raise _find_fault(source) from None
    count = sum(map(len, pieces))
    corners = np.zeros((count, 3, 3))
    np.concatenate([np.zeros((0, 3, 3)), *pieces], out=corners)
    cut = f"the file ends without 'endsolid' after {count} complete facets: it may be truncated"
    return corners, [] if last == b"end" else [cut]


def _read_facets(texts: Iterator[bytes], source: ModelFile, limits: Limits) -> tuple[list[Float], bytes]:
    """Read the corners (F, 3, 3) in each chunk of text; also return `b"end"` if `endsolid` ends the last solid."""
    pieces: list[Float] = []
    count, left, last = 0, list[bytes](), b""
    for text in texts:
        words, last = _split_words(text, last)
        words = left + words if left else words
        n_facets = len(words) // len(GRAMMAR)
        left = words[n_facets * len(GRAMMAR) :]
        pieces.append(_parse_corners(words[: n_facets * len(GRAMMAR)]))
        count += n_facets
        check_facets(count, source.path, limits)
    if left or (last != b"end" and not count):
        raise _MalformedError
    return pieces, last


def _zero_normals(source: ModelFile) -> Iterator[bytes]:
    """Yield chunks of the file as `_read_whole_lines` does, but with all normals set to zero."""
    return (NORMAL.sub(b"facet normal 0 0 0 ", text) for text in _read_whole_lines(source))


def _read_whole_lines(source: ModelFile) -> Iterator[bytes]:
    """Yield the file in lower case, in chunks that end with a complete line."""
    rest = b""
    for chunk in _strip_padding(source.read_text_chunks()):
        text = rest + chunk.lower() if rest else chunk.lower()
        end = text.rfind(b"\n") + 1
        rest = text[end:]
        if len(rest) > LONGEST_LINE:
            raise MeshError(
                f"{source.path}: a line is longer than {LONGEST_LINE} bytes, which no STL needs",
                remedy=EXPORT_AGAIN,
            )
        yield text[:end]
    yield rest


def _strip_padding(chunks: Iterator[bytes]) -> Iterator[bytes]:
    """Yield the chunks without padding at the end of the file; elsewhere, one byte of it stays to cause an error."""
    held = b""
    for chunk in chunks:
        text = chunk.rstrip(PADDING)
        if text:
            yield held + text
            held = b""
        held = held or chunk[len(text) : len(text) + 1]


def _split_words(text: bytes, last: bytes) -> tuple[list[bytes], bytes]:
    """Split text into words, except for the lines `solid name` and `endsolid name`.

    Args:
        text: whole lines in lower case.
        last: prefix of `solid` in the previous such line: `b""` or `b"end"`.

    Returns:
        The words, and the prefix of `solid` in the last such line.
    """
    pieces, start, at = [], 0, 0
    while (at := text.find(b"solid", at)) >= 0:
        line = text.rfind(b"\n", 0, at) + 1
        end = text.find(b"\n", at) % (len(text) + 1)
        prefix = text[line:at].strip()
        if prefix in (b"", b"end"):
            pieces.append(text[start:line])
            start, last = end, prefix
        at = end
    pieces.append(text[start:])
    return b"\n".join(pieces).split(), last


def _parse_corners(words: list[bytes]) -> Float:
    """Return the corners (F, 3, 3) of the complete facets that these words form."""
    n_words = len(GRAMMAR)
    n_facets = len(words) // n_words
    for place, word in KEYWORDS:
        if words[place::n_words].count(word) != n_facets:
            raise _MalformedError
    corners = np.zeros((n_facets, 9))
    try:
        for column, place in enumerate(COORDINATES):
            corners[:, column] = list(map(float, words[place::n_words]))
    except ValueError:
        raise _MalformedError from None
    if not np.isfinite(corners).all():
        raise _MalformedError
    return corners.reshape(-1, 3, 3)


def _find_fault(source: ModelFile) -> MeshError:
    """Return an error that describes the first malformed line."""
    place, inside, number, last_used = 0, False, 0, 1

    def error_at_line(what: str, remedy: str = EXPORT_AGAIN) -> MeshError:
        """Return an error that names the current line."""
        return MeshError(f"{source.path}, line {number}: {what}", remedy=remedy)

    lines = (
        line
        for text in _zero_normals(source)
        for line in text.split(b"\n")[: -1 if text[-1:] == b"\n" else None]
    )
    for number, line in enumerate(lines, start=1):
        words = line.split()
        last_used = number if words else last_used
        if words and words[0] in (b"solid", b"endsolid"):
            if place:
                return error_at_line("the solid ends in the middle of a facet", COPY_AGAIN)
            inside = words[0] == b"solid"
            continue
        for word in words:
            if wrong := _describe_invalid_word(word, place):
                return error_at_line(wrong, _choose_remedy(word, place))
            place = (place + 1) % len(GRAMMAR)
    number = last_used
    if place:
        return error_at_line("the file ends in the middle of a facet", COPY_AGAIN)
    return error_at_line("the file ends without 'endsolid'" if inside else "'solid' is missing", COPY_AGAIN)


def _describe_invalid_word(word: bytes, place: int) -> str:
    """Describe what is wrong with a word at this index of GRAMMAR; empty if the word is valid."""
    wanted = GRAMMAR[place]
    found = word[:40].decode("ascii", "replace")
    if wanted != b"#":
        return "" if word == wanted else f"expected '{wanted.decode()}', found '{found}'"
    try:
        finite = np.isfinite(float(word))
    except ValueError:
        return f"expected a number, found '{found}'"
    return "" if finite or place not in COORDINATES else f"a vertex has the coordinate '{found}'"


def _choose_remedy(word: bytes, place: int) -> str:
    """Return the remedy for an invalid word."""
    if GRAMMAR[place] == b"#" and b"," in word:
        return "Export the part again with decimal points: set the program's language or region to English"
    return EXPORT_AGAIN
