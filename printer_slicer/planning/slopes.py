"""How steeply the surface leans over any stretch of z: the largest |n_z| of the facets there, looked up in a table.

|n_z| is the vertical part of a facet's unit normal: 0 for a wall, 1 for a flat. The z axis is divided into steps, and
every step holds the largest |n_z| of the facets that pass through it. Flats have no extent along z: they stand between
two steps, and only a layer that has them strictly inside sees them.

The table is the sparse table of range-maximum queries: level p holds the largest of 2^p neighbours. Cost: one pass
over the facets, and levels * log(levels) for the table; a query costs two look-ups.

What it leaves out: edges and corners may lean farther towards the vertical than the facets beside them, and peaks are
not seen at all. `printer_slicer.surface` counts them.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from printer_slicer.arrays import Bool, Float, Int
from printer_slicer.model import Mesh
from printer_slicer.planning.z_steps import ZSteps
from printer_slicer.profile import Profile
from printer_slicer.surface.covers import painted

__all__ = ["Slopes", "cusp_height", "nearest_step", "thickest_within"]

_LEVEL: Final = 1e-3  # rise over run under which a facet is a flat
_ROUNDING: Final = (
    1e-4  # mm; coordinates in STL files have 24 bits, so corners lie this far from where they were drawn
)
_BLOCK: Final = 1 << 15  # facets looked at together: their columns stay in the cache
_SLACK: Final = 1e-4  # steps; a limit that is a whole number of steps must not lose one to rounding


def cusp_height(profile: Profile) -> float:
    """The cusp height t |n_z| that `quality.tolerance` allows a layer of height t, mm.

    A layer that is cut in its middle is off by half of its cusp height at most; one that holds all (or nothing but)
    what the part covers between its bottom and its top is off by all of it.
    """
    quality = profile.quality
    return quality.tolerance * (2 if quality.containment == "mid" else 1)


def nearest_step(z: Float, size: float) -> Int:
    """The z step nearest to each height in mm; halves are rounded down, with the dust of sums counted as a half."""
    return np.floor(np.asarray(z) / size + 0.499).astype(np.int64)


class Slopes:
    """The largest |n_z| of all facets over any interval of z.

    Args:
        mesh: the part, standing on z = 0.
        steps: of the printer; intervals are given in its z steps.
        flats: whether horizontal facets count; without them a plan does not see them.
    """

    def __init__(self, mesh: Mesh, steps: ZSteps, *, flats: bool = True) -> None:
        self._steps, self._top = steps, mesh.height
        # Places are half steps: 2k is the node at step k, where flats are; 2k + 1 is all between steps k and k + 1.
        width = 2 * steps.part + 1
        self._table = np.zeros((width.bit_length(), width))
        for begin in range(0, mesh.n_facets, _BLOCK):
            slope, low, high, flat = _facets(mesh.triangles[begin : begin + _BLOCK])
            first, last = self._places(low, high, flat)
            seen = slope if flats else np.where(flat, 0.0, slope)
            np.maximum(self._table[0], painted(first, last, seen, width), out=self._table[0])
        for level in range(1, len(self._table)):
            half, below = 1 << (level - 1), self._table[level - 1]
            self._table[level] = below
            np.maximum(below[:-half], below[half:], out=self._table[level, :-half])

    def _places(self, low: Float, high: Float, flat: Bool) -> tuple[Int, Int]:
        """First and last place (n,) of facets between two heights in mm."""
        size, part = self._steps.size, self._steps.part
        margin = min(_ROUNDING / size, 0.1)
        first = 2 * np.floor(low / size + margin).astype(np.int64) + 1
        last = 2 * np.ceil(high / size - margin).astype(np.int64) - 1
        first, last = np.clip(first, 1, 2 * part - 1), np.clip(last, 1, 2 * part - 1)
        # The part's top need not be on a step, and is the end of the last layer all the same.
        over = (low + high) / 2 > min((part - 0.502) * size, self._top - _ROUNDING)
        node = 2 * np.clip(np.where(over, part, nearest_step((low + high) / 2, size)), 0, part)
        at_node = flat | (first > last)
        return np.where(at_node, node, first), np.where(at_node, node, last)

    def largest(self, bottom: Int, top: Int) -> Float:
        """The largest |n_z| strictly between z steps `bottom` (n,) and `top` (n,); 0 where there is no facet."""
        places = self._table.shape[1]
        first = 2 * np.asarray(bottom, np.int64) + 1
        length = np.minimum(2 * np.asarray(top, np.int64), places - 1) - first
        empty = length < 1
        first, length = np.where(empty, 0, first), np.where(empty, 1, length)
        level = np.frexp(length)[1] - 1
        left = self._table[level, first]
        right = self._table[level, first + length - (1 << level.astype(np.int64))]
        return np.where(empty, 0.0, np.maximum(left, right))


def thickest_within(
    slopes: Slopes, steps: ZSteps, limit: Callable[[Float], Float], *, seen: float = 1.0
) -> Int:
    """(part,) the thickest layer in z steps that may begin at each step; the thinnest allowed one always may.

    Args:
        slopes: of the part.
        steps: of the printer.
        limit: the greatest layer height in mm for each |n_z|; must not grow with it.
        seen: the share of a layer, from its bottom, whose facets decide.
    """
    bottom = np.arange(steps.part)
    low = np.full(steps.part, steps.allowed[0], np.int64)
    high = np.full(steps.part, max(steps.highest, int(steps.allowed[0])), np.int64)
    # A thicker layer sees more facets and may only be thinner for it: what fits is found by halving.
    while (low < high).any():
        middle = (low + high + 1) // 2
        window = np.ceil(middle * seen).astype(np.int64)
        fits = middle * steps.size <= limit(slopes.largest(bottom, bottom + window)) + _SLACK * steps.size
        low, high = np.where(fits, middle, low), np.where(fits, high, middle - 1)
    return low


def _facets(triangles: Float) -> tuple[Float, Float, Float, Bool]:
    """|n_z| (n,), lowest and highest z (n,) in mm, and which facets are flats (n,)."""
    ax, ay, az, bx, by, bz, cx, cy, cz = np.ascontiguousarray(triangles.reshape(-1, 9).T)
    low, high = np.minimum(np.minimum(az, bz), cz), np.maximum(np.maximum(az, bz), cz)
    bx, by, bz, cx, cy, cz = bx - ax, by - ay, bz - az, cx - ax, cy - ay, cz - az
    level = np.hypot(by * cz - bz * cy, bz * cx - bx * cz)
    upright = np.abs(bx * cy - by * cx)
    slope = upright / np.maximum(np.hypot(level, upright), 1e-300)
    flat = level <= _LEVEL * upright
    return np.where(flat & (upright > 0), 1.0, slope), low, high, flat
