"""Parallel lines, joined at their ends where neighbours allow it; the direction turns by 90° from layer to layer."""

from __future__ import annotations

import numpy as np

from printer_slicer.geometry import chain_rows, hatch
from printer_slicer.model import Areas, Float, Int

__all__ = ["rectilinear_lines"]


def rectilinear_lines(area: Areas, spacing: Float, angle: Float, turn: Float) -> tuple[Float, Int, Int]:
    """Polylines that fill `area` with lines `spacing` (L,) mm apart in direction `angle` (L,) radians.

    Neighbouring lines are joined where that takes at most `turn` (L,) mm.

    Returns:
        Points (N, 2), number of points (M,) and layer (M,) of each polyline, by ascending layer.
    """
    xy, start, layer = chain_rows(hatch(area, angle=angle, spacing=spacing), max_turn=turn)
    return xy, np.diff(start), layer
