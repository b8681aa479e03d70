"""Random solids for tests of supports: blobs, bars and caves of noise on a raster of cubes."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from printer_slicer.arrays import Bool
from printer_slicer.geometry import Areas, normalize
from printer_slicer.model import LayerPlan, Sections

__all__ = ["noise_sections", "noise_solid"]


def noise_solid(seed: int, side: int = 14) -> Bool:
    """(z, y, x) cubes of smooth noise; a part of them hangs, and much of it encloses ways to the bed."""
    rng = np.random.default_rng(seed)
    smooth = ndimage.gaussian_filter(rng.random((side, side, side)), rng.uniform(0.6, 1.6))
    share = rng.uniform(0.1, 0.45)
    solid = smooth > np.quantile(smooth, 1 - share)
    solid[0, side // 2, side // 2] = True
    return np.asarray(solid)


def noise_sections(seed: int, cube: float = 2.0, height: float = 0.25, side: int = 14) -> Sections:
    """Sections of a noise solid, cubes of `cube` mm, with layers of `height` mm."""
    solid = noise_solid(seed, side)
    plan = LayerPlan.from_tops(np.arange(1, round(side * cube / height) + 1) * height)
    corners = np.array([(0, 0), (1, 0), (1, 1), (0, 1)]) * 1.0
    rings = []
    for cells in solid:
        row, column = np.nonzero(cells)
        # Corners that only touch would make outlines that touch themselves.
        rings.append(
            [
                cube * (np.array([x, y]) - side / 2 + corners * 1.004 - 0.002)
                for y, x in zip(row, column, strict=True)
            ]
        )
    slices = normalize(Areas.from_rings(rings))
    return Sections(plan, slices.copy_layers((plan.cut / cube).astype(np.int64)))
