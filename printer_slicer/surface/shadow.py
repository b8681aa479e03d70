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

from dataclasses import dataclass

import numpy as np

from printer_slicer.geometry import frozen_array
from printer_slicer.geometry.planes import spread
from printer_slicer.model import Float, Int, Mesh

__all__ = ["Shadow", "throw"]

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

    def under(self, planes: Float, *, including: bool = False) -> Float:
        """(n,) mm², the shadow of what lies below each of the ascending planes; `including` what lies in the plane."""
        first = np.searchsorted(planes, self.high, side="left" if including else "right")
        whole = np.cumsum(np.bincount(first, weights=self.area, minlength=len(planes) + 1))[:-1]
        return whole + self._over_pairs(planes, first, 2)

    def integral(self, planes: Float) -> Float:
        """(n,) mm³, the integral of the shadow from below the part up to each of the ascending planes."""
        first = np.searchsorted(planes, self.high)
        mean = (self.low + self.middle + self.high) / 3
        whole, lever = (
            np.cumsum(np.bincount(first, weights=weight, minlength=len(planes) + 1))[:-1]
            for weight in (self.area, self.area * mean)
        )
        return whole * planes - lever + self._over_pairs(planes, first, 3)

    def _over_pairs(self, planes: Float, end: Int, power: int) -> Float:
        """Sum over the facets that planes pass through, each from its lowest corner up to plane `end`."""
        total = np.zeros(len(planes))
        begin = np.searchsorted(planes, self.low, side="right")
        count = np.maximum(end - begin, 0)
        pairs = np.cumsum(count)
        n_chunks = int(pairs[-1]) // _PAIRS_AT_ONCE + 1 if len(pairs) else 0
        for some in np.split(
            np.arange(len(count)), np.searchsorted(pairs, np.arange(1, n_chunks) * _PAIRS_AT_ONCE)
        ):
            owner, place = spread(count[some])
            facet, plane = some[owner], begin[some][owner] + place
            total += np.bincount(
                plane, weights=self._below(facet, planes[plane], power), minlength=len(planes)
            )
        return total

    def _below(self, facet: Int, z: Float, power: int) -> Float:
        """What facets contribute at heights between their corners: to the shadow (power 2) or its integral (3)."""
        low, middle, high, area = self.low[facet], self.middle[facet], self.high[facet], self.area[facet]
        rising = z < middle
        leg = np.where(rising, middle - low, high - middle)
        reach = np.where(rising, z - low, high - z)
        curve = area * reach**power / np.maximum((high - low) * leg, 1e-300)
        if power == 2:
            return np.asarray(np.where(rising, curve, area - curve))
        return np.asarray(np.where(rising, 0, area * (z - (low + middle + high) / 3)) + curve / 3)

    def on_lattice(self, cell: float, n_cells: int) -> Float:
        """(n_cells + 1,) mm³, the integral up to each multiple of `cell`, at the same cost for many as for few.

        Exact for facets that lie between two planes, by the trapezoidal rule for the others.
        """
        n = n_cells + 1
        low, middle, high = self.low / cell, self.middle / cell, self.high / cell
        at_low, at_middle, at_high = (np.ceil(z).clip(0, n).astype(np.int64) for z in (low, middle, high))
        between = at_low == at_high
        mean = (low + middle + high) / 3
        ends = at_high[between]
        whole, lever = (
            np.cumsum(np.bincount(ends, weights=weight[between], minlength=n + 1))[:n]
            for weight in (self.area, self.area * mean)
        )
        through = ~between
        area, span = self.area[through], (high - low)[through]
        bend = area / np.maximum(span * (middle - low)[through], 1e-300)
        rising = _parabolas((at_low[through], at_middle[through]), 0 * area, bend, low[through], n)
        bend = -area / np.maximum(span * (high - middle)[through], 1e-300)
        falling = _parabolas((at_middle[through], at_high[through]), area, bend, high[through], n)
        done = np.cumsum(np.bincount(at_high[through], weights=area, minlength=n + 1))[:n]
        shadow = rising + falling + done
        steps = np.concatenate([[0.0], np.cumsum((shadow[1:] + shadow[:-1]) / 2)])
        return np.asarray((whole * np.arange(n) - lever + steps) * cell)


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


def throw(mesh: Mesh) -> tuple[Shadow, Shadow]:
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
