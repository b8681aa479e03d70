"""Remove points from paths where position and width change evenly."""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, next_in_ring, previous_in_ring
from printer_slicer.geometry.vectors import dot, norm
from printer_slicer.kernel import load_kernel

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
    kernel, points = load_kernel(), np.column_stack([xy, width])
    if kernel:
        sizes, is_closed = np.asarray(size, np.int64), closed.astype(np.int64)
        return np.frombuffer(
            kernel.points_to_keep(points.data, sizes.data, is_closed.data, tolerance), np.bool_
        )
    n = len(xy)
    start = np.append(0, np.cumsum(size))
    before, after = previous_in_ring(start), next_in_ring(start)
    fixed = np.zeros(n, np.bool_)
    fixed[start[:-1][~closed]] = fixed[start[1:][~closed] - 1] = True
    left = np.array(size)
    path = np.repeat(np.arange(len(size)), size)
    kept, moved = np.ones(n, np.bool_), np.zeros(n)  # `moved` is of the segment that begins at each point
    candidates = np.flatnonzero(~fixed & (left[path] > 2))
    while len(candidates):
        prior, next_one = before[candidates], after[candidates]
        off = _compute_deviations(*(points.take(index, axis=0) for index in (candidates, prior, next_one)))
        total = off + np.maximum(moved[prior], moved[candidates])
        good = total <= tolerance
        candidates, off, total = candidates[good], off[good], total[good]
        first = _find_local_minima(candidates, off, before, after)
        going = np.bincount(path[candidates[first]], minlength=len(size))
        first &= (left - going >= 3)[path[candidates]] | ~closed[path[candidates]]
        gone = candidates[first]
        if not len(gone):
            break
        moved[before[gone]] = total[first]
        before[after[gone]], after[before[gone]] = before[gone], after[gone]
        kept[gone] = False
        left = left - np.bincount(path[gone], minlength=len(size))
        candidates = candidates[~first]
    return kept


def _find_local_minima(candidates: Int, deviation: Float, before: Int, after: Int) -> Bool:
    """Return which candidates (n,) deviate less than both neighbours; if equal, the lower index counts as less."""
    rank = np.full(len(before), np.inf)
    rank[candidates] = deviation
    prior, next_one = before[candidates], after[candidates]
    low, high = rank[prior], rank[next_one]
    under_prior = (deviation < low) | ((deviation == low) & (candidates < prior))
    return np.asarray(under_prior & ((deviation < high) | ((deviation == high) & (candidates < next_one))))


def _compute_deviations(point: Float, begin: Float, end: Float) -> Float:
    """Return the deviation (n,) of points (n, 3), of x, y and width, from straight segments, mm."""
    along = end - begin
    gap = point - begin
    length2 = np.maximum(dot(along[:, :2], along[:, :2]), 1e-18)
    share = np.clip(dot(gap[:, :2], along[:, :2]) / length2, 0, 1)
    away = np.abs(gap - share[:, None] * along)
    return np.asarray(np.maximum(norm(away[:, :2]), away[:, 2]))
