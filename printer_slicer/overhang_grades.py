"""Grade overhangs: compute how much of the width of each perimeter rests on the layer below.

If the centre line runs at depth d inside the section of the layer below, the fraction 1/2 + d / width is supported. The
sections themselves are compared, so the result is exact for any layer height.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, bounding_boxes, distinct, run_starts
from printer_slicer.geometry import (
    Areas,
    depths,
    difference,
    find_enclosing_rings,
    offset,
    window_intersection,
)
from printer_slicer.geometry.depth import mark_near_outlines
from printer_slicer.geometry.facet_topology import expand_counts
from printer_slicer.model import Sections, Toolpaths
from printer_slicer.values import Struct

__all__ = ["grade_overhangs"]

# Fraction of the width that counts as fully supported. It is below 1, because simplified contours of a wall vary a bit.
_SUPPORTED = 0.9
_GRADES = (0.02, 0.25, 0.5, 0.75, _SUPPORTED)
_STEP = 1.0  # extrusion widths between tested positions
_SHORTEST = 0.5  # extrusion widths; shorter runs of one grade are merged
_AT_ONCE = 1 << 16  # pieces that are tested at once
_REACH = 1.05  # extrusion widths from an outline within which depths are computed; more than a step


def grade_overhangs(paths: Toolpaths, sections: Sections) -> Toolpaths:
    """Return the perimeters with their `support_ratio`, and with additional points where its grade changes.

    The grades start at 90, 75, 50, 25 and 2 % of the width. Within a run of one grade `support_ratio` is the mean. Runs
    shorter than half an extrusion width are merged with the previous one.
    """
    if not paths.n_paths:
        return paths
    solid = sections.solid
    own = np.arange(solid.n_layers)
    below = window_intersection(solid, own - 1, own)
    width = float(paths.width.max())
    air = _find_overhangs(solid, below, width)
    near, shortest = _mark_near_overhangs(paths, air, width), _SHORTEST * float(paths.width.mean())
    count = _count_pieces(paths, near, _STEP * width)
    parts = []
    for first, last in pairwise(_split_into_blocks(paths, count)):
        some, points = paths.take(np.arange(first, last)), slice(*paths.start[[first, last]])
        pieces = _cut_segments(some, near[points], count[points])
        parts.append(
            _join_pieces(some, pieces, _compute_support_ratios(some, pieces, (below, air), width), shortest)
        )
    return Toolpaths.joined(paths.plan, parts)


def _find_overhangs(solid: Areas, below: Areas, width: float) -> Areas:
    """Return the parts of each section where extrusions count as unsupported."""
    air = difference(solid.select(solid.ring_layer > 0), offset(below, (1 - _SUPPORTED) * width))
    return air.select(np.abs(air.ring_area()) > 1e-3 * width**2)


class _Pieces(Struct, frozen=True, eq=False):
    """Segments of all paths, some of them cut into equal pieces.

    Attributes:
        point: (K,) first point of the segment; the last point of an open path has a piece of length 0.
        following: (K,) last point of the segment.
        step: (K,) index of the piece in its segment.
        count: (K,) number of pieces of the segment.
        path: (K,) ascending.
        open: (K,) whether to test the piece.
    """

    point: Int
    following: Int
    step: Int
    count: Int
    path: Int
    open: Bool

    def find_points(self, paths: Toolpaths, fraction: float = 0) -> Float:
        """Return the point (K, 2) of each piece at a fraction of its length, from 0 (start) to 1 (end)."""
        share = ((self.step + fraction) / self.count)[:, None]
        start = paths.xy.take(self.point, axis=0)
        return start + share * (paths.xy.take(self.following, axis=0) - start)

    def take(self, which: Int) -> _Pieces:
        """Return the pieces with the given indices (n,), ascending."""
        point, following, step, count, path = (
            column.take(which) for column in (self.point, self.following, self.step, self.count, self.path)
        )
        return _Pieces(point, following, step, count, path, self.open.take(which))


def _mark_near_overhangs(paths: Toolpaths, air: Areas, width: float) -> Bool:
    """Return a mask (N,) of points whose segment crosses the box around an overhang."""
    start, end = (np.ascontiguousarray(xy.T) for xy in (paths.xy, paths.xy.take(paths.following, axis=0)))
    low, high = np.minimum(start, end) - width, np.maximum(start, end) + width
    result = np.zeros(len(paths.xy), np.bool_)
    if not air.n_rings:
        return result
    around = bounding_boxes(air.xy, air.ring_start, np.arange(air.n_rings), air.n_rings)
    lowest, highest = (np.ascontiguousarray(corner.T) for corner in around)
    bounds = paths.start[np.searchsorted(paths.layer, np.arange(paths.plan.n_layers + 1))]
    rings = air.layer_start
    for layer in np.flatnonzero(air.used).tolist():
        here = slice(int(bounds[layer]), int(bounds[layer + 1]))
        some = slice(int(rings[layer]), int(rings[layer + 1]))
        meets = low[0, None, here] <= highest[0, some, None]
        meets &= high[0, None, here] >= lowest[0, some, None]
        meets &= low[1, None, here] <= highest[1, some, None]
        meets &= high[1, None, here] >= lowest[1, some, None]
        result[here] = meets.any(axis=0)
    return result


def _count_pieces(paths: Toolpaths, near: Bool, longest: float) -> Int:
    """Return the number of pieces (N,) into which the segment from each point is cut."""
    return np.where(near, np.maximum(np.ceil(paths.steps() / longest), 1), 1).astype(np.int64)


def _split_into_blocks(paths: Toolpaths, count: Int) -> list[int]:
    """Divide the paths into blocks of about `_AT_ONCE` pieces; return the first path of each block, and the end."""
    total = np.cumsum(np.add.reduceat(count, paths.start[:-1]))
    inner = np.searchsorted(total, np.arange(_AT_ONCE, int(total[-1]), _AT_ONCE)) + 1
    return [0, *distinct(inner[inner < paths.n_paths]).tolist(), paths.n_paths]


def _cut_segments(paths: Toolpaths, near: Bool, count: Int) -> _Pieces:
    """Cut the segment from each point into `count` (N,) pieces; `near` (N,) marks segments to test for overhangs."""
    following = paths.following
    point, step = expand_counts(count)
    path = paths.path_of_point.take(point)
    return _Pieces(point, following.take(point), step, count.take(point), path, near.take(point))


def _compute_support_ratios(
    paths: Toolpaths, pieces: _Pieces, under: tuple[Areas, Areas], width: float
) -> Float:
    """Return the support ratio of each piece (K,), computed at its two ends; no extrusion is wider than `width`."""
    result = np.ones(len(pieces.point))
    chosen = np.flatnonzero(pieces.open)
    looked_at = pieces.take(chosen)
    layer, middle = paths.layer.take(looked_at.path), looked_at.find_points(paths, 0.5)
    near = mark_near_outlines(under[1], middle, layer, (1 + _STEP / 2) * width)
    result[chosen[~near]] = _find_constant_ratios(
        pieces, chosen[~near], middle.compress(~near, axis=0), layer[~near], under[1]
    )
    chosen = chosen.compress(near)
    if not len(chosen):
        return result
    looked_at, layer = pieces.take(chosen), layer.compress(near)
    start, end = looked_at.find_points(paths), looked_at.find_points(paths, 1)
    # Most pieces start where the previous one ends; only other ends need an additional test.
    is_last = np.append(
        (end[:-1, 0] != start[1:, 0]) | (end[:-1, 1] != start[1:, 1]) | (np.diff(chosen) != 1), True
    )
    size = 1 + is_last
    place = np.cumsum(size) - size
    points = np.zeros((int(size.sum()), 2))
    points[place], points[place[is_last] + 1] = start, end[is_last]
    depth = _measure_depths(under, points, np.repeat(layer, size), _REACH * width, place[is_last] + 1)
    wide = (paths.width.take(looked_at.point) + paths.width.take(looked_at.following)) / 2
    shares = np.clip(0.5 + np.stack([depth.take(place), depth.take(place + 1)]) / wide, 0, 1)
    result[chosen] = shares.mean(axis=0)
    return result


def _find_constant_ratios(pieces: _Pieces, indices: Int, middle: Float, layer: Int, air: Areas) -> Float:
    """Return the support ratio of pieces (n,) far from the edges of overhangs: 0 inside overhangs, 1 outside.

    Args:
        pieces: all pieces.
        indices: (n,) indices of the pieces to test, ascending.
        middle: (n, 2) mm.
        layer: (n,).
        air: overhanging areas.
    """
    first = np.flatnonzero(
        (np.diff(indices, prepend=-2) != 1) | (np.diff(pieces.path.take(indices), prepend=-1) != 0)
    )
    found = find_enclosing_rings(air, middle.take(first, axis=0), layer.take(first))
    hangs = (found >= 0) & (np.append(air.ring_area(), 0)[found] > 0)
    return np.repeat(np.where(hangs, 0.0, 1.0), np.diff(first, append=len(indices)))


def _measure_depths(under: tuple[Areas, Areas], points: Float, layer: Int, reach: float, last: Int) -> Float:
    """Return the depth (P,) of points inside the section of the layer below, limited to +- `reach`, mm.

    Args:
        under: sections of the layers below, and overhanging areas of the layers themselves.
        points: (P, 2) mm, chains of points at most one step apart.
        layer: (P,) layer of each point.
        reach: largest absolute depth that is computed, mm.
        last: index of the last point of each chain.
    """
    below, air = under
    depth = depths(below, points, layer, reach)
    chain = np.zeros(len(points), np.int64)
    chain[last[:-1] + 1] = 1
    chain = np.cumsum(chain)
    # A step is shorter than the reach, so an unknown point is on the same side as its known neighbour.
    known = np.flatnonzero(~np.isnan(depth))
    for side in (-1, 0):
        unknown = np.flatnonzero(np.isnan(depth))
        nearest = np.searchsorted(known, unknown) + side
        exists = (nearest >= 0) & (nearest < len(known))
        source = known[nearest[exists]]
        same = chain[source] == chain[unknown[exists]]
        depth[unknown[exists][same]] = np.copysign(reach, depth[source[same]])
    # The remaining chains are unknown as a whole; one point of each is tested.
    unknown = np.flatnonzero(np.isnan(depth))
    is_start = run_starts(chain[unknown])
    probe, which = unknown[is_start], np.cumsum(is_start) - 1
    order = np.argsort(layer[probe], kind="stable")
    found = np.full(len(probe), -1)
    # Far from all outlines below, testing the overhanging areas is equivalent, and they have fewer outlines.
    found[order] = find_enclosing_rings(air, points[probe[order]], layer[probe[order]])
    hangs = (found >= 0) & (np.append(air.ring_area(), 0)[found] > 0)
    depth[unknown] = np.where(hangs[which], -reach, reach)
    return depth


def _join_pieces(paths: Toolpaths, pieces: _Pieces, support_ratio: Float, shortest: float) -> Toolpaths:
    """Join consecutive pieces of equal grade; return the paths with a point wherever the grade changes."""
    length = paths.steps().take(pieces.point) / pieces.count
    of_piece = np.digitize(support_ratio, _GRADES)
    grade = _merge_short_runs(of_piece, pieces.path, length, shortest)
    is_start = np.append(True, (np.diff(grade) != 0) | (np.diff(pieces.path) != 0))
    run = np.cumsum(is_start) - 1
    weight = length * (grade == of_piece)
    total = np.bincount(run, weight)
    mean = np.bincount(run, weight * support_ratio) / np.where(total > 0, total, 1.0)
    mean = np.where((grade[is_start] == len(_GRADES)) | (total == 0), 1.0, mean)
    kept = np.flatnonzero((pieces.step == 0) | is_start)
    some = pieces.take(kept)
    share = some.step / some.count
    width, following = paths.width.take(some.point), paths.width.take(some.following)
    size = np.bincount(some.path, minlength=paths.n_paths)
    return Toolpaths(
        paths.plan,
        some.find_points(paths),
        width + share * (following - width),
        np.append(0, np.cumsum(size)),
        paths.layer,
        paths.role,
        paths.height,
        paths.closed,
        mean[run[kept]],
        paths.chain_id,
    )


def _merge_short_runs(grade: Int, path: Int, length: Float, shortest: float) -> Int:
    """Return the grades (K,) with runs shorter than `shortest` merged into the previous longer one."""
    is_start = np.append(True, (np.diff(grade) != 0) | (np.diff(path) != 0))
    run = np.cumsum(is_start) - 1
    first = np.flatnonzero(is_start)
    long = np.bincount(run, length) >= shortest
    long |= run_starts(path[first])  # the first run of a path has no previous one
    source = np.maximum.accumulate(np.where(long, np.arange(len(first)), 0))
    return np.asarray(grade[first][source][run])
