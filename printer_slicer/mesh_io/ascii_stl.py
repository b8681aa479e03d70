"""ASCII STL, chunk by chunk: split into words at once, every 21st of which must be the same."""

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
"""Words of one facet of an ASCII STL; # is a number."""
COORDINATES: Final = (8, 9, 10, 12, 13, 14, 16, 17, 18)
"""Places in GRAMMAR of the nine coordinates."""
FIXED: Final = tuple((place, word) for place, word in enumerate(GRAMMAR) if word != b"#")
NORMAL: Final = re.compile(rb"\bfacet[ \t]+normal\b[^\n]*?(?=\bouter\b|$)", re.MULTILINE)
"""The normal of a facet, whatever it is: the corners decide."""
LONGEST_LINE: Final = 1 << 24
"""bytes"""
PADDING: Final = b"\0\x1a"
"""What programs leave behind the end of a text: zeros, and the mark of an end that CP/M and DOS had."""


class _MalformedError(Exception):
    """The text is malformed; the place is searched for afterwards."""


def is_ascii_stl(source: ModelFile) -> bool:
    """Whether it begins like an ASCII STL and has next to no zero bytes, of which every binary one has many."""
    head = source.head
    if head.startswith((b"\xff\xfe", b"\xfe\xff")):
        head = head.replace(b"\0", b"")[2:]
    if b"facet" in head.lower():
        head = head.rstrip(PADDING)
    start = head[:1024].removeprefix(b"\xef\xbb\xbf").lstrip().lower()
    return start.startswith((b"solid", b"facet")) and head.count(0) * 100 < len(head)


def read_ascii_stl(source: ModelFile, limits: Limits) -> tuple[Float, list[str]]:
    """(F, 3, 3) corners of an ASCII STL of any number of solids, and what deserves a look.

    Normals may be anything, as programs write what is no number there; where one is, the file is read a second time
    without them. Only when something else is wrong it is read line by line, to say where. A file may end with padding,
    and without `endsolid` where its last facet is whole.

    Raises:
        MeshError: names the line that is not as it should be.
    """
    try:
        pieces, last = _facets(_whole_lines(source), source, limits)
    except _MalformedError:
        try:
            pieces, last = _facets(_without_normals(source), source, limits)
        except _MalformedError:
            raise _fault(source) from None
    count = sum(map(len, pieces))
    corners = np.zeros((count, 3, 3))
    np.concatenate([np.zeros((0, 3, 3)), *pieces], out=corners)
    cut = f"the file ends without 'endsolid' after {count} complete facets: it may be truncated"
    return corners, [] if last == b"end" else [cut]


def _facets(texts: Iterator[bytes], source: ModelFile, limits: Limits) -> tuple[list[Float], bytes]:
    """Corners of the facets in pieces of a text, (F, 3, 3) each, and what the last line with `solid` began with."""
    pieces: list[Float] = []
    count, left, last = 0, list[bytes](), b""
    for text in texts:
        words, last = _words_between_solids(text, last)
        words = left + words if left else words
        n_facets = len(words) // len(GRAMMAR)
        left = words[n_facets * len(GRAMMAR) :]
        pieces.append(_corners(words[: n_facets * len(GRAMMAR)]))
        count += n_facets
        check_facets(count, source.path, limits)
    if left or (last != b"end" and not count):
        raise _MalformedError
    return pieces, last


def _without_normals(source: ModelFile) -> Iterator[bytes]:
    """The file as from `_whole_lines`, with zeros as normals."""
    return (NORMAL.sub(b"facet normal 0 0 0 ", text) for text in _whole_lines(source))


def _whole_lines(source: ModelFile) -> Iterator[bytes]:
    """The file in lower case, in pieces that end with a line."""
    rest = b""
    for chunk in _without_padding(source.text_chunks()):
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


def _without_padding(chunks: Iterator[bytes]) -> Iterator[bytes]:
    """The text without what is behind its end; within the text, where it is wrong, one byte of it is left."""
    held = b""
    for chunk in chunks:
        text = chunk.rstrip(PADDING)
        if text:
            yield held + text
            held = b""
        held = held or chunk[len(text) : len(text) + 1]


def _words_between_solids(text: bytes, last: bytes) -> tuple[list[bytes], bytes]:
    """Split all but the lines `solid name` and `endsolid name`.

    Args:
        text: whole lines in lower case.
        last: what the last such line before began with: `b""` for solid, `b"end"` for endsolid.

    Returns:
        The words, and what the last such line began with.
    """
    pieces, begin, at = [], 0, 0
    while (at := text.find(b"solid", at)) >= 0:
        line = text.rfind(b"\n", 0, at) + 1
        end = text.find(b"\n", at) % (len(text) + 1)
        prefix = text[line:at].strip()
        if prefix in (b"", b"end"):
            pieces.append(text[begin:line])
            begin, last = end, prefix
        at = end
    pieces.append(text[begin:])
    return b"\n".join(pieces).split(), last


def _corners(words: list[bytes]) -> Float:
    """(F, 3, 3) corners of whole facets."""
    n_words = len(GRAMMAR)
    n_facets = len(words) // n_words
    for place, word in FIXED:
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


def _fault(source: ModelFile) -> MeshError:
    """Describe the first line that is not as it should be."""
    place, inside, number, last_used = 0, False, 0, 1

    def fault(what: str, remedy: str = EXPORT_AGAIN) -> MeshError:
        """The error in the line that is being looked at."""
        return MeshError(f"{source.path}, line {number}: {what}", remedy=remedy)

    lines = (
        line
        for text in _without_normals(source)
        for line in text.split(b"\n")[: -1 if text[-1:] == b"\n" else None]
    )
    for number, line in enumerate(lines, start=1):
        words = line.split()
        last_used = number if words else last_used
        if words and words[0] in (b"solid", b"endsolid"):
            if place:
                return fault("the solid ends in the middle of a facet", COPY_AGAIN)
            inside = words[0] == b"solid"
            continue
        for word in words:
            if wrong := _not_as_wanted(word, place):
                return fault(wrong, _remedy(word, place))
            place = (place + 1) % len(GRAMMAR)
    number = last_used
    if place:
        return fault("the file ends in the middle of a facet", COPY_AGAIN)
    return fault("the file ends without 'endsolid'" if inside else "'solid' is missing", COPY_AGAIN)


def _not_as_wanted(word: bytes, place: int) -> str:
    """Say what is wrong with a word at this place of GRAMMAR; empty when nothing is."""
    wanted = GRAMMAR[place]
    found = word[:40].decode("ascii", "replace")
    if wanted != b"#":
        return "" if word == wanted else f"expected '{wanted.decode()}', found '{found}'"
    try:
        finite = np.isfinite(float(word))
    except ValueError:
        return f"expected a number, found '{found}'"
    return "" if finite or place not in COORDINATES else f"a vertex has the coordinate '{found}'"


def _remedy(word: bytes, place: int) -> str:
    """What to do about it."""
    if GRAMMAR[place] == b"#" and b"," in word:
        return "Export the part again with decimal points: set the program's language or region to English"
    return EXPORT_AGAIN
