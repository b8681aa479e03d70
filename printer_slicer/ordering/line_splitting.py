"""Split infill lines where the nozzle passes them, to shorten travels.

A split line is printed from the split point to one end, then from the other end to the split point. The only travel in
between leads from end to end. Lines are split where they turn, which is at a wall, so that no end is unsupported.
"""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, consecutive
from printer_slicer.model import Toolpaths
from printer_slicer.ordering.loops import argmin_by_group
from printer_slicer.roles import Phase, roles_with

__all__ = ["split_lines"]

_MIN_SAVING = 4.0  # mm that a split must save


def split_lines(paths: Toolpaths) -> Toolpaths:
    """Split open infill paths in two where that shortens travels; paths must be in printing order."""
    first, last = paths.start[:-1], paths.start[1:] - 1
    splittable = (
        ~paths.closed
        & (paths.chain_id < 0)
        & roles_with(phase=Phase.INFILL, is_infill=True)[paths.role]
        & (last - first > 2)
    )
    splittable[[0, -1]] = False
    line = np.flatnonzero(splittable)
    if not len(line):
        return paths
    at, saved = _find_split_points(paths, line)
    chosen = _select_lines_to_split(line, saved)
    return _split_at_points(paths, line[chosen], at[chosen]) if chosen.any() else paths


def _find_split_points(paths: Toolpaths, line: Int) -> tuple[Int, Float]:
    """Return the best inner split point of each open line (n,), and the travel that it saves, mm."""
    first, last = paths.start[:-1], paths.start[1:] - 1
    ends = np.where(paths.closed, first, last)
    size = last[line] - first[line] - 1
    point = consecutive(first[line] + 1, size)
    come, go = paths.xy[ends[line - 1]], paths.xy[first[line + 1]]
    place = paths.xy.take(point, axis=0)
    length = _distances(place, np.repeat(come, size, axis=0)) + _distances(place, np.repeat(go, size, axis=0))
    chosen, least = argmin_by_group(length, size)
    one, other = paths.xy[first[line]], paths.xy[last[line]]
    return point[chosen], _distances(come, one) + _distances(other, go) - least - _distances(one, other)


def _select_lines_to_split(line: Int, saved: Float) -> Bool:
    """Return which lines to split (n,); of two consecutive lines only the one that saves more."""
    worth = np.where(saved > _MIN_SAVING, saved, 0.0)
    before = np.append(0.0, np.where(np.diff(line) == 1, worth[:-1], 0.0))
    after = np.append(np.where(np.diff(line) == 1, worth[1:], 0.0), 0.0)
    return np.asarray((worth > 0) & (worth > before) & (worth >= after))


def _split_at_points(paths: Toolpaths, line: Int, split_point: Int) -> Toolpaths:
    """Split lines (n,) in two: from `split_point` (n,) to the end, then from the start to `split_point`."""
    n = paths.n_paths
    count = np.ones(n, np.int64)
    count[line] = 2
    source = np.repeat(np.arange(n), count)
    first, stop = paths.start[:-1][source], paths.start[1:][source].copy()
    head = np.cumsum(count)[line] - 2
    first[head], stop[head + 1] = split_point, split_point + 1
    point = consecutive(first, stop - first)
    return paths.of_points(point, np.append(0, np.cumsum(stop - first)), source)


def _distances(one: Float, other: Float) -> Float:
    """Return the distances (n,) between points (n, 2), mm."""
    return np.asarray(np.hypot(*(one - other).T))
