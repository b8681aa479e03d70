"""What contouring changes in the errors of candidate layers, see `surface.contoured_tops`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from printer_slicer.arrays import Float, Int, distinct
from printer_slicer.contouring import make_contour_rule
from printer_slicer.model import ContourRule
from printer_slicer.planning.height_grid import HeightGrid, HeightRow
from printer_slicer.profile import Profile
from printer_slicer.surface import Surface
from printer_slicer.surface.contoured_tops import ShallowFacets, measure_slopes
from printer_slicer.surface.range_maximum import compute_range_maxima

__all__ = ["ContouredCandidates", "list_contoured_candidates"]

_ROUNDING: Final = 1e-6  # mm, and tangents
_MAX_CLASSES: Final = 8


class ContouredCandidates:
    """Errors of candidate layers whose shallow upper surfaces are contoured.

    Which facets are contoured depends on the height of the layer. So facets are divided into classes by slope, and
    tables have a row for each number of classes, from the shallowest one. A class counts as contoured for the volume
    if all of it is, and for the deviation if any of it may be.

    Args:
        facets: that are contoured in layers of any height.
        rule: of contouring.
        grid: the grid of heights.
        slopes: (K,) steepest slope of each class, as tangents, ascending.
        triangles: (F, 3, 3) mm, all facets.
    """

    def __init__(
        self, facets: ShallowFacets, rule: ContourRule, grid: HeightGrid, slopes: Float, triangles: Float
    ) -> None:
        self._rule, self._grid, self._slopes = rule, grid, slopes
        n = grid.cells * grid.n
        classes = facets.divide(slopes)
        zero = np.zeros((1, n + 1))

        def tabulate(columns: Sequence[Float]) -> Float:
            """Return sums (K + 1, n + 1) of the first classes."""
            return np.concatenate([zero, np.cumsum(columns, axis=0)])

        self._volume = tabulate([one.shadow.area_integral_on_lattice(grid.cell, n) for one in classes])
        weighted = tabulate([one.weigh_by_slope().area_integral_on_lattice(grid.cell, n) for one in classes])
        self._sloping = np.gradient(weighted, grid.cell, axis=1)
        steepest = [self._find_steepest(one.shadow.low, one.shadow.high, one.slope) for one in classes]
        # Number of cells with such facets below each border between cells.
        self._occupied = np.append(0, np.cumsum(np.max(steepest, axis=0) > 0))
        self._steepest = [_RunMaxima(one) for one in np.maximum.accumulate(steepest, axis=0)]
        low, high = triangles[:, :, 2].min(axis=1), triangles[:, :, 2].max(axis=1)
        self._any_steepest = _RunMaxima(self._find_steepest(low, high, measure_slopes(triangles)))

    def _find_steepest(self, low: Float, high: Float, slope: Float) -> Float:
        """Return the steepest slope of facets (m,) between two heights, mm, in each cell; 0 where there is none."""
        n, cell = self._grid.cells * self._grid.n, self._grid.cell
        first = np.floor(low / cell + _ROUNDING).astype(np.int64).clip(0, n - 1)
        last = (np.ceil(high / cell - _ROUNDING).astype(np.int64) - 1).clip(first, n - 1)
        return compute_range_maxima(first, last, slope + _ROUNDING, n)

    def compute_volume_changes(self, first: Int, last: Int) -> Float:
        """Return by how much contouring changes the volume errors of layers between nodes (m,), mm³."""
        result = np.zeros(len(first))
        start, end = self._grid.cells * first, self._grid.cells * last
        some = np.flatnonzero((self._occupied.take(end) > self._occupied.take(start)) & (first > 0))
        result[some] = self._sum_volume_changes(first[some], last[some])
        return result

    def _sum_volume_changes(self, first: Int, last: Int) -> Float:
        """Return the same for layers that are not the first, and that shallow facets reach."""
        grid, rule = self._grid, self._rule
        slope = rule.find_max_slopes(np.asarray((last - first) * grid.unit, np.float64))
        row = np.searchsorted(self._slopes, slope + _ROUNDING, side="right")
        start, end = grid.cells * first, grid.cells * last
        least = np.minimum(round(rule.min_height / grid.cell), end - start)
        half = start + least // 2
        volume, sloping = self._volume, self._sloping
        changes = volume[row, start + least] - 2 * volume[row, half] - volume[row, end]
        changes += 2 * volume[row, (start + end) // 2]
        return np.asarray(changes + rule.width / 4 * (sloping[row, end] - sloping[row, half]))

    def bound_deviations(self, row: HeightRow, level: Float) -> Float:
        """Return the deviation bounds (n,) of all layers of one height from those of level layers (n,), mm."""
        (most,) = self._rule.find_max_slopes(np.array([row.height * self._grid.unit]))
        last_class = min(int(np.searchsorted(self._slopes, most - _ROUNDING)), len(self._slopes) - 1)
        end, size = self._grid.cells * row.end, self._grid.cells * row.height
        slope = np.minimum(self._steepest[last_class].find(end, size), most + _ROUNDING)
        only_followed = self._any_steepest.find(end, size) <= most + 2 * _ROUNDING
        contoured = self._rule.bound_deviations(slope)
        bound = np.where(only_followed, contoured, np.maximum(level, contoured))
        return np.where((slope > 0) & (row.end > row.height), bound, level)


class _RunMaxima:
    """The largest values of runs of cells.

    Args:
        value: (n,) of each cell.
    """

    def __init__(self, value: Float) -> None:
        self._levels = [value]  # the largest value of 2^k cells, by the first one

    def find(self, end: Int, size: int) -> Float:
        """Return the largest values (m,) of runs of `size` cells up to the borders `end` (m,)."""
        level = size.bit_length() - 1
        while len(self._levels) <= level:
            shorter, half = self._levels[-1], 1 << (len(self._levels) - 1)
            self._levels.append(np.maximum(shorter[:-half], shorter[half:]))
        value = self._levels[level]
        return np.maximum(value.take(end - size), value.take(end - (1 << level)))


def list_contoured_candidates(
    surface: Surface, grid: HeightGrid, profile: Profile, heights: Sequence[int]
) -> ContouredCandidates | None:
    """Return what contouring changes in layers of the given heights, in units; None if it changes nothing."""
    rule = make_contour_rule(profile)
    if rule is None or not heights:
        return None
    slopes = distinct(rule.find_max_slopes(np.array(heights) * grid.unit))
    slopes = slopes[distinct(np.linspace(0, len(slopes) - 1, _MAX_CLASSES).astype(np.int64))]
    facets = ShallowFacets.of_triangles(surface.triangles, float(slopes[-1]))
    if not len(facets.slope):
        return None
    return ContouredCandidates(facets, rule, grid, slopes, surface.triangles)
