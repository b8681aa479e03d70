"""PLY: elements with numbers and lists of numbers, as text or as bytes of either order.

Written after Greg Turk, The PLY Polygon File Format, 1994. Rows of the same length are read as one table; only where
they differ, as where triangles and quads are mixed, they are walked one by one. Texts become one array of numbers, so
that both kinds are read alike: a number is so many places long, bytes there and one here.
"""

from __future__ import annotations

import re
import warnings
from array import array
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Protocol

import numpy as np

from printer_slicer.mesh_io.limits import check_facets
from printer_slicer.mesh_io.polygons import triangulated, whole

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from printer_slicer.mesh_io.limits import Limits
    from printer_slicer.model import Float, Int

__all__ = ["read_ply"]

TYPES: Final = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4",
    "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4",
    "float32": "f4", "float64": "f8",
}  # fmt: skip
FORMATS: Final = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
LISTS: Final = ("vertex_indices", "vertex_index")
"""What programs call the corners of a face."""
NUMBER: Final = re.compile(rb"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?|[-+]?(nan|inf)", re.IGNORECASE)
LONGEST_HEADER: Final = 1 << 16


@dataclass(frozen=True, slots=True)
class _Property:
    """One column: numbers of a `kind`, or lists of them after their length, which is of the kind `count`."""

    name: str
    kind: str
    count: str = ""


@dataclass(frozen=True, slots=True)
class _Element:
    """A table of `number` rows."""

    name: str
    number: int
    properties: tuple[_Property, ...]


@dataclass(frozen=True, slots=True, eq=False)
class _Column:
    """The numbers of one property: (n,) how many in each row, and all in one."""

    counts: Int
    values: NDArray[Any]


class _Body(Protocol):
    """What follows the header."""

    end: int

    def size(self, kind: str) -> int:
        """Places that a number takes."""

    def number(self, at: int, kind: str) -> int:
        """The whole number at a place."""

    def numbers(self, at: Int, kind: str) -> NDArray[Any]:
        """The numbers at places."""

    def table(self, start: int, stride: int, shape: tuple[int, int], kind: str) -> NDArray[Any]:
        """Rows of numbers, each `stride` places after the one before."""


class _Bytes:
    """A body of bytes in one order."""

    def __init__(self, data: bytes, order: str) -> None:
        self.end, self._data, self._order = len(data), data, order

    def size(self, kind: str) -> int:
        return int(kind[1])

    def number(self, at: int, kind: str) -> int:
        piece = self._data[at : at + int(kind[1])]
        return int.from_bytes(piece, "little" if self._order == "<" else "big", signed=kind[0] == "i")

    def numbers(self, at: Int, kind: str) -> NDArray[Any]:
        size = int(kind[1])
        return np.ndarray((self.end - size + 1,), self._order + kind, self._data, strides=(1,))[at]

    def table(self, start: int, stride: int, shape: tuple[int, int], kind: str) -> NDArray[Any]:
        return np.ndarray(shape, self._order + kind, self._data, start, (stride, int(kind[1])))


class _Words:
    """A body of text, as its numbers."""

    def __init__(self, data: bytes) -> None:
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error", DeprecationWarning)  # what older numpy says of words like that
                self._words = np.fromstring(data, dtype=np.float64, sep=" ")
        except (ValueError, DeprecationWarning):
            words = (match[0] for match in re.finditer(rb"\S+", data))
            wrong = next((word for word in words if not NUMBER.fullmatch(word)), b"something")
            raise ValueError(f"'{wrong[:60].decode('ascii', 'replace')}' where a number should be") from None
        self.end = len(self._words)

    def size(self, kind: str) -> int:  # noqa: ARG002 - as for bytes
        return 1

    def number(self, at: int, kind: str) -> int:  # noqa: ARG002
        return int(self._words[at])

    def numbers(self, at: Int, kind: str) -> NDArray[Any]:  # noqa: ARG002
        return self._words[at]

    def table(self, start: int, stride: int, shape: tuple[int, int], kind: str) -> NDArray[Any]:  # noqa: ARG002
        return np.ndarray(shape, np.float64, self._words, 8 * start, (8 * stride, 8))


def read_ply(data: bytes, path: Path, limits: Limits) -> Float:
    """(F, 3, 3) corners of the facets; polygons are cut into fans.

    Raises:
        MeshError: too many facets.
        ValueError: it is no sound file; says why.
    """
    elements, order, begin = _header(data)
    body: _Body = _Bytes(data[begin:], order) if order else _Words(data[begin:])
    vertices, counts, corners = np.zeros((0, 3)), np.zeros(0, np.int64), np.zeros(0, np.int64)
    at = 0
    for element in elements:
        if element.name == "face":
            check_facets(element.number, path, limits)
        columns, at = _read(body, element, at, ("x", "y", "z", *LISTS))
        if element.name == "vertex" and element.number:
            vertices = np.stack([_named(columns, element, name).values for name in "xyz"], axis=1)
        elif element.name == "face" and element.number:
            faces = _named(columns, element, *LISTS)
            counts, corners = faces.counts, whole(faces.values)
    return triangulated(vertices.astype(np.float64), counts, corners, path, limits)


def _header(data: bytes) -> tuple[list[_Element], str, int]:
    """The elements, the order of bytes, empty in texts, and where the body begins."""
    head = re.match(rb"ply[ \t]*(\r\n|\n|\r)", data)
    end = re.compile(rb"(?<=[\r\n])end_header[ \t]*").search(data, 0, LONGEST_HEADER)
    if head is None or end is None:
        raise ValueError("it has no header")
    order, elements = "none", list[_Element]()
    for line in data[head.end() : end.start()].decode("ascii", "replace").splitlines():
        match line.split():
            case ["format", name, _] if name in FORMATS:
                order = FORMATS[name]
            case ["element", name, number]:
                elements.append(_Element(name, int(number), ()))
            case ["property", *words] if elements:
                last = elements[-1]
                elements[-1] = _Element(last.name, last.number, (*last.properties, _property(words)))
            case [] | ["comment", *_] | ["obj_info", *_]:
                pass
            case _:
                raise ValueError(f"'{line[:60]}' in the header")
    if order == "none":
        raise ValueError("the header names no format")
    after = head[1] if data.startswith(head[1], end.end()) else b""
    return elements, order, end.end() + len(after)


def _property(words: Sequence[str]) -> _Property:
    match words:
        case [kind, name] if kind in TYPES:
            return _Property(name, TYPES[kind])
        case ["list", count, kind, name] if kind in TYPES and TYPES.get(count, "f")[0] != "f":
            return _Property(name, TYPES[kind], TYPES[count])
    raise ValueError(f"property '{' '.join(words)[:60]}' in the header")


def _named(columns: dict[str, _Column], element: _Element, *names: str) -> _Column:
    for name in names:
        if name in columns:
            return columns[name]
    raise ValueError(f"element '{element.name[:40]}' has no property '{names[0]}'")


def _read(
    body: _Body, element: _Element, start: int, names: Collection[str]
) -> tuple[dict[str, _Column], int]:
    """The columns of these names, and where the element ends."""
    if not 0 <= element.number <= body.end:
        raise ValueError(f"{element.number} of element '{element.name[:40]}' in {body.end} bytes or words")
    if not element.number:
        return {}, start
    first, counts, stride = _row(body, element, start)
    if start + element.number * stride <= body.end and _even(body, element, first, counts, stride):
        return {
            one.name: _Column(
                np.broadcast_to(np.int64(count), (element.number,)),
                body.table(at, stride, (element.number, count), one.kind).reshape(-1),
            )
            for one, at, count in zip(element.properties, first, counts, strict=True)
            if one.name in names
        }, start + element.number * stride
    places, sizes, end = _walked(body, element, start)
    columns = {}
    for number, one in enumerate(element.properties):
        if one.name in names:
            count: Int = np.frombuffer(sizes, np.int64).reshape(element.number, -1)[:, number]
            place = np.frombuffer(places, np.int64).reshape(element.number, -1)[:, number]
            within = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
            at_all = np.repeat(place, count) + within * body.size(one.kind)
            columns[one.name] = _Column(count, body.numbers(at_all, one.kind))
    return columns, end


def _row(body: _Body, element: _Element, at: int) -> tuple[list[int], list[int], int]:
    """Where the numbers of each property of a row begin, how many there are, and the length of the row."""
    begin, places, counts = at, [], []
    for one in element.properties:
        count = 1
        if one.count:
            after = at + body.size(one.count)
            count = body.number(at, one.count) if after <= body.end else -1
            at = after
        places.append(at)
        counts.append(count)
        at += count * body.size(one.kind)
        if count < 0 or at > body.end:
            raise ValueError(f"the file ends, or makes no sense, within element '{element.name[:40]}'")
    return places, counts, at - begin


def _even(body: _Body, element: _Element, first: list[int], counts: list[int], stride: int) -> bool:
    """Whether all rows have lists as long as those of the first row."""
    for one, at, count in zip(element.properties, first, counts, strict=True):
        if one.count:
            lengths = body.table(at - body.size(one.count), stride, (element.number, 1), one.count)
            if not (lengths == count).all():
                return False
    return True


def _walked(body: _Body, element: _Element, start: int) -> tuple[array[int], array[int], int]:
    """For each property of each row where its numbers begin, and how many there are; where the element ends."""
    places, sizes = array("q"), array("q")
    for _ in range(element.number):
        place, count, length = _row(body, element, start)
        places.extend(place)
        sizes.extend(count)
        start += length
    return places, sizes, start
