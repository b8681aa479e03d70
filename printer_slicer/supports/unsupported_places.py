"""Compare overhangs with the beads of supports, and list the unsupported places."""

from __future__ import annotations

from typing import Final

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, consecutive, distinct, unique_inverse
from printer_slicer.geometry import Areas, depths, hatch, split_connected
from printer_slicer.geometry.boxes import Boxes
from printer_slicer.geometry.connectivity import label_components
from printer_slicer.geometry.raster import CellGrid, clearance
from printer_slicer.geometry.segment_index import distance_to_segments
from printer_slicer.geometry.vectors import norm
from printer_slicer.model import Overhangs, Sections, Toolpaths, UnsupportedPlace
from printer_slicer.profile import Profile
from printer_slicer.supports.bead_samples import sample_beads
from printer_slicer.values import Struct, replace

__all__ = [
    "UnsupportedPoints",
    "UnsupportedReasons",
    "explain_no_way",
    "find_unsupported_groups",
    "leave_out_bed",
    "list_unsupported_places",
]

_REACH_ASIDE: Final = 1.5  # mm from the middle of a bead up to which it carries overhangs
_REACH_DOWN: Final = 0.55  # mm below the gap and its slack, the same downwards: sides of branches carry, too
_REACH_AT_ISLAND: Final = 1.0  # mm, the same for the lowest point of an island
_NEAR_BED: Final = 0.3  # mm above the bed, from where overhangs bend too far before they lie on it
_CELL: Final = 0.5  # mm; side of the cells, and distance between points of overhangs
_DIAGONAL: Final = 1.0  # radians, direction of the rows of points; rows along a side would miss narrow strips
_MIN_AREA: Final = 0.5  # mm²; smaller places are rounding
_FINE_MARGIN: Final = 1.0  # mm around coarse points without support, where areas are measured
_FINE_SPACING: Final = 0.15  # mm, the same for measuring areas
_MAX_POINTS: Final = 300  # of a place, whose distances are measured
_NEAR: Final = 3.0  # mm from a place to one for which a reason is known
_MAX_DISTANCE: Final = 50.0  # mm; larger distances are not told apart
_ROUNDING: Final = 1e-6  # mm
_NOTHING_BELOW: Final = "nothing below carries its support"
_NO_WAY: Final = "no support reaches this place without touching the part"
_NO_WAY_FROM_BED: Final = "no support reaches this place from the bed without touching the part"


def explain_no_way(*, on_bed_only: bool) -> str:
    """Return the reason for places that supports cannot reach, in words for supports that may only stand on the bed."""
    return _NO_WAY_FROM_BED if on_bed_only else _NO_WAY


class UnsupportedReasons(Struct, frozen=True, eq=False):
    """The reasons why places get no support.

    Attributes:
        places: places for which the style found no support.
        removed: (n, 3) places of beads that were removed because nothing was below them, mm.
        otherwise: the reason for all other places.
    """

    places: tuple[UnsupportedPlace, ...]
    removed: Float
    otherwise: str = _NO_WAY

    def choose(self, points: Float, z: float) -> str:
        """Return the reason for the place with these points (n, 2), mm, at the height z."""
        known = np.array([(one.x, one.y, one.z) for one in self.places]).reshape(-1, 3)
        for places, reasons in (
            (known, [one.reason for one in self.places]),
            (self.removed, [_NOTHING_BELOW] * len(self.removed)),
        ):
            near = np.flatnonzero(np.abs(places[:, 2] - z) <= _NEAR)
            if not len(near) or not len(points):
                continue
            away = _measure_to_sample(places[near, :2], points)
            if away.min() <= _NEAR:
                return reasons[int(near[np.argmin(away)])]
        return self.otherwise


class _Beads(Struct, frozen=True, eq=False):
    """Beads by the layers of the part below which they may carry something.

    Attributes:
        paths: all beads.
        first, last: (L,) range of paths that carry overhangs in each layer of the part.
    """

    paths: Toolpaths
    first: Int
    last: Int

    @classmethod
    def of(cls, paths: Toolpaths, overhangs: Overhangs, profile: Profile) -> _Beads:
        """Find the beads; their tops may be lower than the overhangs by the gap, its slack and two layers."""
        quality, layers = profile.quality, paths.plan
        reach = quality.support_gap + quality.support_gap_slack + _REACH_DOWN
        bottom = overhangs.plan.bottom
        low = np.searchsorted(layers.top, bottom - reach - _ROUNDING)
        high = np.searchsorted(layers.top, bottom + _ROUNDING, side="right")
        first, last = (np.searchsorted(paths.layer, at) for at in (low, np.maximum(high, low)))
        return cls(paths, first, last)

    def find_lines(self, layer: Int) -> tuple[Float, Float, Int]:
        """Return both ends (n, 2) of the beads below layers (k,) of the part, mm, and the index (n,) of the layer."""
        path = consecutive(self.first[layer], self.last[layer] - self.first[layer])
        entry = np.repeat(np.arange(len(layer)), self.last[layer] - self.first[layer])
        count = self.paths.beads_of_each
        bead = consecutive((np.cumsum(count) - count)[path], count[path])
        begin, end = self.paths.ends_of_beads
        return self.paths.xy[begin[bead]], self.paths.xy[end[bead]], np.repeat(entry, count[path])

    def are_near(self, points: Float, layer: Int, reach: float) -> Bool:
        """Return which points (n, 2) of layers (n,) of the part, ascending, have a bead below within `reach` mm."""
        which, entry = unique_inverse(layer)
        begin, end, own = self.find_lines(which)
        boxes = Boxes(np.minimum(begin, end), np.maximum(begin, end), own)
        point, line = Boxes(points - reach, points + reach, entry).find_overlapping(boxes)
        result = np.zeros(len(points), np.bool_)
        result[point[distance_to_segments(points[point], begin[line], end[line]) <= reach]] = True
        return result

    def measure_distances(self, points: Float, layer: int) -> Float:
        """Return the distance (n,) of points to the nearest bead below a layer of the part, mm; inf without beads."""
        begin, end, _ = self.find_lines(np.array([layer]))
        if not len(begin):
            return np.full(len(points), np.inf)
        return np.array([distance_to_segments(point, begin, end).min() for point in points])


class UnsupportedPoints(Struct, frozen=True, eq=False):
    """Points of overhangs without a bead near them.

    Attributes:
        xy: (n, 2) mm.
        layer: (n,) layer of the part.
        area: (n,) area for which the point stands, mm².
        island: (n,) whether it belongs to the lowest piece of a body; such points count no area of their own.
    """

    xy: Float
    layer: Int
    area: Float
    island: Bool

    def take(self, which: Int) -> UnsupportedPoints:
        """Return the points with these indices (k,)."""
        return UnsupportedPoints(self.xy[which], self.layer[which], self.area[which], self.island[which])


def list_unsupported_places(
    overhangs: Overhangs, paths: Toolpaths, sections: Sections, profile: Profile, reasons: UnsupportedReasons
) -> tuple[UnsupportedPlace, ...]:
    """List the overhangs that have no bead of supports within 1.5 mm sideways right below it, islands first.

    Places that reach no farther from the part below or from a support than an extrusion is wide are left out.

    Args:
        overhangs: areas that need supports.
        paths: the beads of supports, on their layers.
        sections: the part.
        profile: gaps of supports, and the extrusion width.
        reasons: why supports are missing.
    """
    overhangs = leave_out_bed(overhangs, profile)
    beads = _Beads.of(paths, overhangs, profile)
    points = _join(_find_unsupported_points(overhangs, beads), _find_unsupported_islands(overhangs, beads))
    found = [_describe(one, overhangs, beads, sections, reasons) for one in _split_into_groups(points)]
    width = profile.extrusion_width
    listed = [
        place
        for place in found
        if place.is_island or (place.area >= _MIN_AREA and place.free_distance > width)
    ]
    return tuple(sorted(listed, key=lambda place: (not place.is_island, -place.area, place.z)))


def find_unsupported_groups(
    overhangs: Overhangs, paths: Toolpaths, profile: Profile, *, with_islands: bool = False
) -> list[UnsupportedPoints]:
    """Return the points of each place that `list_unsupported_places` lists, also of small places; islands if asked."""
    overhangs = leave_out_bed(overhangs, profile)
    beads = _Beads.of(paths, overhangs, profile)
    points = _find_unsupported_points(overhangs, beads)
    return _split_into_groups(
        _join(points, _find_unsupported_islands(overhangs, beads)) if with_islands else points
    )


def _split_into_groups(points: UnsupportedPoints) -> list[UnsupportedPoints]:
    """Return the points of each place."""
    group = _group_points(points)
    order = np.argsort(group, kind="stable")
    parts = np.split(order, np.flatnonzero(np.diff(group[order])) + 1)
    return [points.take(which) for which in parts if len(which)]


def leave_out_bed(overhangs: Overhangs, profile: Profile) -> Overhangs:
    """Return the overhangs without those that the bed carries: less than 0.3 mm and at most the gap above it."""
    quality = profile.quality
    near = min(quality.support_gap + quality.support_gap_slack + _ROUNDING, _NEAR_BED - _ROUNDING)
    layers = overhangs.plan.bottom <= near
    if not layers[overhangs.area.ring_layer].any():
        return overhangs
    kept = ~layers
    return replace(
        overhangs,
        area=overhangs.area.of_layers(kept),
        ring_patch=overhangs.ring_patch[kept[overhangs.area.ring_layer]],
        islands=overhangs.islands.of_layers(kept),
    )


def _find_unsupported_points(overhangs: Overhangs, beads: _Beads) -> UnsupportedPoints:
    """Return the unsupported points; a coarse search first finds the patches that have any."""
    hanging = overhangs.area
    points, layer, _ = _sample_areas(hanging, _CELL)
    found = np.flatnonzero(_find_candidates(beads, points, layer))
    near = np.zeros(overhangs.plan.n_layers + 2, np.bool_)
    for rise in range(3):  # the layers above and below may have narrow strips between the coarse points
        near[layer[found] + rise] = True
    near = near[1:-1]
    patches = np.zeros(overhangs.n_patches, np.bool_)
    patches[overhangs.ring_patch[near[hanging.ring_layer]]] = True
    fine, layer, area = _sample_areas(
        hanging.select(near[hanging.ring_layer] & patches[overhangs.ring_patch]), _FINE_SPACING
    )
    which = _select_beside(fine, points[found])
    bare = which[~beads.are_near(fine[which], layer[which], _REACH_ASIDE)]
    return UnsupportedPoints(fine[bare], layer[bare], area[bare], np.zeros(len(bare), np.bool_))


def _select_beside(points: Float, others: Float) -> Int:
    """Return which points (n, 2) lie within about 1 mm of one of the others (m, 2)."""
    if not len(points) or not len(others):
        return np.zeros(0, np.int64)
    grid = CellGrid.around(
        others.min(axis=0) - 2 * _FINE_MARGIN, others.max(axis=0) + 2 * _FINE_MARGIN, _CELL
    )
    marked = np.zeros(grid.n_cells, np.bool_)
    marked[grid.find_cells(others)] = True
    near = clearance(marked.reshape(grid.n_rows, grid.n_columns), _CELL, 2 * _FINE_MARGIN) <= _FINE_MARGIN
    # The outermost cells are too far from all others.
    return np.flatnonzero(near.reshape(-1)[grid.find_cells(points)])


def _sample_areas(areas: Areas, spacing: float) -> tuple[Float, Int, Float]:
    """Return points (n, 2) in areas, mm, the layer (n,) of each, ascending, and the area (n,) it stands for, mm²."""
    lines = hatch(areas, angle=_DIAGONAL, spacing=spacing)
    lines = lines.take(np.argsort(lines.layer, kind="stable"))
    way = lines.ends[:, 1] - lines.ends[:, 0]
    length = norm(way)
    count = np.maximum(np.ceil(length / spacing), 1).astype(np.int64)
    line = np.repeat(np.arange(len(count)), count)
    step = consecutive(np.zeros(len(count), np.int64), count) + 0.5
    share = step / count.take(line)
    points = way.take(line, axis=0)
    points *= share[:, None]
    points += lines.ends[:, 0].take(line, axis=0)
    return points, lines.layer.take(line), (length / count * spacing).take(line)


def _find_candidates(beads: _Beads, points: Float, layer: Int) -> Bool:
    """Return which points (n, 2) may have no bead near them, by a coarse raster; layers (n,) of the part ascend."""
    bare = np.ones(len(points), np.bool_)
    if not beads.paths.n_paths:
        return bare
    used = np.zeros(beads.paths.plan.n_layers, np.bool_)
    for at in distinct(layer).tolist():
        used[beads.paths.layer[beads.first[at] : beads.last[at]]] = True
    if not used[beads.paths.layer].any():
        return bare
    samples = sample_beads(beads.paths, used, _CELL, 0.9 * _CELL)
    grid, start = samples.grid, np.searchsorted(samples.path, np.arange(beads.paths.n_paths + 1))
    low = np.array([grid.x, grid.y])
    high = low + grid.cell * np.array([grid.n_columns, grid.n_rows])
    cell, inside = grid.find_cells(points), np.all((points >= low) & (points <= high), axis=1)
    for at in distinct(layer).tolist():
        own = slice(*np.searchsorted(layer, (at, at + 1)).tolist())
        covered = np.zeros(grid.n_cells, np.bool_)
        covered[samples.cells(slice(start[beads.first[at]], start[beads.last[at]]))] = True
        away = clearance(covered.reshape(grid.n_rows, grid.n_columns), _CELL, _REACH_ASIDE + _CELL)
        bare[own] = ~inside[own] | (away.reshape(-1)[cell[own]] > _REACH_ASIDE)
    return bare


def _find_unsupported_islands(overhangs: Overhangs, beads: _Beads) -> UnsupportedPoints:
    """Return the corners of islands to which no bead comes near."""
    islands = overhangs.islands
    pieces = split_connected(islands)
    areas = pieces.areas
    order = np.argsort(pieces.layer[areas.point_layer], kind="stable")
    piece = areas.point_layer[order]
    near = beads.are_near(areas.xy[order], pieces.layer[piece], _REACH_AT_ISLAND)
    carried = np.zeros(pieces.count, np.bool_)
    carried[piece[near]] = True
    left = np.flatnonzero(~carried[areas.point_layer])
    share = areas.area() / np.maximum(np.bincount(areas.point_layer, minlength=pieces.count), 1)
    of = areas.point_layer[left]
    return UnsupportedPoints(areas.xy[left], pieces.layer[of], share[of], np.ones(len(left), np.bool_))


def _join(one: UnsupportedPoints, other: UnsupportedPoints) -> UnsupportedPoints:
    """Return the points of both."""
    return UnsupportedPoints(
        *(np.concatenate([getattr(part, name) for part in (one, other)]) for name in one.__struct_fields__)
    )


def _group_points(points: UnsupportedPoints) -> Int:
    """Return the group (n,) of each point: those that are near each other, in the same or neighbouring layers."""
    if not len(points.layer):
        return np.zeros(0, np.int64)
    cells, own = np.unique(
        np.column_stack([np.floor(points.xy / _CELL), points.layer]).astype(np.int64),
        axis=0,
        return_inverse=True,
    )
    low, high = cells[:, :2] - np.float64(0.6), cells[:, :2] + np.float64(0.6)
    pairs = [
        Boxes(low, high, cells[:, 2] + rise).find_overlapping(Boxes(low, high, cells[:, 2]))
        for rise in (0, 1)
    ]
    return label_components(np.concatenate([np.stack(pair) for pair in pairs], axis=1), len(cells))[
        own.reshape(-1)
    ]


def _describe(
    points: UnsupportedPoints,
    overhangs: Overhangs,
    beads: _Beads,
    sections: Sections,
    reasons: UnsupportedReasons,
) -> UnsupportedPlace:
    """Return one group of points (n,) as a place."""
    low = int(points.layer.min())
    z, own = float(overhangs.plan.bottom[low]), points.xy[points.layer == low]
    centre = own[np.argmin(norm(own - own.mean(axis=0)))].tolist()
    # The corners of an island only count where nothing else of it is listed.
    counted = ~points.island if not points.island.all() else points.island
    some = _choose_sample(len(points.layer))
    distance = 0.0
    for layer in distinct(points.layer[some]).tolist():
        at = points.xy[some[points.layer[some] == layer]]
        away = np.minimum(beads.measure_distances(at, layer), _MAX_DISTANCE)
        # On slopes, the layer below is as bare as this one.
        distance = max(distance, float(_measure_to_part(at, z, away, sections).max()))
    x, y = centre
    return UnsupportedPlace(
        x,
        y,
        z,
        float(points.area[counted].sum()),
        reasons.choose(own, z),
        is_island=bool(points.island.any()),
        free_distance=distance,
    )


def _measure_to_sample(places: Float, points: Float) -> Float:
    """Return the distance (n,) of places (n, 2) to the nearest of up to 300 of the points (m, 2), mm."""
    away = np.full(len(places), np.inf)
    for point in points[_choose_sample(len(points))]:  # a table of all pairs would not fit into memory
        np.minimum(away, norm(places - point), out=away)
    return away


def _choose_sample(count: int) -> Int:
    """Return the indices of up to 300 of `count` points, evenly distributed."""
    return np.linspace(0, count - 1, min(count, _MAX_POINTS)).astype(np.int64)


def _measure_to_part(points: Float, z: float, away: Float, sections: Sections) -> Float:
    """Return the distance (n,) sideways of points to the part below the height z, mm, but at most `away` (n,)."""
    below = int(sections.plan.find_tops(np.array([z]))[0])
    if below >= sections.plan.n_layers:
        return away
    depth = depths(sections.solid, points, np.full(len(points), below), _MAX_DISTANCE)
    return np.asarray(np.fmin(away, np.maximum(-depth, 0.0)))
