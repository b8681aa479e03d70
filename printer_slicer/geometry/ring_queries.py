"""Find the rings that enclose points, and the positions where straight lines cross rings."""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, consecutive, unique_inverse
from printer_slicer.geometry.areas import Areas
from printer_slicer.geometry.boxes import Boxes

__all__ = [
    "contain_points",
    "crosses_any_edge",
    "crosses_rings",
    "crossing_shares",
    "crossings",
    "find_enclosing_rings",
]

_PAIRS_AT_ONCE = 1 << 18  # pairs of lines and edges per batch, to bound the memory


def find_enclosing_rings(outlines: Areas, points: Float, layer: Int) -> Int:
    """Find the smallest ring around each point.

    A ring contains a point if a ray from the point to the right crosses it an odd number of times. Points are sorted by
    layer and height, so that the points whose rays may cross an edge are consecutive.

    Args:
        outlines: rings that do not cross; their direction does not matter.
        points: (P, 2) mm.
        layer: (P,) layer of each point, ascending.

    Returns:
        The ring (P,) around each point, or -1.
    """
    n_rings = outlines.n_rings
    if not len(points) or not n_rings:
        return np.full(len(points), -1, np.int64)
    ring = np.repeat(np.arange(n_rings), np.diff(outlines.ring_start))
    (x, y), (px, py) = outlines.xy.T, points.T
    low = min(float(y.min()), float(py.min()))
    pitch = max(float(y.max()), float(py.max())) - low + 1.0
    key = layer * pitch + (py - low)
    order = np.argsort(key, kind="stable")
    # A corner at the height of a point counts as below it, for both of its edges.
    begins = np.searchsorted(key[order], outlines.ring_layer[ring] * pitch + (y - low))
    ends, following = begins[outlines.following], outlines.following
    first, count = np.minimum(begins, ends), np.abs(begins - ends)
    odd = []
    passing = np.flatnonzero(count)
    for edges in np.split(passing, _find_split_positions(count[passing], _PAIRS_AT_ONCE)):
        edge = np.repeat(edges, count[edges])
        point, end = order[consecutive(first[edges], count[edges])], following[edge]
        reached = x[edge] + (py[point] - y[edge]) / (y[end] - y[edge]) * (x[end] - x[edge])
        right = reached > px[point]
        odd.append(_select_odd_counts(point[right] * n_rings + ring[edge[right]]))
    point, within = np.divmod(_select_odd_counts(np.concatenate(odd)), n_rings)
    by_size = np.argsort(np.abs(outlines.ring_area()), kind="stable")
    rank, smallest = np.argsort(by_size), np.full(len(points), n_rings)
    np.minimum.at(smallest, point, rank[within])
    return np.append(by_size, -1).take(smallest)


def contain_points(areas: Areas, points: Float, layer: Int) -> Bool:
    """Return a mask (P,) of the points (P, 2) that lie in the areas of their `layer` (P,), ascending."""
    if not areas.n_rings:
        return np.zeros(len(points), np.bool_)
    ring = find_enclosing_rings(areas, points, layer)
    return np.asarray((ring >= 0) & (areas.ring_area()[ring] > 0))


def _find_split_positions(count: Int, most: int) -> Int:
    """Return the indices at which to split items with `count` (n,) entries each into parts of about `most` entries."""
    total = np.cumsum(count)
    return np.searchsorted(total, np.arange(most, int(total[-1]) if len(total) else 0, most)).astype(np.int64)


def _select_odd_counts(values: Int) -> Int:
    """Return the values that occur an odd number of times, ascending."""
    found, place = unique_inverse(values)
    return np.asarray(found[np.bincount(place, minlength=len(found)) % 2 == 1])


def crosses_rings(outlines: Areas, begin: Float, end: Float, layer: Int) -> Bool:
    """Return a mask (P,) of lines from `begin` to `end` (P, 2) that cross a ring of their `layer` (P,)."""
    return np.asarray(crossings(outlines, begin, end, layer) > 0)


def crossings(outlines: Areas, begin: Float, end: Float, layer: Int) -> Int:
    """Count how often (P,) each line from `begin` to `end` (P, 2) crosses rings of its `layer` (P,).

    An edge includes only one of its ends, so a line through a corner crosses exactly one of the corner's edges.
    """
    result = np.zeros(len(begin), np.int64)
    if not len(begin) or not outlines.n_rings:
        return result
    a, b = outlines.xy, outlines.xy.take(outlines.following, axis=0)
    boxes = Boxes(np.minimum(begin, end), np.maximum(begin, end), layer)
    line, edge = boxes.find_overlapping(Boxes.of_sides(outlines))
    for some in np.array_split(np.arange(len(line)), len(line) // _PAIRS_AT_ONCE + 1):
        one, other = line[some], edge[some]
        share = crossing_shares(
            *(of.take(one, axis=0) for of in (begin, end)), *(of.take(other, axis=0) for of in (a, b))
        )
        result += np.bincount(one[~np.isnan(share)], minlength=len(begin))
    return result


def crossing_shares(begin: Float, end: Float, a: Float, b: Float) -> Float:
    """Return the position (n,) at which each line from `begin` to `end` (n, 2) crosses its edge from `a` to `b` (n, 2).

    The position along the line goes from 0 to 1; it is nan if the two do not cross. As in `crosses_any_edge`, this is
    decided without a division.
    """
    (dx, dy), (ex, ey) = (end - begin).T, (b - a).T
    gap_x, gap_y = (a - begin).T
    side_a = dx * gap_y - dy * gap_x
    side_b = dx * (gap_y + ey) - dy * (gap_x + ex)
    along, turn = gap_y * ex - gap_x * ey, dy * ex - dx * ey
    along, turn = along * np.sign(turn), np.abs(turn)
    cross = ((side_a < 0) != (side_b < 0)) & (along > 0) & (along < turn)
    return np.where(cross, along / np.where(cross, turn, 1.0), np.nan)


def crosses_any_edge(begin: Float, end: Float, a: Float, b: Float) -> Bool:
    """Return a mask (P,) of lines from `begin` to `end` (P, 2) that cross any edge from `a` to `b` (E, 2).

    An edge includes only one of its ends, so a line through a corner crosses exactly one of the corner's edges.
    """
    line = end - begin
    side_a, side_b = _side_of_line(begin, line, a), _side_of_line(begin, line, b)
    edge = (b - a)[None]
    gap = begin[:, None] - a[None]
    along = gap[:, :, 0] * edge[:, :, 1] - gap[:, :, 1] * edge[:, :, 0]
    turn = line[:, None, 1] * edge[:, :, 0] - line[:, None, 0] * edge[:, :, 1]
    # The two intersect at along/turn of the line's length. Check that it is between 0 and 1 without dividing.
    along, turn = along * np.sign(turn), np.abs(turn)
    return np.asarray((((side_a < 0) != (side_b < 0)) & (along > 0) & (along < turn)).any(axis=1))


def _side_of_line(begin: Float, line: Float, points: Float) -> Float:
    """Return for each line and point (P, E) a number that is positive if the point lies to the left of the line."""
    gap = points[None] - begin[:, None]
    return line[:, None, 0] * gap[:, :, 1] - line[:, None, 1] * gap[:, :, 0]
