"""Projected area on the bed of the surface below a height, as a function of the height.

Let S(z) be the projected area of the surface below z, summed over the facets. Consider a layer from z0 to z1 with its
section at c. If the surface passes a point (x, y) of the layer once, at height h, the layer is wrong there from h to
the end on the same side of c as h. For c in the middle, the sum over the shadow is V(z1) + V(z0) - 2 V(c), where V is
the integral of S. If the surface passes a point more than once, this is an upper bound. Vertical facets have no shadow.
(Mao, Kwok, Chen and Wang, 2019, use a similar profile over z for slicing.)

The projection of one facet grows with z as two parabolas: from its lowest corner to the middle one, and from there to
the highest.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from printer_slicer.arrays import Float, Int, frozen_array
from printer_slicer.geometry.facet_topology import expand_counts
from printer_slicer.model import Mesh
from printer_slicer.values import Struct, force_setattr

__all__ = ["Shadow", "project_surface"]

_PAIRS_AT_ONCE = 2_000_000
_AT_ONCE = 1 << 15  # facets whose columns stay in the processor's cache
_FEW = 2  # planes between two corners; up to this many are added one by one


class Shadow(Struct, frozen=True, eq=False):
    """The projection of facets on the bed: three corner heights and a projected area for each facet.

    Attributes:
        low, middle, high: (n,) mm, heights of the corners.
        area: (n,) mm², of the projection.
    """

    low: Float
    middle: Float
    high: Float
    area: Float

    def __post_init__(self) -> None:
        for name in ("low", "middle", "high", "area"):
            force_setattr(self, name, frozen_array(getattr(self, name), np.float64, (len(self.area),)))

    def _iterate_blocks(self) -> Iterator[Shadow]:
        """Yield the facets in blocks, so that intermediate results stay in the processor's cache."""
        for at in range(0, len(self.area), _AT_ONCE):
            some = slice(at, at + _AT_ONCE)
            yield Shadow(self.low[some], self.middle[some], self.high[some], self.area[some])

    def area_below(self, planes: Float, *, including: bool = False) -> Float:
        """Return the projected area (n,) below each plane (ascending), mm²; `including` adds facets in planes."""
        total = np.zeros(len(planes))
        for block in self._iterate_blocks():
            first = np.searchsorted(planes, block.high, side="left" if including else "right")
            whole = np.bincount(first, weights=block.area, minlength=len(planes) + 1)
            total += np.cumsum(whole)[:-1] + _sum_intersected_facets(block, planes, first, 2)
        return total

    def area_integral(self, planes: Float) -> Float:
        """Return the integral (n,) of `area_below` over z, from below the part up to each plane (ascending), mm³."""
        total = np.zeros(len(planes))
        for block in self._iterate_blocks():
            first = np.searchsorted(planes, block.high)
            mean = (block.low + block.middle + block.high) / 3
            whole, lever = (
                np.cumsum(np.bincount(first, weights=weight, minlength=len(planes) + 1))[:-1]
                for weight in (block.area, block.area * mean)
            )
            total += whole * planes - lever + _sum_intersected_facets(block, planes, first, 3)
        return total

    def area_integral_on_lattice(self, cell: float, n_cells: int) -> Float:
        """Return the integral (n_cells + 1,) of `area_below` over z up to each multiple of `cell`, mm³.

        The cost hardly depends on the number of cells. The result is exact for facets between two planes; other facets
        use the trapezoidal rule.
        """
        n = n_cells + 1
        total = np.zeros((3, n))
        for block in self._iterate_blocks():
            heights = block.low / cell, block.middle / cell, block.high / cell
            total += _sum_on_lattice(heights, block.area, n)
        whole, lever, shadow = total
        steps = np.concatenate([[0.0], np.cumsum((shadow[1:] + shadow[:-1]) / 2)])
        return np.asarray((whole * np.arange(n) - lever + steps) * cell)


def _sum_intersected_facets(shadow: Shadow, planes: Float, end: Int, power: int) -> Float:
    """Add up the facets that planes intersect, each from its lowest corner up to plane `end`."""
    total = np.zeros(len(planes))
    begin = np.searchsorted(planes, shadow.low, side="right")
    count = np.maximum(end - begin, 0)
    pairs = np.cumsum(count)
    n_chunks = int(pairs[-1]) // _PAIRS_AT_ONCE + 1 if len(pairs) else 0
    for some in np.split(
        np.arange(len(count)), np.searchsorted(pairs, np.arange(1, n_chunks) * _PAIRS_AT_ONCE)
    ):
        owner, place = expand_counts(count[some])
        facet, plane = some[owner], begin[some][owner] + place
        total += np.bincount(
            plane, weights=_evaluate_parabolas(shadow, facet, planes[plane], power), minlength=len(planes)
        )
    return total


def _evaluate_parabolas(shadow: Shadow, facet: Int, z: Float, power: int) -> Float:
    """Return each facet's share of the projected area (power 2) or its integral (3) at a height between its corners."""
    low, middle, high, area = shadow.low[facet], shadow.middle[facet], shadow.high[facet], shadow.area[facet]
    rising = z < middle
    leg = np.where(rising, middle - low, high - middle)
    reach = np.where(rising, z - low, high - z)
    curve = area * reach**power / np.maximum((high - low) * leg, 1e-300)
    if power == 2:
        return np.asarray(np.where(rising, curve, area - curve))
    return np.asarray(np.where(rising, 0, area * (z - (low + middle + high) / 3)) + curve / 3)


def _sum_on_lattice(heights: tuple[Float, Float, Float], area: Float, n: int) -> Float:
    """Add up a block of facets on a lattice of planes.

    Args:
        heights: (m,) each, height of the lowest, middle and highest corner of each facet, in cells.
        area: (m,) mm².
        n: number of planes.

    Returns:
        An array (3, n). Facets between two planes give the area and the first moment below each plane; all others give
        their shadow.
    """
    low, middle, high = heights
    at_low, at_middle, at_high = (np.ceil(z).clip(0, n).astype(np.int64) for z in heights)
    between = at_low == at_high
    ends, inner = at_high[between], area[between]
    levers = inner * ((low + middle + high) / 3)[between]
    whole, lever = (np.cumsum(np.bincount(ends, weights=one, minlength=n + 1))[:n] for one in (inner, levers))
    through = np.flatnonzero(~between)
    low, middle, high, area = (one.take(through) for one in (low, middle, high, area))
    at_low, at_middle, at_high = (one.take(through) for one in (at_low, at_middle, at_high))
    span = high - low
    bend = area / np.maximum(span * (middle - low), 1e-300)
    shadow = _sum_parabolas((at_low, at_middle), 0 * area, bend, low, n)
    bend = -area / np.maximum(span * (high - middle), 1e-300)
    shadow += _sum_parabolas((at_middle, at_high), area, bend, high, n)
    shadow += np.cumsum(np.bincount(at_high, weights=area, minlength=n + 1))[:n]
    return np.stack([whole, lever, shadow])


def _sum_parabolas(reach: tuple[Int, Int], base: Float, bend: Float, apex: Float, n: int) -> Float:
    """Return the sums (n,) of parabolas `base + bend (i - apex)²` of facets, for i from `reach[0]` to `reach[1]` - 1.

    The coefficients are added where a parabola starts and subtracted where it ends. Short parabolas are steep and would
    leave rounding errors, so they are added position by position.
    """
    begin, end = reach
    total = np.zeros(n + 1)
    short = end - begin <= _FEW
    for ahead in range(_FEW):
        on = np.flatnonzero(short & (begin + ahead < end))
        place = begin[on] + ahead
        total += np.bincount(place, weights=base[on] + bend[on] * (place - apex[on]) ** 2, minlength=n + 1)
    on = np.flatnonzero(~short)
    base, bend = base[on], bend[on]
    # Positions count from the middle: smaller numbers round less.
    off, u = apex[on] - n / 2, np.arange(n + 1) - n / 2
    for power, weight in enumerate((base + bend * off**2, -2 * bend * off, bend)):
        change = np.bincount(begin[on], weights=weight, minlength=n + 1)
        change -= np.bincount(end[on], weights=weight, minlength=n + 1)
        total += np.cumsum(change) * u**power
    return total[:n]


def project_surface(mesh: Mesh) -> tuple[Shadow, Shadow]:
    """Project the facets that face up, and those that face down, on the bed."""
    nothing = np.zeros((4, 0))
    blocks = [_project_block(mesh.triangles[at : at + _AT_ONCE]) for at in range(0, mesh.n_facets, _AT_ONCE)]
    up, down = (np.concatenate([nothing, *side], axis=1) for side in zip(*blocks, strict=True))
    return Shadow(*up), Shadow(*down)


def _project_block(triangles: Float) -> tuple[Float, Float]:
    """Return corner heights and area (4, n) of the facets that face up, and of those that face down."""
    x, y, z = np.ascontiguousarray(triangles.transpose(2, 1, 0))  # (3, n): corner, facet
    area = ((x[1] - x[0]) * (y[2] - y[0]) - (x[2] - x[0]) * (y[1] - y[0])) / 2
    low, high = np.minimum(np.minimum(z[0], z[1]), z[2]), np.maximum(np.maximum(z[0], z[1]), z[2])
    middle = np.maximum(np.minimum(z[0], z[1]), np.minimum(np.maximum(z[0], z[1]), z[2]))
    facets = np.stack([low, middle, high, np.abs(area)])
    return facets[:, area > 0], facets[:, area < 0]
