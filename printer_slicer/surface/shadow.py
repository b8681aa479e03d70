"""The shadow of the surface: the area of its projection on the bed, as a function of height.

Let S(z) be the area of the projections of everything of the surface that lies below z, added up facet by facet. Where
the surface passes a place (x, y) of a layer from z0 to z1 at height h, once, the layer is wrong there from h to the end
that lies on the same side of the cut c as h. Summed over the shadow that is V(z1) + V(z0) - 2 V(c) for c in the middle,
where V is the integral of S: a closed form. Where the surface passes more often it is more than what is wrong. Upright
facets throw no shadow. (Mao, Kwok, Chen and Wang, 2019, slice by a profile over z of this kind.)

The projection of one facet grows with z as two parabolas: from its lowest corner to the middle one, and on to the
highest.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from printer_slicer.arrays import Float, Int, frozen_array
from printer_slicer.geometry.facet_topology import spread
from printer_slicer.model import Mesh

__all__ = ["Shadow", "project_surface"]

_PAIRS_AT_ONCE = 2_000_000
_AT_ONCE = 1 << 15  # facets whose columns stay in the processor's cache
_FEW = 2  # planes between two corners up to which they are looked at one by one


@dataclass(frozen=True, slots=True, eq=False)
class Shadow:
    """Facets as what they throw: three heights and an area each.

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
            object.__setattr__(self, name, frozen_array(getattr(self, name), np.float64, (len(self.area),)))

    def _blocks(self) -> Iterator[Shadow]:
        """The facets some at a time, so that what is worked out of them stays in the processor's cache."""
        for at in range(0, len(self.area), _AT_ONCE):
            some = slice(at, at + _AT_ONCE)
            yield Shadow(self.low[some], self.middle[some], self.high[some], self.area[some])

    def under(self, planes: Float, *, including: bool = False) -> Float:
        """(n,) mm², the shadow of what lies below each of the ascending planes; `including` what lies in the plane."""
        total = np.zeros(len(planes))
        for block in self._blocks():
            first = np.searchsorted(planes, block.high, side="left" if including else "right")
            whole = np.bincount(first, weights=block.area, minlength=len(planes) + 1)
            total += np.cumsum(whole)[:-1] + _over_pairs(block, planes, first, 2)
        return total

    def integral(self, planes: Float) -> Float:
        """(n,) mm³, the integral of the shadow from below the part up to each of the ascending planes."""
        total = np.zeros(len(planes))
        for block in self._blocks():
            first = np.searchsorted(planes, block.high)
            mean = (block.low + block.middle + block.high) / 3
            whole, lever = (
                np.cumsum(np.bincount(first, weights=weight, minlength=len(planes) + 1))[:-1]
                for weight in (block.area, block.area * mean)
            )
            total += whole * planes - lever + _over_pairs(block, planes, first, 3)
        return total

    def on_lattice(self, cell: float, n_cells: int) -> Float:
        """(n_cells + 1,) mm³, the integral up to each multiple of `cell`, at the same cost for many as for few.

        Exact for facets that lie between two planes, by the trapezoidal rule for the others.
        """
        n = n_cells + 1
        total = np.zeros((3, n))
        for block in self._blocks():
            heights = block.low / cell, block.middle / cell, block.high / cell
            total += _on_lattice(heights, block.area, n)
        whole, lever, shadow = total
        steps = np.concatenate([[0.0], np.cumsum((shadow[1:] + shadow[:-1]) / 2)])
        return np.asarray((whole * np.arange(n) - lever + steps) * cell)


def _over_pairs(shadow: Shadow, planes: Float, end: Int, power: int) -> Float:
    """Sum over the facets that planes pass through, each from its lowest corner up to plane `end`."""
    total = np.zeros(len(planes))
    begin = np.searchsorted(planes, shadow.low, side="right")
    count = np.maximum(end - begin, 0)
    pairs = np.cumsum(count)
    n_chunks = int(pairs[-1]) // _PAIRS_AT_ONCE + 1 if len(pairs) else 0
    for some in np.split(
        np.arange(len(count)), np.searchsorted(pairs, np.arange(1, n_chunks) * _PAIRS_AT_ONCE)
    ):
        owner, place = spread(count[some])
        facet, plane = some[owner], begin[some][owner] + place
        total += np.bincount(
            plane, weights=_below(shadow, facet, planes[plane], power), minlength=len(planes)
        )
    return total


def _below(shadow: Shadow, facet: Int, z: Float, power: int) -> Float:
    """What facets contribute at heights between their corners: to the shadow (power 2) or its integral (3)."""
    low, middle, high, area = shadow.low[facet], shadow.middle[facet], shadow.high[facet], shadow.area[facet]
    rising = z < middle
    leg = np.where(rising, middle - low, high - middle)
    reach = np.where(rising, z - low, high - z)
    curve = area * reach**power / np.maximum((high - low) * leg, 1e-300)
    if power == 2:
        return np.asarray(np.where(rising, curve, area - curve))
    return np.asarray(np.where(rising, 0, area * (z - (low + middle + high) / 3)) + curve / 3)


def _on_lattice(heights: tuple[Float, Float, Float], area: Float, n: int) -> Float:
    """(3, n): area and lever of facets that lie below each plane and between two, and shadow of the others.

    Args:
        heights: (m,) of the lowest, middle and highest corner of each facet, in cells.
        area: (m,) mm².
        n: planes.
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
    shadow = _parabolas((at_low, at_middle), 0 * area, bend, low, n)
    bend = -area / np.maximum(span * (high - middle), 1e-300)
    shadow += _parabolas((at_middle, at_high), area, bend, high, n)
    shadow += np.cumsum(np.bincount(at_high, weights=area, minlength=n + 1))[:n]
    return np.stack([whole, lever, shadow])


def _parabolas(reach: tuple[Int, Int], base: Float, bend: Float, apex: Float, n: int) -> Float:
    """(n,) the sum over facets of `base + bend (i - apex)²` at the places i that `reach` begins with and ends before.

    The coefficients are added where a parabola begins and taken away where it ends. Steep short ones would leave their
    rounding behind; those are added place by place.
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
    # Places are counted from the middle: smaller numbers, less rounding.
    off, u = apex[on] - n / 2, np.arange(n + 1) - n / 2
    for power, weight in enumerate((base + bend * off**2, -2 * bend * off, bend)):
        change = np.bincount(begin[on], weights=weight, minlength=n + 1)
        change -= np.bincount(end[on], weights=weight, minlength=n + 1)
        total += np.cumsum(change) * u**power
    return total[:n]


def project_surface(mesh: Mesh) -> tuple[Shadow, Shadow]:
    """The shadows of the facets that face up, and of those that face down."""
    nothing = np.zeros((4, 0))
    blocks = [_thrown(mesh.triangles[at : at + _AT_ONCE]) for at in range(0, mesh.n_facets, _AT_ONCE)]
    up, down = (np.concatenate([nothing, *side], axis=1) for side in zip(*blocks, strict=True))
    return Shadow(*up), Shadow(*down)


def _thrown(triangles: Float) -> tuple[Float, Float]:
    """(4, n) heights of the corners and area of the facets that face up, and of those that face down."""
    x, y, z = np.ascontiguousarray(triangles.transpose(2, 1, 0))  # (3, n): corner, facet
    area = ((x[1] - x[0]) * (y[2] - y[0]) - (x[2] - x[0]) * (y[1] - y[0])) / 2
    low, high = np.minimum(np.minimum(z[0], z[1]), z[2]), np.maximum(np.maximum(z[0], z[1]), z[2])
    middle = np.maximum(np.minimum(z[0], z[1]), np.minimum(np.maximum(z[0], z[1]), z[2]))
    facets = np.stack([low, middle, high, np.abs(area)])
    return facets[:, area > 0], facets[:, area < 0]
