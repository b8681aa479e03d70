"""Points in rings, lines across rings."""

from __future__ import annotations

import numpy as np

from printer_slicer.geometry.areas import Areas, Bool, Float, Int

__all__ = ["any_crossing", "crossed", "rings_around"]

_STRIP = 5.0  # mm
_WAYS_AT_ONCE = 16
_FEW_PAIRS = 50_000  # of ways and edges; looking for the near ones would take longer


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
    """(P,) whether the straight way from `begin` to `end` (P, 2) crosses a ring of its `layer` (P,) ascending."""
    result = np.zeros(len(begin), np.bool_)
    ring_points = outlines.ring_start[outlines.layer_start]
    following = outlines.following
    ways_of = np.searchsorted(layer, np.arange(outlines.n_layers + 1))
    for k in np.unique(layer).tolist():
        points = slice(int(ring_points[k]), int(ring_points[k + 1]))
        a, b = outlines.xy[points], outlines.xy.take(following[points], axis=0)
        here = np.arange(int(ways_of[k]), int(ways_of[k + 1]))
        result[here] = _crossed_here(begin[here], end[here], a, b)
    return result


def _crossed_here(begin: Float, end: Float, a: Float, b: Float) -> Bool:
    """(P,) whether each way crosses one of the edges; few ways at a time, against the edges around them only."""
    if len(begin) * len(a) <= _FEW_PAIRS:
        return any_crossing(begin, end, a, b)
    result = np.zeros(len(begin), np.bool_)
    low, high = np.minimum(a, b), np.maximum(a, b)
    # Neighbours in a sequence of strips have a small box around them, which few edges meet.
    middle = (begin + end) / 2
    strips = np.floor(middle[:, 1] / _STRIP)
    for some in np.array_split(np.lexsort((middle[:, 0], strips)), len(begin) // _WAYS_AT_ONCE + 1):
        ends = np.concatenate([begin[some], end[some]])
        near = ((low <= ends.max(axis=0)) & (high >= ends.min(axis=0))).all(axis=1)
        if near.any():
            result[some] = any_crossing(begin[some], end[some], a[near], b[near])
    return result


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
