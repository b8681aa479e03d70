"""Heights of the shallow upper surfaces over points of layers.

Facets are listed in bins, the square cells of each layer that they reach. Points look up the bin in which they lie, so
that each point is compared only with the few facets there: a join of two sorted lists.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final
from weakref import WeakKeyDictionary

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, consecutive, run_starts
from printer_slicer.contouring.tops import Tops, find_flats_at_tops, find_tops
from printer_slicer.geometry import contain_points
from printer_slicer.geometry.facet_topology import expand_counts
from printer_slicer.geometry.vectors import are_in_triangles, cross
from printer_slicer.kernel import load_kernel
from printer_slicer.model import ContourRule, LayerPlan, Mesh, Sections
from printer_slicer.model.layers import SAME_TOP
from printer_slicer.values import Struct, replace

__all__ = ["FacetBins", "LayerPoints", "are_uncovered", "find_facet_bins", "is_open_above"]

_CELL: Final = 0.5  # mm
_SMALL_FACET: Final = 9  # cells of its bounding box
_PAIRS_AT_ONCE: Final = 1 << 20  # bounds the memory for pairs of points and facets
_BESIDE: Final = 1e-4  # mm; a point this far outside a facet is on it, so that none falls between two facets
_SAME_HEIGHT: Final = 0.005  # mm; a flat this near to the top of a layer is at this top
_ROUNDING: Final = 1e-6  # mm, and tangents of slopes


class LayerPoints(Struct, frozen=True, eq=False):
    """Points of layers over which surface heights are asked for.

    Attributes:
        xy: (N, 2) mm.
        layer: (N,) layer of each point.
        bottom: (N,) mm; surfaces below are not of this layer.
        top: (N,) mm; surfaces above are not of this layer.
        steepest: (N,) tangent of the steepest slope that counts.
    """

    xy: Float
    layer: Int
    bottom: Float
    top: Float
    steepest: Float

    def take(self, some: Int) -> LayerPoints:
        """Return some of the points."""
        return LayerPoints(
            self.xy[some], self.layer[some], self.bottom[some], self.top[some], self.steepest[some]
        )


class FacetBins(Struct, frozen=True, eq=False):
    """The facets in each cell of each layer.

    Attributes:
        origin: (2,) lower corner of the grid of cells, as a number of cells from the origin.
        shape: number of cells in x and in y.
        key: (B,) numbers of the bins that are not empty, ascending.
        start: (B + 1,) bin `i` has the facets `facet[start[i]:start[i + 1]]`.
        facet: (P,) indices of facets.
        followed: (B,) whether extrusions follow any of the facets.
        tops: the facets.
        plane: (T, 3) z of the plane of each facet at x = y = 0, mm, and its slopes in x and y.
        flats: bins of the level facets at the tops of layers; None without any.
        columns: (T, 13) for the kernel: `plane`, slope and corners in x and y of each facet, and three lower limits of
            twice the area of the triangle between a point on it and each of its sides, mm².
    """

    origin: Int
    shape: tuple[int, int]
    key: Int
    start: Int
    facet: Int
    followed: Bool
    tops: Tops
    plane: Float
    columns: Float
    flats: FacetBins | None = None

    @classmethod
    def from_tops(cls, tops: Tops) -> FacetBins:
        """List the facets of tops in bins."""
        cells = np.floor(tops.corners[..., :2].reshape(-1, 2) / _CELL).astype(np.int64)
        origin = cells.min(axis=0) - 1
        width, depth = (cells.max(axis=0) + 2 - origin).tolist()
        plane = _find_planes(tops.corners)
        reach, x, y = _list_cells(tops, plane)
        key = (tops.layer[reach] * depth + y - origin[1]) * width + x - origin[0]
        order = np.argsort(key, kind="stable")
        key = key[order]
        begins = np.flatnonzero(run_starts(key))
        start = np.append(begins, len(key))
        facet, followed = tops.facet[reach[order]], tops.followed[reach[order]]
        any_followed = np.logical_or.reduceat(followed, begins)
        columns = _make_columns(tops, plane)
        return cls(origin, (width, depth), key[begins], start, facet, any_followed, tops, plane, columns)

    def find_bins(self, xy: Float, layer: Int) -> Int:
        """Return the index (N,) of the bin of each point (N, 2) of layers (N,); -1 if there are no facets."""
        cell = np.floor(xy / _CELL).astype(np.int64) - self.origin
        width, depth = self.shape
        inside = ((cell >= 0) & (cell < (width, depth))).all(axis=1)
        key = (layer * depth + cell[:, 1]) * width + cell[:, 0]
        place = np.minimum(np.searchsorted(self.key, key), len(self.key) - 1)
        return np.where(inside & (self.key[place] == key), place, -1)

    def are_near_followed(self, xy: Float, layer: Int) -> Bool:
        """Return which points (N, 2) of layers (N,) are in a bin with surfaces that extrusions follow."""
        found = self.find_bins(xy, layer)
        return (found >= 0) & self.followed[found]

    def find_facets(self, points: LayerPoints) -> Int:
        """Return the index (N,) of the highest facet within the layer of each point; -1 if there is none."""
        bins = self.find_bins(points.xy, points.layer)
        if kernel := load_kernel():
            limits = np.column_stack([points.xy, points.bottom, points.top, points.steepest])
            found = kernel.highest_facets(limits, bins, self.start, self.facet, self.columns)
            return np.frombuffer(found, np.int64)
        return self._find_facets(points, bins)

    def _find_facets(self, points: LayerPoints, bins: Int) -> Int:
        """Do the same without the kernel for points in bins (N,)."""
        result = np.full(len(points.xy), -1)
        some = np.flatnonzero(bins >= 0)
        count = np.diff(self.start)[bins[some]]
        for batch in _split_by_total(count, _PAIRS_AT_ONCE):
            point, size = some[batch], count[batch]
            facet = self.facet[consecutive(self.start[bins[point]], size)]
            z = self._measure_heights(points, np.repeat(point, size), facet)
            highest = np.maximum.reduceat(z, np.cumsum(size) - size)
            found = np.flatnonzero((z == np.repeat(highest, size)) & (z > -np.inf))
            result[np.repeat(point, size)[found]] = facet[found]
        return result

    def measure_heights(self, xy: Float, facet: Int) -> Float:
        """Return the z (n,) of the planes of facets (n,) over points (n, 2), mm; -inf for facet -1."""
        z, x_slope, y_slope = (column.take(facet) for column in np.ascontiguousarray(self.plane.T))
        return np.where(facet >= 0, z + x_slope * xy[:, 0] + y_slope * xy[:, 1], -np.inf)

    def _measure_heights(self, points: LayerPoints, point: Int, facet: Int) -> Float:
        """Return the z (n,) of facets (n,) over points (n,), mm; -inf beside facets and for those that do not count."""
        xy = points.xy.take(point, axis=0)
        z = self.measure_heights(xy, facet)
        some = np.flatnonzero(
            (z >= points.bottom.take(point) - _ROUNDING) & (z <= points.top.take(point) + _ROUNDING)
        )
        facet, point = facet[some], point[some]
        counts = self.tops.slope[facet] <= points.steepest[point] + _ROUNDING
        counts &= are_in_triangles(xy[some], self.tops.corners[facet, :, :2], _BESIDE)
        result = np.full(len(z), -np.inf)
        result[some[counts]] = z[some[counts]]
        return result


_latest: WeakKeyDictionary[Mesh, tuple[LayerPlan, ContourRule, float, FacetBins | None]] = WeakKeyDictionary()


def find_facet_bins(mesh: Mesh, plan: LayerPlan, rule: ContourRule, lift: float = 0.0) -> FacetBins | None:
    """List the facets that contoured extrusions follow; None if there are none.

    Arguments are those of `find_tops`. Several stages ask for the same facets, so the latest ones of a mesh are cached.
    """
    known = _latest.get(mesh)
    if known and known[0] is plan and known[1:3] == (rule, lift):
        return known[3]
    tops = find_tops(mesh, plan, rule, lift)
    bins = FacetBins.from_tops(tops) if tops else None
    flats = find_flats_at_tops(tops) if tops else None
    if bins and flats:
        bins = replace(bins, flats=FacetBins.from_tops(flats))
    _latest[mesh] = plan, rule, lift, bins
    return bins


def is_open_above(points: LayerPoints, sections: Sections) -> Bool:
    """Return at which points (N,) nothing is printed on the layer, so that the surface there is not inside the part."""
    plan = sections.plan
    result = np.ones(len(points.xy), np.bool_)
    above = points.layer
    for _ in range(plan.n_layers):  # layers of several objects overlap; otherwise only the next one counts
        above = above + 1
        some = np.flatnonzero(above < plan.n_layers)
        some = some[plan.bottom[above[some]] < points.top[some] + SAME_TOP]
        if not len(some):
            break
        order = some[np.argsort(above[some], kind="stable")]
        result[order[contain_points(sections.solid, points.xy[order], above[order])]] = False
    return result


def are_uncovered(points: LayerPoints, bins: FacetBins, sections: Sections) -> Bool:
    """Return at which points (N,) with a surface in the layer nothing of the part is above the layer.

    Beside the section of the next layer may be a surface of another body that is too low in that layer to be filled,
    or a flat at the top of this layer.
    """
    result = is_open_above(points, sections)
    if bins.flats:
        low, high = points.top - _SAME_HEIGHT, points.top + _SAME_HEIGHT
        result &= bins.flats.find_facets(replace(points, bottom=low, top=high)) < 0
    plan, above = sections.plan, points.layer + 1
    some = np.flatnonzero(result & (above < plan.n_layers))
    low, high = points.top[some] + _BESIDE, (plan.bottom + bins.tops.rule.min_height / 2)[above[some]]
    steepest = np.full(len(some), np.inf)
    result[some[bins.find_facets(LayerPoints(points.xy[some], above[some], low, high, steepest)) >= 0]] = (
        False
    )
    return result


def _find_planes(corners: Float) -> Float:
    """Return z at x = y = 0 and the slopes in x and y (T, 3) of facets (T, 3, 3)."""
    one, other = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    area = cross(one[:, :2], other[:, :2])
    x = (one[:, 2] * other[:, 1] - other[:, 2] * one[:, 1]) / area
    y = (one[:, 0] * other[:, 2] - other[:, 0] * one[:, 2]) / area
    z = corners[:, 0, 2] - x * corners[:, 0, 0] - y * corners[:, 0, 1]
    return np.stack([z, x, y], axis=1)


def _make_columns(tops: Tops, plane: Float) -> Float:
    """Return the columns (T, 13) of facets for the kernel, see `FacetBins`."""
    flat = tops.corners[..., :2]
    side = np.roll(flat, -1, axis=1) - flat
    limits = -_BESIDE * np.hypot(side[..., 0], side[..., 1])
    return np.column_stack([plane, tops.slope, flat.reshape(-1, 6), limits])


def _list_cells(tops: Tops, plane: Float) -> tuple[Int, Int, Int]:
    """Return for each cell that a facet may cover within a layer: index of the reached layer, and the cell in x and y.

    Small facets cover the cells of their bounding box, large ones are scanned by rows.
    """
    flat = tops.corners[..., :2]
    low, high = (np.floor(one / _CELL).astype(np.int64) for one in (flat.min(axis=1), flat.max(axis=1)))
    across, rows = (high - low + 1).T
    is_small = (across * rows <= _SMALL_FACET)[tops.facet]
    small = np.flatnonzero(is_small)
    facet = tops.facet[small]
    item, place = expand_counts((across * rows)[facet])
    row, column = np.divmod(place, across[facet][item])
    scanned = _scan_facets(tops, plane, np.flatnonzero(~is_small))
    boxes = small[item], low[facet, 0][item] + column, low[facet, 1][item] + row
    reach, x, y = (np.concatenate(pair) for pair in zip(boxes, scanned, strict=True))
    return reach, x, y


def _scan_facets(tops: Tops, plane: Float, reaches: Int) -> tuple[Int, Int, Int]:
    """Return the cells of facets within their layers as `_list_cells` does, for some of the reached layers.

    Each facet is scanned by rows of cells. In each row, its part within the heights of the layer lies within the range
    of its sides and of its slope.
    """
    facet, layer = tops.facet[reaches], tops.layer[reaches]
    bottom, top = tops.plan.bottom[layer] - _ROUNDING, tops.plan.top[layer] + _ROUNDING
    corners = tops.corners[facet]
    low, high = corners[..., :2].min(axis=1), corners[..., :2].max(axis=1)
    z, x_slope, y_slope = plane[facet].T
    y_range = _clip_to_heights(
        (z, y_slope, x_slope), (bottom, top), (low[:, 0], high[:, 0]), (low[:, 1], high[:, 1])
    )
    first, last = (np.floor(one / _CELL).astype(np.int64) for one in y_range)
    reach, place = expand_counts(np.maximum(last - first + 1, 0))
    row = first[reach] + place
    band = np.asarray(row * _CELL), np.asarray((row + 1) * _CELL)
    x_range = _find_ranges_of_rows(corners[reach, :, :2], band)
    x_range = _clip_to_heights(
        (z[reach], x_slope[reach], y_slope[reach]), (bottom[reach], top[reach]), band, x_range
    )
    first, last = (np.floor(one / _CELL).astype(np.int64) for one in x_range)
    item, place = expand_counts(np.maximum(last - first + 1, 0))
    return reaches[reach[item]], first[item] + place, row[item]


def _clip_to_heights(
    plane: tuple[Float, Float, Float],
    heights: tuple[Float, Float],
    across: tuple[Float, Float],
    along: tuple[Float, Float],
) -> tuple[Float, Float]:
    """Return the part of a range along one axis in which planes lie between two heights.

    Args:
        plane: z at the origin (n,), slope along the axis (n,), slope along the other axis (n,).
        heights: lower and upper (n,), mm.
        across: range (n,) along the other axis, mm.
        along: range (n,) along the axis, mm.
    """
    z, slope, other = plane
    sides = z + other * across[0], z + other * across[1]
    low, high = np.minimum(*sides), np.maximum(*sides)
    is_level = np.abs(slope) < _ROUNDING
    safe = np.where(is_level, 1.0, slope)
    one, two = (heights[0] - high) / safe, (heights[1] - low) / safe
    begin = np.where(is_level, along[0], np.maximum(along[0], np.minimum(one, two) - _BESIDE))
    end = np.where(is_level, along[1], np.minimum(along[1], np.maximum(one, two) + _BESIDE))
    return begin, end


def _find_ranges_of_rows(corners: Float, band: tuple[Float, Float]) -> tuple[Float, Float]:
    """Return the range in x (n,) of triangles (n, 3, 2) within bands of y (n,); inverted if there is nothing."""
    begin, end = corners, np.roll(corners, -1, axis=1)
    delta = end - begin
    is_level = delta[..., 1] == 0
    safe = np.where(is_level, 1.0, delta[..., 1])
    xs = []
    for border in band:
        share = np.where(is_level, 0.0, (border[:, None] - begin[..., 1]) / safe)
        xs.append(begin[..., 0] + np.clip(share, 0, 1) * delta[..., 0])
    low = np.where(is_level, end[..., 0], xs[1])
    inside = (np.minimum(begin[..., 1], end[..., 1]) <= band[1][:, None]) & (
        np.maximum(begin[..., 1], end[..., 1]) >= band[0][:, None]
    )
    least = np.where(inside, np.minimum(xs[0], low), np.inf).min(axis=1)
    most = np.where(inside, np.maximum(xs[0], low), -np.inf).max(axis=1)
    return np.where(least <= most, least, 0.0), np.where(least <= most, most, -2.0 * _CELL)


def _split_by_total(count: Int, most: int) -> Iterator[slice]:
    """Yield slices of items whose counts add up to at most `most`, or that have a single item."""
    total = np.cumsum(count)
    first = 0
    while first < len(count):
        done = int(total[first - 1]) if first else 0
        last = max(int(np.searchsorted(total, done + most, side="right")), first + 1)
        yield slice(first, last)
        first = last
