"""Sweep areas along a straight line."""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Float
from printer_slicer.geometry.areas import Areas
from printer_slicer.geometry.engine import normalize

__all__ = ["sweep_areas"]

_SHORTEST = 1e-6  # mm; below the grid steps of the engines


def sweep_areas(areas: Areas, way: Float) -> Areas:
    """Sweep areas along the straight line from `-way` to `+way`.

    The result is the union of the areas at both ends and of the parallelogram that each edge sweeps.

    Args:
        areas: clean areas.
        way: (n_layers, 2) mm, half of the movement of each layer.
    """
    if not areas.n_rings:
        return areas
    seen = np.where(np.abs(way) < _SHORTEST, 0.0, way)
    by = np.repeat(seen[areas.ring_layer], np.diff(areas.ring_start), axis=0)
    begin, end, layer = areas.xy, areas.xy[areas.following], areas.point_layer
    quads = np.stack([begin - by, end - by, end + by, begin + by], axis=1)
    side = end - begin
    right = side[:, 0] * by[:, 1] - side[:, 1] * by[:, 0] < 0
    quads[right] = quads[right, ::-1]
    passed = Areas(quads.reshape(-1, 2), 4 * np.arange(len(quads) + 1), layer, areas.n_layers)
    ends = [Areas(begin + step * by, areas.ring_start, areas.ring_layer, areas.n_layers) for step in (-1, 1)]
    return normalize(ends[0].merge(ends[1]).merge(passed))
