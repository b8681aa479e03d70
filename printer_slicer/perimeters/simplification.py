"""Remove points from paths where position and width change evenly."""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, next_in_ring, previous_in_ring
from printer_slicer.geometry.vectors import dot, norm

__all__ = ["points_to_keep"]


def points_to_keep(xy: Float, width: Float, size: Int, closed: Bool, tolerance: float) -> Bool:
    """Choose the points (N,) of paths that are needed to keep position and width within a tolerance.

    Points whose removal changes the path least are removed first, never two neighbours at a time. The changes of each
    segment are added up.

    Args:
        xy: (N, 2) mm.
        width: (N,) mm.
        size: (M,) points of each path.
        closed: (M,) whether it returns to its first point; both ends of open paths are kept.
        tolerance: mm, of position and width.
    """
    n = len(xy)
    start = np.append(0, np.cumsum(size))
    before, after = previous_in_ring(start), next_in_ring(start)
    fixed = np.zeros(n, np.bool_)
    fixed[start[:-1][~closed]] = fixed[start[1:][~closed] - 1] = True
    left = np.array(size)
    path = np.repeat(np.arange(len(size)), size)
    kept, moved = np.ones(n, np.bool_), np.zeros(n)  # `moved` is of the segment that begins at each point
    points = np.column_stack([xy, width])
    ask = np.flatnonzero(~fixed & (left[path] > 2))
    while len(ask):
        prior, next_one = before[ask], after[ask]
        off = _off(*(points.take(index, axis=0) for index in (ask, prior, next_one)))
        total = off + np.maximum(moved[prior], moved[ask])
        good = total <= tolerance
        ask, off, total = ask[good], off[good], total[good]
        first = _least(ask, off, before, after)
        going = np.bincount(path[ask[first]], minlength=len(size))
        first &= (left - going >= 3)[path[ask]] | ~closed[path[ask]]
        gone = ask[first]
        if not len(gone):
            break
        moved[before[gone]] = total[first]
        before[after[gone]], after[before[gone]] = before[gone], after[gone]
        kept[gone] = False
        left = left - np.bincount(path[gone], minlength=len(size))
        ask = ask[~first]
    return kept


def _least(ask: Int, off: Float, before: Int, after: Int) -> Bool:
    """Return which points `ask` (n,) deviate less than both neighbours; the lower index wins ties."""
    rank = np.full(len(before), np.inf)
    rank[ask] = off
    prior, next_one = before[ask], after[ask]
    low, high = rank[prior], rank[next_one]
    under_prior = (off < low) | ((off == low) & (ask < prior))
    return np.asarray(under_prior & ((off < high) | ((off == high) & (ask < next_one))))


def _off(point: Float, begin: Float, end: Float) -> Float:
    """Return the deviation (n,) of points (n, 3) of position and width from a straight segment, mm."""
    along = end - begin
    gap = point - begin
    length2 = np.maximum(dot(along[:, :2], along[:, :2]), 1e-18)
    share = np.clip(dot(gap[:, :2], along[:, :2]) / length2, 0, 1)
    away = np.abs(gap - share[:, None] * along)
    return np.asarray(np.maximum(norm(away[:, :2]), away[:, 2]))
