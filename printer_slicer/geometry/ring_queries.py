"""Find the rings around points, and where straight lines cross rings."""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, consecutive, unique_inverse
from printer_slicer.geometry.areas import Areas
from printer_slicer.geometry.boxes import Boxes

__all__ = ["any_crossing", "crossed", "crossing_shares", "crossings", "find_enclosing_rings"]

_PAIRS_AT_ONCE = 1 << 18  # of ways and edges: what is compared stays small


def find_enclosing_rings(outlines: Areas, points: Float, layer: Int) -> Int:
    """For each point (P, 2) on its `layer` (P,) ascending the smallest ring that contains it, -1 where none does.

    A ring contains a point if a ray from there to the right crosses it an odd number of times. Points are sorted by
    layer and height: those that an edge passes stand in a row.

    Args:
        outlines: rings that do not cross; the direction does not matter.
        points: mm.
        layer: the layer each point lies on.
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
    # A corner at the height of a point lies under it, for both of its edges.
    begins = np.searchsorted(key[order], outlines.ring_layer[ring] * pitch + (y - low))
    ends, following = begins[outlines.following], outlines.following
    first, count = np.minimum(begins, ends), np.abs(begins - ends)
    odd = []
    passing = np.flatnonzero(count)
    for edges in np.split(passing, _every(count[passing], _PAIRS_AT_ONCE)):
        edge = np.repeat(edges, count[edges])
        point, end = order[consecutive(first[edges], count[edges])], following[edge]
        reached = x[edge] + (py[point] - y[edge]) / (y[end] - y[edge]) * (x[end] - x[edge])
        right = reached > px[point]
        odd.append(_odd(point[right] * n_rings + ring[edge[right]]))
    point, within = np.divmod(_odd(np.concatenate(odd)), n_rings)
    by_size = np.argsort(np.abs(outlines.ring_area()), kind="stable")
    rank, smallest = np.argsort(by_size), np.full(len(points), n_rings)
    np.minimum.at(smallest, point, rank[within])
    return np.append(by_size, -1).take(smallest)


def _every(count: Int, most: int) -> Int:
    """Where to split items that own `count` (n,) things each, so that parts own hardly more than `most`."""
    total = np.cumsum(count)
    return np.searchsorted(total, np.arange(most, int(total[-1]) if len(total) else 0, most)).astype(np.int64)


def _odd(values: Int) -> Int:
    """Those that are there an odd number of times, ascending."""
    found, place = unique_inverse(values)
    return np.asarray(found[np.bincount(place, minlength=len(found)) % 2 == 1])


def crossed(outlines: Areas, begin: Float, end: Float, layer: Int) -> Bool:
    """(P,) whether the straight way from `begin` to `end` (P, 2) crosses a ring of its `layer` (P,)."""
    return np.asarray(crossings(outlines, begin, end, layer) > 0)


def crossings(outlines: Areas, begin: Float, end: Float, layer: Int) -> Int:
    """(P,) how often the straight way from `begin` to `end` (P, 2) crosses rings of its `layer` (P,).

    An edge belongs to one of its ends only, so a way through a corner crosses exactly one of the corner's edges.
    """
    result = np.zeros(len(begin), np.int64)
    if not len(begin) or not outlines.n_rings:
        return result
    a, b = outlines.xy, outlines.xy.take(outlines.following, axis=0)
    ways = Boxes(np.minimum(begin, end), np.maximum(begin, end), layer)
    way, edge = ways.overlapping(Boxes.of_sides(outlines))
    for some in np.array_split(np.arange(len(way)), len(way) // _PAIRS_AT_ONCE + 1):
        one, other = way[some], edge[some]
        share = crossing_shares(
            *(of.take(one, axis=0) for of in (begin, end)), *(of.take(other, axis=0) for of in (a, b))
        )
        result += np.bincount(one[~np.isnan(share)], minlength=len(begin))
    return result


def crossing_shares(begin: Float, end: Float, a: Float, b: Float) -> Float:
    """(n,) where each way (n, 2) to (n, 2) crosses its edge from `a` to `b` (n, 2), 0 to 1; nan where it does not.

    Which ways cross is decided as by `any_crossing`, without dividing.
    """
    (dx, dy), (ex, ey) = (end - begin).T, (b - a).T
    gap_x, gap_y = (a - begin).T
    side_a = dx * gap_y - dy * gap_x
    side_b = dx * (gap_y + ey) - dy * (gap_x + ex)
    along, turn = gap_y * ex - gap_x * ey, dy * ex - dx * ey
    along, turn = along * np.sign(turn), np.abs(turn)
    cross = ((side_a < 0) != (side_b < 0)) & (along > 0) & (along < turn)
    return np.where(cross, along / np.where(cross, turn, 1.0), np.nan)


def any_crossing(begin: Float, end: Float, a: Float, b: Float) -> Bool:
    """(P,) whether each way (P, 2) to (P, 2) crosses one of the edges (E, 2) to (E, 2).

    An edge belongs to one of its ends only, so a way through a corner crosses exactly one of the corner's edges.
    """
    way = end - begin
    side_a, side_b = _side(begin, way, a), _side(begin, way, b)
    edge = (b - a)[None]
    gap = begin[:, None] - a[None]
    along = gap[:, :, 0] * edge[:, :, 1] - gap[:, :, 1] * edge[:, :, 0]
    turn = way[:, None, 1] * edge[:, :, 0] - way[:, None, 0] * edge[:, :, 1]
    # The way reaches the edge's line at along/turn of its length: between 0 and 1, without dividing.
    along, turn = along * np.sign(turn), np.abs(turn)
    return np.asarray((((side_a < 0) != (side_b < 0)) & (along > 0) & (along < turn)).any(axis=1))


def _side(begin: Float, way: Float, points: Float) -> Float:
    """(P, E) on which side of each way each point lies: positive to the left."""
    gap = points[None] - begin[:, None]
    return way[:, None, 0] * gap[:, :, 1] - way[:, None, 1] * gap[:, :, 0]
