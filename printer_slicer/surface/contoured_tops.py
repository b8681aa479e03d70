"""What contouring changes in the errors of layers: extrusions follow shallow upper surfaces (`ContourRule`).

Let a shallow facet be at height s over a place in a layer from z0 to z1, a be the minimum height of an extrusion, and w
its width. A level layer cut in the middle is wrong there from s to the nearer face. A contoured one has its top at the
surface under its centre line, but not below z0 + a, and it is level across its width:

- Volume. Across the slope, the distance from the centre line is w / 4 on average, so the error is (w / 4) tan(slope)
  times the area. Where the surface is lower than a above z0, the layer is empty if it is lower than a / 2, and a high
  otherwise. So the error at the height u = s - z0 is min(u, a - u). Its sum over the area is
  V(z0 + a) + V(z0) - 2 V(z0 + a / 2), with V as in `shadow`.
- Deviation. Let p be a wrong point between the surface and the top of an extrusion, and B the point of the surface on
  the centre line level with p, at most w / 2 away. Between B and the place of p, the surface is no steeper than the
  slope, so it stays on one side of the line from B with this slope. That line touches the ball of radius
  (w / 2) sin(slope) around p, and the surface passes from B to the other side of p. So it reaches the ball: the
  deviation is at most (w / 2) sin(slope), plus the tolerance of the nozzle's z. Below z0 + a it is at most a / 2, plus
  this tolerance.

Where a layer is wrong, the vertical line there crosses a facet in the layer that is not vertical. If only followed
facets are in the layer, the bound of level layers does not count.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, distinct, frozen_array
from printer_slicer.model import ContourRule, LayerPlan
from printer_slicer.surface.range_maximum import compute_range_maxima
from printer_slicer.surface.shadow import Shadow
from printer_slicer.values import Struct, force_setattr

__all__ = ["ContouredLayers", "ShallowFacets", "measure_slopes", "select_shallow_facets"]

_NO_AREA = 1e-9  # mm²
_LEAN = 2e-5  # mm; a facet whose ends differ by less than this seen from above is vertical
_ROUNDING = 1e-6  # mm, and tangents


class ShallowFacets(Struct, frozen=True, eq=False):
    """The facets of a part that may be contoured, the shallowest first.

    Attributes:
        shadow: their projection.
        slope: (n,) tangent of the angle to the horizontal, ascending.
        facet: (n,) their indices.
    """

    shadow: Shadow
    slope: Float
    facet: Int

    def __post_init__(self) -> None:
        for name, kind in (("slope", np.float64), ("facet", np.int64)):
            force_setattr(self, name, frozen_array(getattr(self, name), kind, (len(self.shadow.area),)))

    @classmethod
    def of_triangles(cls, triangles: Float, steepest: float) -> ShallowFacets:
        """Find the facets of triangles (F, 3, 3) that face up and are at most as steep as a tangent."""
        facet, slope, area = select_shallow_facets(triangles, steepest)
        order = np.argsort(slope, kind="stable")
        z = np.sort(triangles[facet[order], :, 2], axis=1)
        return cls(Shadow(z[:, 0], z[:, 1], z[:, 2], area[order]), slope[order], facet[order])

    def take_up_to(self, slope: float) -> ShallowFacets:
        """Return the facets with at most this slope."""
        return self.divide(np.array([slope]))[0]

    def divide(self, slopes: Float) -> list[ShallowFacets]:
        """Return the facets with slopes up to the first one of `slopes` (K,), ascending, then up to each next one."""
        ends = np.searchsorted(self.slope, slopes + _ROUNDING, side="right").tolist()
        return [self._take(slice(first, end)) for first, end in pairwise([0, *ends])]

    def _take(self, some: slice) -> ShallowFacets:
        """Return some of the facets."""
        one = self.shadow
        shadow = Shadow(one.low[some], one.middle[some], one.high[some], one.area[some])
        return ShallowFacets(shadow, self.slope[some], self.facet[some])

    def weigh_by_slope(self) -> Shadow:
        """Return the projection with the areas times the tangents of the slopes."""
        one = self.shadow
        return Shadow(one.low, one.middle, one.high, one.area * self.slope)


def select_shallow_facets(triangles: Float, steepest: float) -> tuple[Int, Float, Float]:
    """Return the indices (n,) of the facets (F, 3, 3) that face up and are at most as steep as a tangent.

    Their slopes (n,) as tangents and their areas (n,) seen from above, mm², follow.
    """
    twice = _cross_sides(triangles, 0, 1)
    some = np.flatnonzero(twice > _NO_AREA)
    upward, twice = triangles[some], twice[some]
    slope = np.hypot(_cross_sides(upward, 1, 2), _cross_sides(upward, 2, 0)) / twice
    shallow = slope <= steepest + _ROUNDING
    return some[shallow], slope[shallow], twice[shallow] / 2


def measure_slopes(triangles: Float) -> Float:
    """Return the slopes (F,) of facets (F, 3, 3) as tangents: 0 if vertical, infinite if they face down."""
    x, y, z = np.ascontiguousarray(triangles.transpose(2, 1, 0))  # (3, F): columns are read faster
    (ax, bx), (ay, by), (az, bz) = ((one[1] - one[0], one[2] - one[0]) for one in (x, y, z))
    twice = ax * by - ay * bx
    normal_x, normal_y = ay * bz - az * by, az * bx - ax * bz
    rise = np.sqrt(normal_x * normal_x + normal_y * normal_y)
    height = np.maximum(np.maximum(z[0], z[1]), z[2]) - np.minimum(np.minimum(z[0], z[1]), z[2])
    # The ends of a steep facet are height / slope apart seen from above.
    is_vertical = (rise > np.abs(twice)) & (height * np.abs(twice) < _LEAN * rise)
    is_vertical |= np.abs(twice) <= _NO_AREA
    slope = np.where(twice > 0, rise / np.maximum(twice, _NO_AREA), np.inf)
    return np.asarray(np.where(is_vertical, 0.0, slope))


def _cross_sides(triangles: Float, x: int, y: int) -> Float:
    """Return the cross product (n,) of two sides of triangles (n, 3, 3) in the plane of two axes."""
    (ax, ay), (bx, by), (cx, cy) = ((triangles[:, corner, x], triangles[:, corner, y]) for corner in range(3))
    return np.asarray((bx - ax) * (cy - ay) - (by - ay) * (cx - ax))


class ContouredLayers(Struct, frozen=True, eq=False):
    """The contoured layers of a plan, in groups in which the same facets are contoured.

    Attributes:
        plan: the layers.
        rule: of contouring.
        groups: layers (n,) of each group, ascending, and the facets that are contoured there.
        only_followed: (L,) whether extrusions follow all facets in the layer that are not vertical.
    """

    plan: LayerPlan
    rule: ContourRule
    groups: tuple[tuple[Int, ShallowFacets], ...]
    only_followed: Bool

    @classmethod
    def of_triangles(cls, triangles: Float, plan: LayerPlan, rule: ContourRule) -> ContouredLayers:
        """Find the facets (F, 3, 3) that are contoured in the layers of a plan; never in the first layer."""
        slope = rule.find_max_slopes(plan.height)
        facets = ShallowFacets.of_triangles(triangles, float(slope.max()))
        above = (plan.bottom > _ROUNDING) & rule.find_contoured(plan.top)
        steepest = distinct(slope[above]).tolist() if len(facets.slope) else []
        if not steepest:
            return cls(plan, rule, (), np.zeros(plan.n_layers, np.bool_))
        groups = ((np.flatnonzero(above & (slope == one)), facets.take_up_to(one)) for one in steepest)
        low, high = triangles[:, :, 2].min(axis=1), triangles[:, :, 2].max(axis=1)
        found = _find_largest(low, high, measure_slopes(triangles), plan.bottom, plan.top)
        only_followed = above & ~rule.find_partly_level(plan.top) & (found <= slope + _ROUNDING)
        return cls(plan, rule, tuple(groups), only_followed)

    def bound_deviations(self) -> Float:
        """Return the deviation bounds (L,) of the contoured parts of layers, mm; 0 where nothing is contoured."""
        result = np.zeros(self.plan.n_layers)
        for layers, facets in self.groups:
            shadow, bottom, top = facets.shadow, self.plan.bottom[layers], self.plan.top[layers]
            deviation = self.rule.bound_deviations(facets.slope)
            result[layers] = _find_largest(shadow.low, shadow.high, deviation, bottom, top)
        return result

    def compute_volume_changes(self) -> Float:
        """Return by how much contouring changes the volume errors (L,) of layers, mm³."""
        result = np.zeros(self.plan.n_layers)
        bottom, cut, top = self.plan.bottom, self.plan.cut, self.plan.top
        for layers, facets in self.groups:
            result[layers] = _sum_volume_changes(facets, self.rule, bottom[layers], cut[layers], top[layers])
        return result

    def find_steepest_facet(self, layer: int) -> int:
        """Return the index of the steepest of the facets that are contoured in a layer."""
        (facets,) = (facets for layers, facets in self.groups if layer in layers)
        reaches = facets.shadow.high > self.plan.bottom[layer] + _ROUNDING
        reaches &= facets.shadow.low < self.plan.top[layer] - _ROUNDING
        return int(facets.facet[reaches][-1])


def _find_largest(low: Float, high: Float, value: Float, bottom: Float, top: Float) -> Float:
    """Return the largest value (n,) of the facets that reach into each layer; 0 where there are none.

    Args:
        low: (m,) of the facets, mm.
        high: (m,) mm.
        value: (m,) at least 0.
        bottom: (n,) of the layers, mm, ascending.
        top: (n,) mm, ascending.
    """
    first = np.searchsorted(top, low + _ROUNDING, side="right")
    last = np.searchsorted(bottom, high - _ROUNDING, side="left") - 1
    some = first <= last
    return compute_range_maxima(first[some], last[some], value[some], len(top))


def _sum_volume_changes(
    facets: ShallowFacets, rule: ContourRule, bottom: Float, cut: Float, top: Float
) -> Float:
    """Return by how much contouring changes the volume errors (n,) of layers, mm³.

    Args:
        facets: those that are contoured in these layers.
        rule: of contouring.
        bottom: (n,) of the layers, mm, ascending.
        cut: (n,) heights of their sections, mm.
        top: (n,) mm.
    """
    least = np.minimum(rule.min_height, top - bottom)
    planes = np.stack([bottom, bottom + least / 2, bottom + least, cut, top])
    order = np.argsort(planes, axis=None, kind="stable")
    volume, sloping = np.zeros(planes.shape), np.zeros(planes.shape)
    volume.flat[order] = facets.shadow.area_integral(planes.flat[order])
    sloping.flat[order] = facets.weigh_by_slope().area_below(planes.flat[order])
    _, half, whole, middle, end = volume
    stairs = rule.width / 4 * (sloping[4] - sloping[1])
    return np.asarray(whole - 2 * half - end + 2 * middle + stairs)
