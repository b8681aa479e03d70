"""Two crossing sets of lines on every layer: strong in both directions at each height."""

from __future__ import annotations

import numpy as np

from printer_slicer.geometry import chain_rows, hatch
from printer_slicer.model import Areas, Float, Int, reordered

__all__ = ["grid_lines"]


def grid_lines(area: Areas, spacing: Float, angle: Float, turn: Float) -> tuple[Float, Int, Int]:
    """Polylines of a square grid with as much plastic as parallel lines `spacing` (L,) mm apart.

    The grid keeps its place from layer to layer, so that its walls stand on each other.

    Args:
        area: where to fill.
        spacing: mm.
        angle: (L,) radians; the pattern is the same after a quarter turn, so alternating angles do not matter.
        turn: (L,) mm; lines of one direction are joined where that takes no more.

    Returns:
        Points (N, 2), number of points (M,) and layer (M,) of each polyline, by ascending layer.
    """
    parts = []
    for crosswise in (0.0, np.pi / 2):
        lines = hatch(area, angle=angle % (np.pi / 2) + crosswise, spacing=2 * spacing)
        xy, start, layer = chain_rows(lines, max_turn=turn)
        parts.append((xy, np.diff(start), layer))
    layer = np.concatenate([part[2] for part in parts])
    order = np.argsort(layer, kind="stable")
    sizes = np.concatenate([part[1] for part in parts])
    (xy,), size = reordered((np.concatenate([part[0] for part in parts]),), sizes, order)
    return xy, size, layer[order]
