"""Rate many directions at once by sums over a few thousand samples of the surface.

Supports count down to the bed, and there are no bridges: this is an upper bound, from which the best directions are
rated more exactly.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from printer_slicer.arrays import Float
from printer_slicer.geometry.raster import Float32
from printer_slicer.orienting.cost_model import FLAT, GENTLE, CostModel, measure_stairs
from printer_slicer.orienting.part_shape import PartShape

__all__ = ["rate_roughly"]

_BLOCK: Final = 1 << 19  # samples times directions at once, so that the arrays stay in the processor's cache


def rate_roughly(shape: PartShape, down: Float, cost_model: CostModel) -> Float:
    """Return the cost (D,) of printing a part with each direction down, min.

    Args:
        shape: the part in its own axes.
        down: (D, 3) unit vectors.
        cost_model: of time, support and deviation.
    """
    count = max(_BLOCK // max(len(shape.coarse.area), 1), 1)
    return np.concatenate(
        [_rate_block(shape, down[start : start + count], cost_model) for start in range(0, len(down), count)]
    )


def _rate_block(shape: PartShape, down: Float, cost_model: CostModel) -> Float:
    """Return the cost (d,) of some directions (d, 3), min."""
    samples, times = shape.coarse, cost_model.times
    narrow = down.astype(np.float32)
    depths = down @ shape.hull.T
    lowest, height = depths.max(axis=1), np.ptp(depths, axis=1)
    cosine = narrow @ samples.normals
    slope = np.abs(cosine)
    sine = np.sqrt(np.maximum(np.float32(1) - cosine * cosine, np.float32(0)))
    filled = times.fill_shells(-cosine, sine)
    flat = slope > FLAT
    volumes = times.divide(
        sine @ samples.area, (filled * flat) @ samples.area, (filled * ~flat) @ samples.area, shape.volume
    )
    layers = np.maximum(height / times.layer_height, 1.0)
    width = np.full(len(down), 2 * np.sqrt(shape.area / 6))
    seconds = times.compute_seconds(volumes, layers, width, times.layer_height)
    space, area = _measure_supports(shape, narrow, lowest, cosine, cost_model)
    extruded = cost_model.compute_support_volume(space, area)
    seconds = seconds + times.compute_support_seconds(*extruded)
    stairs = (
        (measure_stairs(slope, sine) * ~flat) @ samples.area * times.layer_height * cost_model.stair_share
    )
    grams = cost_model.compute_grams(extruded.sum(axis=0))
    return cost_model.compute_cost(seconds / 60, grams, stairs + cost_model.gap * area.sum(axis=0))


def _measure_supports(
    shape: PartShape, down: Float32, lowest: Float, cosine: Float32, cost_model: CostModel
) -> tuple[Float, Float]:
    """Return the space (2, d) below gentle and steeper overhangs, mm³, and their area (2, d) seen from above, mm²."""
    z = lowest.astype(np.float32)[:, None] - down @ shape.coarse.points
    hangs = (cosine > cost_model.overhang_cosine) & (z > cost_model.on_bed)
    gentle = hangs & (cosine > GENTLE)
    seen = [cosine * gentle, cosine * (hangs & ~gentle)]
    return np.stack([(one * z) @ shape.coarse.area for one in seen]), np.stack(
        [one @ shape.coarse.area for one in seen]
    )
