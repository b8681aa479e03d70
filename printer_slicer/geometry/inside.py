"""Points in rings, lines across rings."""

from __future__ import annotations

import numpy as np

from printer_slicer.geometry.areas import Areas, Bool, Float, Int

__all__ = ["any_crossing", "crossed", "rings_around"]

_PAIRS_AT_ONCE = 1 << 18  # of ways and edges: what is compared stays small


def rings_around(outlines: Areas, points: Float, layer: Int) -> Int:
    """For each point (P, 2) on its `layer` (P,) ascending the smallest ring that contains it, -1 where none does.

    Args:
        outlines: rings that do not cross; the direction does not matter.
        points: mm.
        layer: the layer each point lies on.
    """
    found = np.full(len(points), -1, np.int64)
    size = np.abs(outlines.ring_area())
    rings_of, points_of = outlines.layer_start, np.searchsorted(layer, np.arange(outlines.n_layers + 1))
    for k in np.unique(layer).tolist():
        first, last = int(points_of[k]), int(points_of[k + 1])
        here = points[first:last]
        # Smaller rings last, so that they overwrite the larger ones around them.
        for ring in sorted(range(int(rings_of[k]), int(rings_of[k + 1])), key=lambda i: -size[i]):
            found[first:last][_inside(outlines.ring(ring), here)] = ring
    return found


def _inside(ring: Float, points: Float) -> Bool:
    """(P,) whether a ray to the right crosses the ring an odd number of times; only points in its box are tried."""
    inside = ((points >= ring.min(axis=0)) & (points <= ring.max(axis=0))).all(axis=1)
    x, y = points[inside, 0][:, None], points[inside, 1][:, None]
    ax, ay = ring[:, 0][None], ring[:, 1][None]
    bx, by = np.roll(ring[:, 0], -1)[None], np.roll(ring[:, 1], -1)[None]
    crosses = (ay <= y) != (by <= y)
    with np.errstate(divide="ignore", invalid="ignore"):
        right = ax + (y - ay) / (by - ay) * (bx - ax) > x
    inside[inside] = (crosses & right).sum(axis=1) % 2 == 1
    return np.asarray(inside)


def crossed(outlines: Areas, begin: Float, end: Float, layer: Int) -> Bool:
    """(P,) whether the straight way from `begin` to `end` (P, 2) crosses a ring of its `layer` (P,).

    An edge belongs to one of its ends only, so a way through a corner crosses exactly one of the corner's edges.
    """
    from printer_slicer.geometry.planar import SegmentTree  # noqa: PLC0415 - shapely only when it is needed

    result = np.zeros(len(begin), np.bool_)
    if not len(begin) or not outlines.n_rings:
        return result
    a, b = outlines.xy, outlines.xy.take(outlines.following, axis=0)
    # Layers side by side, so that one tree serves all of them.
    every = np.concatenate([begin, end, a])
    pitch = float(every[:, 0].max() - every[:, 0].min()) + 1.0
    edge_layer = outlines.point_layer
    aside, way_aside = (np.multiply.outer(of * pitch, (1.0, 0.0)) for of in (edge_layer, layer))
    tree = SegmentTree(np.stack([a + aside, b + aside], axis=1))
    way, edge = tree.meeting(begin + way_aside, end + way_aside)
    for some in np.array_split(np.arange(len(way)), len(way) // _PAIRS_AT_ONCE + 1):
        result[way[some][_pairs_cross(begin, end, a, b, way[some], edge[some])]] = True
    return result


def _pairs_cross(begin: Float, end: Float, a: Float, b: Float, way: Int, edge: Int) -> Bool:  # noqa: PLR0917
    """(n,) whether each way crosses its edge; see `any_crossing`."""
    (dx, dy), (ex, ey) = (end - begin).take(way, axis=0).T, (b - a).take(edge, axis=0).T
    gap_x, gap_y = (a.take(edge, axis=0) - begin.take(way, axis=0)).T
    side_a = dx * gap_y - dy * gap_x
    side_b = dx * (gap_y + ey) - dy * (gap_x + ex)
    along, turn = gap_y * ex - gap_x * ey, dy * ex - dx * ey
    along, turn = along * np.sign(turn), np.abs(turn)
    return np.asarray(((side_a < 0) != (side_b < 0)) & (along > 0) & (along < turn))


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
