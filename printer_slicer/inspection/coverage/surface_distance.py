"""Measure how far contoured extrusions are from the surface that they should follow."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, consecutive, frozen_array
from printer_slicer.geometry.vectors import are_in_triangles
from printer_slicer.healing.nesting import compute_winding_numbers
from printer_slicer.inspection.coverage.contoured_sections import find_least_height
from printer_slicer.inspection.coverage.extrusions import Extrusions, Purpose
from printer_slicer.inspection.coverage.stack import Stack
from printer_slicer.inspection.coverage.zones import path_numbers
from printer_slicer.model import Mesh
from printer_slicer.values import Struct, force_setattr, replace

__all__ = ["SurfaceErrors", "find_surface", "measure_surface_errors"]

_ROUNDING: Final = 1e-9  # mm
_ABOVE: Final = 1e-4  # mm over a surface; there, a point is inside only if another body covers the surface
_CELL: Final = 1.0  # mm, cells in which facets and points are joined
_MAX_PAIRS: Final = 1 << 20  # bounds the memory
_PIECE: Final = 0.5  # mm
_TOLERANCE: Final = 0.04  # mm above and below the surface: steps of z, and points on the paths
_UNCERTAIN_GRADIENT: Final = (
    0.8  # layer heights per width; steeper slopes may be contoured partly or not at all
)
_STEEP_GRADIENT: Final = 0.65  # mm per mm; other slicers lower walls on steeper slopes by half their width
_MAX_RAISE: Final = 0.2  # mm above its layer at which a surface is searched for
_MAX_WALL_DEPTH: Final = 1.0  # mm below a steep surface
_FACING_UP: Final = (
    Purpose.EXTERNAL_PERIMETER,
    Purpose.PERIMETER,
    Purpose.SOLID_INFILL,
    Purpose.TOP_SOLID_INFILL,
    Purpose.UNKNOWN,
)


class SurfaceErrors(Struct, frozen=True, eq=False):
    """Distances of extrusions from the surface in contoured layers, mm.

    Attributes:
        length: (L,) longest piece of a path that is too high or too low.
        most: (L,) largest distance in this piece, positive above the surface; 0 without one.
        place: (L, 2) position of the largest distance; nan without one.
    """

    length: Float
    most: Float
    place: Float

    def __post_init__(self) -> None:
        n = len(self.length)
        for name, shape in (("length", (n,)), ("most", (n,)), ("place", (n, 2))):
            force_setattr(self, name, frozen_array(getattr(self, name), np.float64, shape))


def measure_surface_errors(parts: Sequence[Mesh], stack: Stack, of_part: Bool) -> SurfaceErrors:
    """Measure how far the tops of extrusions are from the surface, in layers with contoured extrusions.

    A contoured extrusion should be as high as the surface in its layer, but not lower than the least height. A level
    one may be higher than the surface by half its layer, as on any slope.

    Args:
        parts: at their position; those of the groups of the stack.
        stack: layers of the file.
        of_part: (B,) mask of the extrusions of the part.
    """
    n, beads = stack.n_layers, stack.beads
    length, most, place = np.zeros(n), np.zeros(n), np.full((n, 2), np.nan)
    contoured = np.zeros(n, np.bool_)
    contoured[stack.layer[of_part & beads.is_contoured]] = True
    chosen = np.flatnonzero(of_part & np.isin(beads.purpose, _FACING_UP) & (stack.layer >= 0))
    chosen = chosen[contoured[stack.layer[chosen]]]
    if not len(chosen):
        return SurfaceErrors(length, most, place)
    some, source = _split_extrusions(beads.take(chosen))
    layer = stack.layer[chosen[source]]
    error = _measure_errors(parts, stack, some, layer)
    run = _number_runs(some, layer, np.sign(error))
    total = np.bincount(run, some.length * (error != 0))
    # The largest distance in the longest run of a layer comes last.
    order = np.lexsort((np.abs(error), run, total[run]))
    order = order[error[order] != 0]
    length[layer[order]], most[layer[order]] = total[run[order]], error[order]
    place[layer[order]] = (some.begin[order] + some.end[order]) / 2
    return SurfaceErrors(length, most, place)


def _split_extrusions(beads: Extrusions) -> tuple[Extrusions, Int]:
    """Split extrusions into pieces up to 0.5 mm long; return them and the extrusion of each."""
    count = np.maximum(np.ceil(beads.length / _PIECE), 1).astype(np.int64)
    source = np.repeat(np.arange(beads.n_beads), count)
    place = consecutive(np.zeros(beads.n_beads, np.int64), count)
    low, high = place / count[source], (place + 1) / count[source]
    parts, way = beads.take(source), (beads.end - beads.begin)[source]
    parts = replace(
        parts,
        begin=parts.begin + low[:, None] * way,
        end=parts.begin + high[:, None] * way,
        z_top=parts.z_top - (1 - high) * parts.rise,
        rise=parts.rise / count[source],
    )
    return parts, source


def _measure_errors(parts: Sequence[Mesh], stack: Stack, beads: Extrusions, layer: Int) -> Float:
    """Return how far (B,) each extrusion is above the highest allowed top, or below the lowest (negative), mm."""
    surface, gradient = _find_surfaces(parts, stack, beads, layer)
    error = _compare_heights(stack, beads, layer, surface, gradient)
    hidden = _find_hidden_surfaces(
        parts, stack.group[layer], (beads.begin + beads.end) / 2, surface, error > 0
    )
    if not len(hidden):
        return error
    surface[hidden], gradient[hidden] = np.nan, np.nan
    return _compare_heights(stack, beads, layer, surface, gradient)


def _find_surfaces(parts: Sequence[Mesh], stack: Stack, beads: Extrusions, layer: Int) -> tuple[Float, Float]:
    """Return height (B,), mm, and gradient (B,) of the surface at each extrusion; nan where there is none."""
    top, bottom = stack.top[layer], stack.bottom[layer]
    middle, group = (beads.begin + beads.end) / 2, stack.group[layer]
    surface, gradient = np.full(len(layer), np.nan), np.full(len(layer), np.nan)
    for one in np.unique(group).tolist():
        own = np.flatnonzero(group == one)
        span = bottom[own] - _TOLERANCE, top[own] + _MAX_RAISE
        surface[own], gradient[own] = find_surface(parts[one], middle[own], *span)
        # Other slicers lower walls below a steep surface.
        lowered = beads.is_contoured[own] & (beads.purpose[own] == Purpose.EXTERNAL_PERIMETER)
        above = own[lowered & np.isnan(surface[own])]
        gradient[above] = find_surface(parts[one], middle[above], top[above], top[above] + _MAX_WALL_DEPTH)[1]
    return surface, gradient


def _find_hidden_surfaces(
    parts: Sequence[Mesh], group: Int, points: Float, surface: Float, chosen: Bool
) -> Int:
    """Return those of the points `chosen` (B,) whose surface lies inside the part, because bodies overlap.

    Args:
        parts: one for each group.
        group: (B,) of each point.
        points: (B, 2) mm.
        surface: (B,) its height, mm; nan where there is none.
        chosen: (B,) which points to look at.
    """
    found = []
    some = np.flatnonzero(chosen & ~np.isnan(surface))
    for one in np.unique(group[some]).tolist():
        own = some[group[some] == one]
        places = np.column_stack([points[own], surface[own] + _ABOVE])
        triangles = parts[one].triangles
        inside = compute_winding_numbers(triangles, np.zeros(len(triangles), np.int64), places)[0]
        found.append(own[inside])
    return np.concatenate(found) if found else some


def _compare_heights(stack: Stack, beads: Extrusions, layer: Int, surface: Float, gradient: Float) -> Float:
    """Return the errors (B,) of `_measure_errors` for surfaces (B,) with gradients (B,); nan where there is none."""
    top, bottom = stack.top[layer], stack.bottom[layer]
    height, known = top - bottom, ~np.isnan(surface)
    surface, gradient = np.where(known, surface, top), np.nan_to_num(gradient)
    nearest = np.maximum(surface, bottom + find_least_height(stack))
    may_be_level = ~beads.is_contoured | (gradient * beads.width > _UNCERTAIN_GRADIENT * height)
    high = np.where(may_be_level, np.maximum(nearest, surface + height / 2), nearest)
    high = np.maximum(high, np.where(surface > top - _TOLERANCE, top, high))
    low = np.minimum(nearest, top) - np.where(gradient > _STEEP_GRADIENT, beads.width / 2, 0.0)
    z, lowest = beads.middle_z, bottom + _TOLERANCE / 4
    above = np.where(z > high + _TOLERANCE, z - high, 0.0)
    below = np.where((z < low - _TOLERANCE) | (z < lowest), np.minimum(z - low, z - lowest), 0.0)
    return np.where(above > 0, above, below)


def _number_runs(beads: Extrusions, layer: Int, sign: Float) -> Int:
    """Return the run (B,) of each extrusion: consecutive ones of a path that are all too high, too low or right."""
    new = (np.diff(path_numbers(beads, layer)) != 0) | (np.diff(sign) != 0)
    return np.append(0, np.cumsum(new))


def find_surface(part: Mesh, points: Float, low: Float, high: Float) -> tuple[Float, Float]:
    """Find the highest surface of a part that faces up, above points and between two heights.

    Args:
        part: the part.
        points: (P, 2) mm.
        low: (P,) mm, lowest height.
        high: (P,) mm, highest height.

    Returns:
        Height (P,), mm, and gradient (P,), mm per mm, of the surface; nan without one.
    """
    triangles = part.triangles
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    z = triangles[:, :, 2]
    inside = (z.max(axis=1) >= low.min(initial=np.inf)) & (z.min(axis=1) <= high.max(initial=-np.inf))
    facets = np.flatnonzero((normal[:, 2] > 0) & inside)
    height, gradient = np.full(len(points), -np.inf), np.full(len(points), np.nan)
    slope = -normal[facets, :2] / normal[facets, 2:]
    for point, facet in _pair_by_cell(points, triangles[facets, :, :2]):
        corners = triangles[facets[facet]]
        at = points[point]
        z = corners[:, 0, 2] + (slope[facet] * (at - corners[:, 0, :2])).sum(axis=1)
        found = are_in_triangles(at, corners[:, :, :2], _ROUNDING) & (z >= low[point]) & (z <= high[point])
        order = np.argsort(z[found], kind="stable")
        which, index = point[found][order], facet[found][order]
        z = z[found][order]
        higher = z > height[which]
        height[which[higher]] = z[higher]  # ascending, so the highest remains
        gradient[which[higher]] = np.hypot(*slope[index[higher]].T)
    return np.where(np.isfinite(height), height, np.nan), gradient


def _pair_by_cell(points: Float, triangles: Float) -> Iterator[tuple[Int, Int]]:
    """Yield pairs of a point (P, 2) and a triangle (F, 3, 2) that share a cell, as indices, with bounded memory."""
    if not (len(points) and len(triangles)):
        return
    origin = points.min(axis=0)
    size = np.floor((points.max(axis=0) - origin) / _CELL).astype(np.int64) + 1
    low = np.floor((triangles.min(axis=1) - origin) / _CELL).astype(np.int64)
    high = np.floor((triangles.max(axis=1) - origin) / _CELL).astype(np.int64)
    low, high = np.maximum(low, 0), np.minimum(high, size - 1)
    span = np.maximum(high - low + 1, 0)
    count = span.prod(axis=1)
    owner = np.repeat(np.arange(len(triangles)), count)
    place = consecutive(np.zeros(len(triangles), np.int64), count)
    column = low[owner, 0] + place % np.maximum(span[owner, 0], 1)
    row = low[owner, 1] + place // np.maximum(span[owner, 0], 1)
    cell = row * size[0] + column
    order = np.argsort(cell, kind="stable")
    cell, owner = cell[order], owner[order]
    own = np.floor((points - origin) / _CELL).astype(np.int64)
    key = own[:, 1] * size[0] + own[:, 0]
    first, last = np.searchsorted(cell, key), np.searchsorted(cell, key, side="right")
    block = np.cumsum(last - first) // _MAX_PAIRS
    for one in np.unique(block).tolist():
        some = np.flatnonzero(block == one)
        pairs = last[some] - first[some]
        yield np.repeat(some, pairs), owner[consecutive(first[some], pairs)]
