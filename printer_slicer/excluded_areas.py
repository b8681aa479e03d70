"""The areas of a bed in which nothing may be printed, such as those of clips."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from printer_slicer.arrays import Float
from printer_slicer.geometry import Areas, intersection, normalize, stroke_lines
from printer_slicer.profile import Printer

__all__ = ["enters_excluded_areas", "read_excluded_areas"]

_THINNEST: Final = 0.01  # mm


def read_excluded_areas(printer: Printer) -> Areas:
    """Return `printer.excluded_areas` as one layer, mm."""
    rings = [np.array(_orient(polygon)) for polygon in printer.excluded_polygons]
    return normalize(Areas.from_rings([rings])) if rings else Areas.empty(1)


def _orient(polygon: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return the corners of a polygon counter-clockwise."""
    following = [*polygon[1:], polygon[0]]
    twice = sum(a[0] * b[1] - a[1] * b[0] for a, b in zip(polygon, following, strict=True))
    return list(polygon) if twice > 0 else list(polygon[::-1])


def enters_excluded_areas(lines: Sequence[Float], width: float, printer: Printer) -> bool:
    """Return whether extrusions along closed lines (n, 2) of this width, mm, enter an excluded area."""
    if not lines:
        return False
    closed = [np.concatenate([line, line[:1]]) for line in lines]
    start = np.cumsum([0, *map(len, closed)])
    radius = np.full(len(closed), max(width, _THINNEST) / 2)
    layer = np.zeros(len(closed), np.int64)
    strokes = stroke_lines(np.concatenate(closed), start, layer, radius, 1)
    return intersection(strokes, read_excluded_areas(printer)).n_rings > 0
