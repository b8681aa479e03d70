"""A table of the largest |n_z| of the facets in any z interval.

|n_z| is the vertical component of a facet's unit normal: 0 for a wall, 1 for a flat. The z axis is divided into steps,
and each step has the largest |n_z| of the facets that cross it. Flats have no extent along z: they lie between two
steps, and count only for layers that contain them strictly inside.

It is a sparse table for range-maximum queries: level p has the maximum of 2^p neighbours. Cost: one pass over the
facets, and steps * log(steps) for the table; a query takes two look-ups.

The table ignores edges and peaks, where the surface may have a larger |n_z| than the facets beside them.
`printer_slicer.surface` includes these.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from printer_slicer.arrays import Bool, Float, Int
from printer_slicer.model import Mesh
from printer_slicer.planning.z_steps import ZSteps
from printer_slicer.profile import Profile
from printer_slicer.surface.range_maximum import compute_range_maxima

__all__ = ["Slopes", "cusp_height", "find_thickest_layers", "nearest_step"]

_FLAT_SLOPE: Final = 1e-3  # rise over run below which a facet is a flat
_ROUNDING: Final = 1e-4  # mm; rounding error of coordinates in STL files, which have 24 bits
_BLOCK: Final = 1 << 15  # facets per block, which fit the CPU cache
_SLACK: Final = 1e-4  # steps; keeps a limit of a whole number of steps from losing one to rounding


def cusp_height(profile: Profile) -> float:
    """Return the maximum cusp height t |n_z| of a layer of height t that `quality.tolerance` allows, mm.

    A layer that is cut in its middle deviates by at most half its cusp height, a layer with one-sided containment by
    the whole.
    """
    quality = profile.quality
    return quality.tolerance * (2 if quality.containment == "mid" else 1)


def nearest_step(z: Float, size: float) -> Int:
    """Return the z step nearest to each height in mm; heights halfway between steps are rounded down."""
    return np.floor(np.asarray(z) / size + 0.499).astype(np.int64)


class Slopes:
    """The largest |n_z| of all facets in any z interval.

    Args:
        mesh: the part, standing on z = 0.
        steps: z steps of the printer, the unit of intervals.
        flats: whether horizontal facets count.
    """

    def __init__(self, mesh: Mesh, steps: ZSteps, *, flats: bool = True) -> None:
        self._steps, self._top = steps, mesh.height
        # Places are half steps: 2k is the node at step k, where flats are; 2k + 1 is the interval between k and k + 1.
        width = 2 * steps.part + 1
        self._table = np.zeros((width.bit_length(), width))
        for block in range(0, mesh.n_facets, _BLOCK):
            slope, low, high, flat = _measure_facets(mesh.triangles[block : block + _BLOCK])
            first, last = self._find_places(low, high, flat)
            seen = slope if flats else np.where(flat, 0.0, slope)
            np.maximum(self._table[0], compute_range_maxima(first, last, seen, width), out=self._table[0])
        for level in range(1, len(self._table)):
            half, below = 1 << (level - 1), self._table[level - 1]
            self._table[level] = below
            np.maximum(below[:-half], below[half:], out=self._table[level, :-half])

    def _find_places(self, low: Float, high: Float, flat: Bool) -> tuple[Int, Int]:
        """Return the first and last place (n,) in the table of facets that reach from `low` to `high` mm."""
        size, part = self._steps.size, self._steps.part
        margin = min(_ROUNDING / size, 0.1)
        first = 2 * np.floor(low / size + margin).astype(np.int64) + 1
        last = 2 * np.ceil(high / size - margin).astype(np.int64) - 1
        first, last = np.clip(first, 1, 2 * part - 1), np.clip(last, 1, 2 * part - 1)
        # The top of the part need not be on a step, but it is the top of the last layer.
        over = (low + high) / 2 > min((part - 0.502) * size, self._top - _ROUNDING)
        node = 2 * np.clip(np.where(over, part, nearest_step((low + high) / 2, size)), 0, part)
        at_node = flat | (first > last)
        return np.where(at_node, node, first), np.where(at_node, node, last)

    def largest_slope(self, bottom: Int, top: Int) -> Float:
        """Return the largest |n_z| strictly between z steps `bottom` (n,) and `top` (n,); 0 if there is no facet."""
        places = self._table.shape[1]
        first = 2 * np.asarray(bottom, np.int64) + 1
        length = np.minimum(2 * np.asarray(top, np.int64), places - 1) - first
        empty = length < 1
        first, length = np.where(empty, 0, first), np.where(empty, 1, length)
        level = np.frexp(length)[1] - 1
        left = self._table[level, first]
        right = self._table[level, first + length - (1 << level.astype(np.int64))]
        return np.where(empty, 0.0, np.maximum(left, right))


def find_thickest_layers(
    slopes: Slopes, steps: ZSteps, limit: Callable[[Float], Float], *, considered: float = 1.0
) -> Int:
    """Return the thickest layer that may start at each z step (part,), in steps; the thinnest is always allowed.

    Args:
        slopes: table of the part.
        steps: z steps of the printer.
        limit: maximum layer height in mm as a function of |n_z|; must not increase.
        considered: fraction of a layer, from its bottom, whose facets are considered.
    """
    bottom = np.arange(steps.part)
    low = np.full(steps.part, steps.allowed[0], np.int64)
    high = np.full(steps.part, max(steps.highest, int(steps.allowed[0])), np.int64)
    # A thicker layer contains more facets, so its limit is not larger: bisection finds the thickest that fits.
    while (low < high).any():
        middle = (low + high + 1) // 2
        window = np.ceil(middle * considered).astype(np.int64)
        fits = (
            middle * steps.size <= limit(slopes.largest_slope(bottom, bottom + window)) + _SLACK * steps.size
        )
        low, high = np.where(fits, middle, low), np.where(fits, high, middle - 1)
    return low


def _measure_facets(triangles: Float) -> tuple[Float, Float, Float, Bool]:
    """Return for each facet (n,): |n_z|, the lowest and the highest z in mm, and whether the facet is a flat."""
    ax, ay, az, bx, by, bz, cx, cy, cz = np.ascontiguousarray(triangles.reshape(-1, 9).T)
    low, high = np.minimum(np.minimum(az, bz), cz), np.maximum(np.maximum(az, bz), cz)
    bx, by, bz, cx, cy, cz = bx - ax, by - ay, bz - az, cx - ax, cy - ay, cz - az
    level = np.hypot(by * cz - bz * cy, bz * cx - bx * cz)
    upright = np.abs(bx * cy - by * cx)
    slope = upright / np.maximum(np.hypot(level, upright), 1e-300)
    flat = level <= _FLAT_SLOPE * upright
    return np.where(flat & (upright > 0), 1.0, slope), low, high, flat
