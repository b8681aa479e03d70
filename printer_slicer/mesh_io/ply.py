"""Read PLY files: elements with numbers and lists of numbers, as text or as binary of either byte order.

Source: Greg Turk, The PLY Polygon File Format, 1994. Triangle strips are lists in which -1 ends a strip; every second
triangle of a strip has the opposite winding.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
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

__all__ = ["read_ply"]

TYPES: Final = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4",
    "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4",
    "float32": "f4", "float64": "f8",
}  # fmt: skip
FORMATS: Final = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
CORNER_PROPERTIES: Final = ("vertex_indices", "vertex_index")
"""Names that programs use for the corners of a face."""
LONGEST_HEADER: Final = 1 << 16
"""Maximum length of the header, bytes."""


def read_ply(data: bytes, path: Path, limits: Limits) -> Float:
    """Return the corners (F, 3, 3) of the facets; polygons are split into fans, strips into triangles.

    Raises:
        MeshError: there are too many facets.
        ValueError: the file is malformed; says why.
    """
    elements, order, begin = _parse_header(data)
    body: TableBody = BinaryBody(data[begin:], order) if order else TextBody(data[begin:])
    vertices, nothing = np.zeros((0, 3)), np.zeros(0, np.int64)
    counts, corners = [nothing], [nothing]
    at = 0
    for element in elements:
        if element.name == "face":
            check_facets(element.n_rows, path, limits)
        columns, at = read_table(body, element, at, ("x", "y", "z", *CORNER_PROPERTIES))
        if element.name == "vertex" and element.n_rows:
            vertices = np.stack([_find_column(columns, element, name).values for name in "xyz"], axis=1)
        elif element.name == "face" and element.n_rows:
            faces = _find_column(columns, element, *CORNER_PROPERTIES)
            counts.append(faces.counts)
            corners.append(to_integers(faces.values))
        elif element.name == "tristrips" and element.n_rows:
            strips = _find_column(columns, element, *CORNER_PROPERTIES)
            check_facets(len(strips.values), path, limits)
            facets = _unroll_strips(strips.counts, to_integers(strips.values))
            counts.append(np.full(len(facets), 3))
            corners.append(facets.ravel())
    vertices = vertices.astype(np.float64)
    return triangulate_polygons(vertices, np.concatenate(counts), np.concatenate(corners), path, limits)


def _unroll_strips(counts: Int, corners: Int) -> Int:
    """Return the facets (F, 3) of triangle strips.

    Args:
        counts: (L,) corners in each list.
        corners: the corners of all lists; -1 ends a strip.
    """
    begins = np.zeros(len(corners) + 1, np.bool_)
    begins[np.cumsum(counts) - counts] = True
    begins[1:] |= corners == -1
    first = np.maximum.accumulate(np.where(begins, np.arange(len(begins)), 0))
    last = np.arange(2, len(corners))
    last = last[(first[last] <= last - 2) & (corners[last] != -1)]
    odd = (last - first[last]) % 2
    return np.stack([corners[last - 2], corners[last - 1 + odd], corners[last - odd]], axis=1)


def _parse_header(data: bytes) -> tuple[list[Element], str, int]:
    """Return the elements in the header, the byte order (empty for text), and where the body starts."""
    head = re.match(rb"ply[ \t]*(\r\n|\n|\r)", data)
    end = re.compile(rb"(?<=[\r\n])end_header[ \t]*").search(data, 0, LONGEST_HEADER)
    if head is None or end is None:
        raise ValueError("the header is missing")
    order, elements = "none", list[Element]()
    for line in data[head.end() : end.start()].decode("ascii", "replace").splitlines():
        match line.split():
            case ["format", name, _] if name in FORMATS:
                order = FORMATS[name]
            case ["element", name, number]:
                elements.append(Element(name, int(number), ()))
            case ["property", *words] if elements:
                last = elements[-1]
                elements[-1] = Element(last.name, last.n_rows, (*last.properties, _parse_property(words)))
            case [] | ["comment", *_] | ["obj_info", *_]:
                pass
            case _:
                raise ValueError(f"unknown line '{line[:60]}' in the header")
    if order == "none":
        raise ValueError("the header does not state the format")
    after = head[1] if data.startswith(head[1], end.end()) else b""
    return elements, order, end.end() + len(after)


def _parse_property(words: Sequence[str]) -> Property:
    match words:
        case [kind, name] if kind in TYPES:
            return Property(name, TYPES[kind])
        case ["list", count, kind, name] if kind in TYPES and TYPES.get(count, "f")[0] != "f":
            return Property(name, TYPES[kind], TYPES[count])
    raise ValueError(f"unknown property '{' '.join(words)[:60]}' in the header")


def _find_column(columns: dict[str, Column], element: Element, *names: str) -> Column:
    """Return the first column with one of these names that has numbers; if none has numbers, the first that exists."""
    found = [columns[name] for name in names if name in columns]
    if found:
        return next((column for column in found if len(column.values)), found[0])
    raise ValueError(f"element '{element.name[:40]}' has no property '{names[0]}'")
