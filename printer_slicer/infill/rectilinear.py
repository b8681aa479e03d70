"""Parallel lines, joined at their ends where neighbours allow it; the direction turns by 90° from layer to layer."""

from __future__ import annotations

import numpy as np

from printer_slicer.geometry import chain_rows, hatch
from printer_slicer.model import Areas, Float, Int

__all__ = ["rectilinear_lines"]


def rectilinear_lines(
    area: Areas, spacing: Float, angle: Float, turn: Float, phase: Float | float = 0.0
) -> tuple[Float, Int, Int]:
    """Polylines that fill `area` with lines `spacing` (L,) mm apart in direction `angle` (L,) radians.

    Neighbouring lines are joined where that takes at most `turn` (L,) mm. Rows lie at (j + phase) * spacing across
    their direction, seen from the origin.

    Returns:
        Points (N, 2), number of points (M,) and layer (M,) of each polyline, by ascending layer.
    """
    xy, start, layer = chain_rows(hatch(area, angle=angle, spacing=spacing, phase=phase), max_turn=turn)
    return xy, np.diff(start), layer
