"""How far the tops of printed extrusions are from the shallow surfaces that contoured extrusions follow."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, previous_in_ring, unique_inverse
from printer_slicer.contouring.fine_points import FinePoints, split_by_length
from printer_slicer.contouring.paths import find_paths_near
from printer_slicer.contouring.surface_heights import FacetBins, LayerPoints, is_open_above
from printer_slicer.contouring.tops import NARROW_REACH
from printer_slicer.geometry.boxes import Boxes
from printer_slicer.geometry.facet_topology import expand_counts
from printer_slicer.geometry.vectors import cross, dot, measure_distances_from_triangles, norm
from printer_slicer.model import ContourDeviations, ContourRule, Mesh, Sections, Toolpaths
from printer_slicer.roles import roles_with
from printer_slicer.values import Struct, replace

__all__ = ["TopErrors", "measure_deviations"]

_SPACING: Final = 0.2  # mm along extrusions
_MIN_GAP: Final = 1e-6  # mm below the next layer
_MIN_TURN: Final = 0.05  # radians; sharper corners have places around their outer side
_FAN: Final = 0.3  # radians between neighbouring places around a corner or an end, at most
_FARTHEST: Final = 0.25  # mm along a path from a followed surface to where it is level again, at most
_SQUARE: Final = 0.5  # mm, smallest side of the squares in which facets are searched
_NO_LENGTH: Final = 1e-12  # mm


class TopErrors(Struct, frozen=True, eq=False):
    """Upright lines between the top of an extrusion and the surface, or the bottom of the next layer.

    Attributes:
        low: (n, 3) mm, one end.
        high: (n, 3) mm, the other one.
        layer: (n,) layer of each.
        deviation: (n,) mm, an upper bound of the distance of their points from the surface; infinite if unknown.
    """

    low: Float
    high: Float
    layer: Int
    deviation: Float

    def take(self, some: Int | Bool) -> TopErrors:
        """Return some of the lines."""
        return TopErrors(self.low[some], self.high[some], self.layer[some], self.deviation[some])

    @classmethod
    def joined(cls, parts: Sequence[TopErrors]) -> TopErrors:
        """Return the lines of all parts."""
        low, high, layer, deviation = (
            np.concatenate([getattr(one, name) for one in parts])
            for name in ("low", "high", "layer", "deviation")
        )
        return cls(low, high, layer, deviation)

    def refine(self, triangles: Float, reach: float) -> TopErrors:
        """Return the same lines, compared with all triangles (F, 3, 3) that are within `reach` mm of them.

        A triangle is convex, so all points of a line are at most as far from it as the farther end of the line.
        """
        near = np.minimum(self.deviation, reach)
        line, facet = self._find_near_triangles(triangles, near)
        low, high = (
            measure_distances_from_triangles(end[line], triangles[facet]) for end in (self.low, self.high)
        )
        deviation = self.deviation.copy()
        np.minimum.at(deviation, line, np.maximum(low, high))
        return replace(self, deviation=deviation)

    def _find_near_triangles(self, triangles: Float, reach: Float) -> tuple[Int, Int]:
        """Return pairs of lines and triangles (F, 3, 3) whose boxes are at most `reach` (n,) mm apart."""
        bottom = np.minimum(self.low[:, 2], self.high[:, 2]) - reach
        top = np.maximum(self.low[:, 2], self.high[:, 2]) + reach
        used, layer = unique_inverse(self.layer)
        ranges = np.full(len(used), np.inf), np.full(len(used), -np.inf)
        np.minimum.at(ranges[0], layer, bottom)
        np.maximum.at(ranges[1], layer, top)
        low, high = _find_boxes(triangles)
        chosen = np.flatnonzero(_are_near(low[:2], high[:2], self.low[:, :2], float(reach.max(initial=0.0))))
        low, high = low[:, chosen], high[:, chosen]
        first = np.searchsorted(np.maximum.accumulate(ranges[1]), low[2])
        last = np.searchsorted(np.minimum.accumulate(ranges[0][::-1])[::-1], high[2], side="right")
        facet, place = expand_counts(np.maximum(last - first, 0))
        boxes = Boxes(low[:2, facet].T, high[:2, facet].T, first[facet] + place)
        line, found = Boxes(self.low[:, :2], self.low[:, :2], layer).expand(reach).find_overlapping(boxes)
        facet = facet[found]
        is_near = (low[2, facet] <= top[line]) & (high[2, facet] >= bottom[line])
        return line[is_near], chosen[facet[is_near]]

    def store(self, found: ContourDeviations) -> None:
        """Store the largest deviation of each layer."""
        np.maximum.at(found.deviation, self.layer, self.deviation)
        worst = np.flatnonzero(self.deviation == found.deviation[self.layer])
        found.place[self.layer[worst]] = self.high[worst]


def _find_boxes(triangles: Float) -> tuple[Float, Float]:
    """Return the lower and upper corners (3, F) of the boxes around triangles (F, 3, 3)."""
    one, two, three = np.ascontiguousarray(triangles.transpose(1, 2, 0))  # whole columns are faster
    return np.minimum(np.minimum(one, two), three), np.maximum(np.maximum(one, two), three)


def _are_near(low: Float, high: Float, points: Float, reach: float) -> Bool:
    """Return which boxes with corners (2, F) may be within `reach` mm of points (m, 2).

    Squares of a grid beside points are marked. A running sum of the marks tells which boxes reach any of these squares.
    """
    size = max(reach, _SQUARE)
    origin = points.min(axis=0) - 2 * size
    at = np.floor((points - origin) / size).astype(np.int64)
    marks = np.zeros(at.max(axis=0) + 3, np.int64)
    for x in (-1, 0, 1):
        for y in (-1, 0, 1):
            marks[at[:, 0] + x, at[:, 1] + y] = 1
    total = np.pad(marks.cumsum(axis=0).cumsum(axis=1), ((1, 0), (1, 0)))
    left, right, front, back = (
        np.clip((corner[axis] - origin[axis]) / size, 0, marks.shape[axis] - 1).astype(np.int64)
        for axis in (0, 1)
        for corner in (low, high)
    )
    right, back = right + 1, back + 1
    return np.asarray(total[right, back] - total[left, back] - total[right, front] + total[left, front] > 0)


def measure_deviations(
    paths: Toolpaths, bins: FacetBins, sections: Sections, rule: ContourRule, part: Mesh
) -> ContourDeviations:
    """Measure the distance of the tops of extrusions from the surface of the part where it is followed.

    It is the distance from the facet straight below or above, so nothing between the two is farther from the surface.
    It is measured every 0.2 mm along the centre and both sides of all extrusions of the part, and around their corners
    and ends: of lowered ones, and of those that had to stay level. Where the surface is lower than half of
    `min_height` in the layer, the layer is empty. Where the next layer lies over a lowered extrusion, the gap between
    them is measured. Gaps, and what is larger than the rule promises, are compared with all facets of the part.

    Args:
        paths: in printing order, contoured.
        bins: the surfaces.
        sections: of all printed layers.
        rule: of contouring.
        part: the mesh.
    """
    plan = paths.plan
    found = ContourDeviations(
        plan.top, np.zeros(plan.n_layers), np.zeros((plan.n_layers, 3)), np.zeros((0, 4))
    )
    chosen = np.flatnonzero(bins.tops.is_contoured[paths.layer] & roles_with(is_part=True)[paths.role])
    chosen = np.flatnonzero(find_paths_near(paths, chosen, bins))
    if not len(chosen):
        return found
    promised = rule.bound_deviations(rule.find_max_slopes(plan.height))
    larger = []
    for batch in split_by_length(paths, chosen, _SPACING):
        for errors in _list_errors(paths.take(batch), bins, sections, rule):
            is_larger = errors.deviation > promised[errors.layer]
            errors.take(~is_larger).store(found)
            larger.append(errors.take(is_larger))
    triangles = part.triangles + np.array([0.0, 0.0, bins.tops.base])
    errors = _compare_with_facets(TopErrors.joined(larger), triangles, rule)
    errors.store(found)
    errors = errors.take(errors.deviation > promised[errors.layer])
    places = np.column_stack([plan.top[errors.layer], errors.low[:, :2], errors.deviation])
    return replace(found, larger=places)


def _compare_with_facets(errors: TopErrors, triangles: Float, rule: ContourRule) -> TopErrors:
    """Return errors compared with all facets (F, 3, 3) of the part: most are near one, so these are searched first."""
    farthest = rule.width + _FARTHEST
    for reach in (rule.width / 4, farthest):
        left = np.flatnonzero(errors.deviation > reach)
        if not len(left):
            return errors
        deviation = errors.deviation.copy()
        deviation[left] = errors.take(left).refine(triangles, reach).deviation
        errors = replace(errors, deviation=deviation)
    return replace(errors, deviation=np.where(np.isinf(errors.deviation), farthest, errors.deviation))


def _list_errors(
    paths: Toolpaths, bins: FacetBins, sections: Sections, rule: ContourRule
) -> Iterator[TopErrors]:
    """Yield the errors of some paths: at their centre lines, at their borders, and of gaps over these."""
    fine = FinePoints.of(paths, _SPACING)
    layer = paths.layer[fine.owner]
    offset, following = paths.z_offset[fine.corner], paths.following[fine.corner]
    offset = offset + fine.share * (paths.z_offset[following] - offset)
    near = np.flatnonzero(bins.are_near_followed(fine.xy, layer) | (offset < 0))
    z = paths.z_top[fine.owner] + offset
    centre = bins.find_facets(_make_points(fine.xy[near], layer[near], sections))
    for owner, shift in _list_shifts(paths, fine, near):
        some = near[owner]
        place = np.column_stack([fine.xy[some] + shift, z[some]])
        yield from _compare_places(place, layer[some], centre[owner], (bins, sections, rule))


def _list_shifts(paths: Toolpaths, fine: FinePoints, some: Int) -> list[tuple[Int, Float]]:
    """List vectors from the centre line to the border of the extrusion at some (n,) of the fine points.

    They lead nowhere, to both sides, around the outer side of corners, and around the ends of open paths.

    Returns:
        Pairs of (m,) positions in `some` and (m, 2) vectors, mm.
    """
    after = fine.find_sides(paths, 0.5)
    before = after[previous_in_ring(fine.start)]
    first, last = fine.start[:-1][~paths.closed], fine.start[1:][~paths.closed] - 1
    after[last] = -before[last]
    before[first] = -after[first]
    before, after = before[some], after[some]
    before *= np.maximum(norm(after) / np.maximum(norm(before), _NO_LENGTH), 1.0)[:, None]
    turn = np.arctan2(cross(before, after), dot(before, after))
    count = np.ceil(np.abs(turn) / _FAN).astype(np.int64)
    owner, place = expand_counts(np.where(np.abs(turn) > _MIN_TURN, count, 0))
    step = turn[owner] / count[owner]
    angle = step * (place + 0.5)
    # The corners of a polygon around the disc: on a plane, the deviation is largest at one of them.
    x, y = ((-np.sign(turn[:, None]) * before)[owner] / np.cos(step / 2)[:, None]).T
    around = np.column_stack([np.cos(angle) * x - np.sin(angle) * y, np.sin(angle) * x + np.cos(angle) * y])
    each = np.arange(len(some))
    return [(each, np.zeros((len(some), 2))), (each, after), (each, -after), (owner, around)]


def _make_points(xy: Float, layer: Int, sections: Sections) -> LayerPoints:
    """Return points (n, 2) of layers (n,) over which surfaces of all slopes are asked for."""
    plan = sections.plan
    return LayerPoints(xy, layer, plan.bottom[layer], plan.top[layer], np.full(len(xy), np.inf))


def _compare_places(
    place: Float, layer: Int, centre: Int, part: tuple[FacetBins, Sections, ContourRule]
) -> Iterator[TopErrors]:
    """Yield the errors between places on extrusions and the surface, and those of gaps under the next layer.

    Args:
        place: (n, 3) mm, on the tops of extrusions.
        layer: (n,) their layers.
        centre: (n,) the facet at the centre line of the extrusion, or -1.
        part: the surfaces, the sections of all printed layers, and the rule of contouring.
    """
    bins, sections, rule = part
    points = _make_points(place[:, :2], layer, sections)
    facet = bins.find_facets(points)
    # Beside the border of the section, extrusions may be wider than the surface within the layer.
    is_beside = (facet < 0) & (bins.measure_heights(points.xy, centre) < points.bottom)
    facet = np.where(is_beside, centre, facet)
    known = np.flatnonzero((facet >= 0) | (place[:, 2] < points.top - _MIN_GAP))
    place, layer, points, facet = place[known], layer[known], points.take(known), facet[known]
    is_open = is_open_above(points, sections)
    some = np.flatnonzero(is_open & (facet >= 0))
    surface = bins.measure_heights(points.xy[some], facet[some])
    # The section ends where the surface is half of the minimum height above the bottom, or at the cut.
    is_level = bins.tops.are_level(points.xy[some], layer[some], NARROW_REACH)
    border = np.where(is_level, sections.plan.cut[layer[some]], points.bottom[some] + rule.min_height / 2)
    beyond = np.maximum(border - surface, 0.0)
    place_on_section = place[some] - beyond[:, None] * [0.0, 0.0, 1.0]
    deviation = measure_distances_from_triangles(place_on_section, bins.tops.corners[facet[some]])
    yield TopErrors(place_on_section, np.column_stack([points.xy[some], surface]), layer[some], deviation)
    gap = np.flatnonzero(~is_open & (place[:, 2] < points.top - _MIN_GAP))
    under_next = np.column_stack([points.xy[gap], points.top[gap]])
    yield TopErrors(place[gap], under_next, layer[gap], np.full(len(gap), np.inf))
