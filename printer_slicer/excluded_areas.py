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
    rings = [np.array(polygon) for polygon in printer.excluded_polygons]
    if not rings:
        return Areas.empty(1)
    areas = Areas.from_rings([rings]).ring_area()
    # Outlines of areas are counter-clockwise.
    return normalize(
        Areas.from_rings(
            [[ring if area > 0 else ring[::-1] for ring, area in zip(rings, areas, strict=True)]]
        )
    )


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
