"""Rate many directions at once by sums over a few thousand samples of the surface.

Supports count down to the bed, and there are no bridges: this is an upper bound, from which the best directions are
rated more exactly.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from printer_slicer.arrays import Float
from printer_slicer.geometry.raster import Float32
from printer_slicer.orienting.body import Body
from printer_slicer.orienting.prices import FLAT, GENTLE, Prices, measure_stairs

__all__ = ["rate_roughly"]

_BLOCK: Final = 1 << 19  # samples times directions at once, so that the arrays stay in the processor's cache


def rate_roughly(body: Body, down: Float, prices: Prices) -> Float:
    """Return the cost (D,) of printing a body with each direction down, min.

    Args:
        body: the part in its own axes.
        down: (D, 3) unit vectors.
        prices: of time, support and deviation.
    """
    count = max(_BLOCK // max(len(body.coarse.area), 1), 1)
    return np.concatenate(
        [_rate_block(body, down[start : start + count], prices) for start in range(0, len(down), count)]
    )


def _rate_block(body: Body, down: Float, prices: Prices) -> Float:
    """Return the cost (d,) of some directions (d, 3), min."""
    samples, times = body.coarse, prices.times
    narrow = down.astype(np.float32)
    depths = down @ body.hull.T
    lowest, height = depths.max(axis=1), np.ptp(depths, axis=1)
    cosine = narrow @ samples.normals
    slope = np.abs(cosine)
    sine = np.sqrt(np.maximum(np.float32(1) - cosine * cosine, np.float32(0)))
    filled = times.fill_shells(-cosine, sine)
    flat = slope > FLAT
    volumes = times.divide(
        sine @ samples.area, (filled * flat) @ samples.area, (filled * ~flat) @ samples.area, body.volume
    )
    layers = np.maximum(height / times.layer_height, 1.0)
    width = np.full(len(down), 2 * np.sqrt(body.area / 6))
    seconds = times.compute_seconds(volumes, layers, width, times.layer_height)
    space, area = _measure_supports(body, narrow, lowest, cosine, prices)
    extruded = prices.extrude_support(space, area)
    seconds = seconds + times.compute_support_seconds(*extruded)
    stairs = (measure_stairs(slope, sine) * ~flat) @ samples.area * times.layer_height * prices.stair_share
    grams = prices.weigh(extruded.sum(axis=0))
    return prices.compute_cost(seconds / 60, grams, stairs + prices.gap * area.sum(axis=0))


def _measure_supports(
    body: Body, down: Float32, lowest: Float, cosine: Float32, prices: Prices
) -> tuple[Float, Float]:
    """Return the space (2, d) below gentle and steeper overhangs, mm³, and their area (2, d) seen from above, mm²."""
    z = lowest.astype(np.float32)[:, None] - down @ body.coarse.points
    hangs = (cosine > prices.overhang_cosine) & (z > prices.on_bed)
    gentle = hangs & (cosine > GENTLE)
    seen = [cosine * gentle, cosine * (hangs & ~gentle)]
    return np.stack([(one * z) @ body.coarse.area for one in seen]), np.stack(
        [one @ body.coarse.area for one in seen]
    )
