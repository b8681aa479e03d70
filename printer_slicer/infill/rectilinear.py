"""Parallel lines, joined at their ends where neighbours allow it; the direction turns by 90° from layer to layer."""

from __future__ import annotations

import numpy as np

from printer_slicer.geometry import chain_rows, hatch
from printer_slicer.model import Areas, Float, Int

__all__ = ["rectilinear_lines"]

# A turn runs along the boundary, which meets the lines at any angle; past 20° it is longer than three spacings.
_LONGEST_TURN = 3.0


def rectilinear_lines(area: Areas, spacing: Float, angle: Float) -> tuple[Float, Int, Int]:
    """Polylines that fill `area` with lines `spacing` (L,) mm apart in direction `angle` (L,) radians.

    Returns:
        Points (N, 2), number of points (M,) and layer (M,) of each polyline, by ascending layer.
    """
    xy, start, layer = chain_rows(hatch(area, angle=angle, spacing=spacing), max_turn=_LONGEST_TURN * spacing)
    return xy, np.diff(start), layer
