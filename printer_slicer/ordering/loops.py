"""Closed paths (loops), and positions along them.

A position on a loop is given in mm along it from its first point; values wrap around at the length of the loop.
"""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Float, Int, consecutive, next_in_ring
from printer_slicer.geometry.vectors import nearest_share, norm
from printer_slicer.model import Toolpaths
from printer_slicer.values import Struct, replace

__all__ = ["Loops", "argmin_by_group", "close_loops", "start_loops_at"]

_SAME_POINT = 2e-3  # mm; a position this close to a point of its loop is that point


class Loops(Struct, frozen=True, eq=False):
    """A selection of closed paths.

    Attributes:
        path: (R,) indices of the paths.
        xy: (N, 2) mm, their points.
        start: (R + 1,) index of the first point of each loop.
        point: (N,) indices of the points in the paths.
        layer: (R,) layer of each loop.
        reach: (N,) mm along the loop from its first point to each point.
        length: (R,) length of each loop, mm.
        following: (N,) index of the next point.
    """

    path: Int
    xy: Float
    start: Int
    point: Int
    layer: Int
    reach: Float
    length: Float
    following: Int
    _mark: Float

    @classmethod
    def of(cls, paths: Toolpaths, selected: Int) -> Loops:
        """Select the paths `selected` (R,), which must be closed."""
        size = np.diff(paths.start)[selected]
        point = consecutive(paths.start[selected], size)
        start = np.append(0, np.cumsum(size))
        xy, following = paths.xy.take(point, axis=0), next_in_ring(start)
        walked = np.append(0.0, np.cumsum(np.hypot(*(xy.take(following, axis=0) - xy).T)))
        reach = walked[:-1] - np.repeat(walked[start[:-1]], size)
        length = np.diff(walked[start])
        return cls(selected, xy, start, point, paths.layer[selected], reach, length, following, walked)

    @property
    def n_loops(self) -> int:
        """Number of loops."""
        return len(self.path)

    def find_segments(self, loop: Int, along: Float) -> tuple[Int, Float]:
        """Return for positions (Q,) on loops (Q,) the start point of their segment, and the distance from it, mm."""
        length = self.length[loop]
        within = np.where(length > 0, np.mod(along, np.maximum(length, 1e-12)), 0.0)
        mark = self._mark[self.start[loop]] + within
        point = np.searchsorted(self._mark, mark, side="right") - 1
        point = np.clip(point, self.start[loop], self.start[loop + 1] - 1)
        return point, np.maximum(mark - self._mark[point], 0.0)

    def points_at(self, loop: Int, along: Float) -> Float:
        """Return the points (Q, 2) at positions (Q,) on loops (Q,), mm."""
        point, beyond = self.find_segments(loop, along)
        ends = self.following[point]
        delta = self.xy.take(ends, axis=0) - self.xy.take(point, axis=0)
        size = np.hypot(*delta.T)
        share = np.where(size > 0, np.minimum(beyond / np.maximum(size, 1e-12), 1.0), 0.0)
        return self.xy.take(point, axis=0) + delta * share[:, None]

    def nearest_vertices(self, loop: Int, goal: Float) -> Float:
        """Return the position (Q,) of the vertex of each loop (Q,) nearest to a goal (Q, 2), mm."""
        size = np.diff(self.start)[loop]
        point = consecutive(self.start[loop], size)
        gap = self.xy.take(point, axis=0) - np.repeat(goal, size, axis=0)
        chosen, _ = argmin_by_group((gap * gap).sum(axis=1), size)
        return np.asarray(self.reach[point[chosen]])

    def nearest_positions(self, loop: Int, goal: Float) -> tuple[Float, Float]:
        """Return the position (Q,) on each loop (Q,) nearest to a goal (Q, 2), and its distance (Q,), mm."""
        size = np.diff(self.start)[loop]
        point = consecutive(self.start[loop], size)
        start = self.xy.take(point, axis=0)
        delta = self.xy.take(self.following[point], axis=0) - start
        gap = np.repeat(goal, size, axis=0) - start
        share = nearest_share(gap, delta)
        chosen, least = argmin_by_group(np.hypot(*(gap - share[:, None] * delta).T), size)
        return self.reach[point[chosen]] + share[chosen] * norm(delta[chosen]), least


def argmin_by_group(values: Float, size: Int) -> tuple[Int, Float]:
    """Return the index (Q,) of the first minimum in each group of `size` (Q,) values, and the minima (Q,)."""
    if not len(size):
        return np.zeros(0, np.int64), np.zeros(0)
    least = np.minimum.reduceat(values, np.cumsum(size) - size)
    hits = np.flatnonzero(values == np.repeat(least, size))
    owner = np.repeat(np.arange(len(size)), size)[hits]
    return np.asarray(hits[np.searchsorted(owner, np.arange(len(size)))]), least


def close_loops(paths: Toolpaths) -> Toolpaths:
    """Close open paths that end at their start point, unless they belong to a chain."""
    start, last = paths.start[:-1], paths.start[1:] - 1
    returns = np.hypot(*(paths.xy[start] - paths.xy[last]).T) < _SAME_POINT
    returns &= ~paths.closed & (paths.chain_id < 0) & (last - start > 2)
    if not returns.any():
        return paths
    kept = np.ones(len(paths.xy), np.bool_)
    kept[last[returns]] = False
    start = np.append(0, np.cumsum(np.diff(paths.start) - returns))
    some = paths.of_points(np.flatnonzero(kept), start, np.arange(paths.n_paths))
    return replace(some, closed=paths.closed | returns)


def start_loops_at(paths: Toolpaths, loops: Loops, along: Float) -> Toolpaths:
    """Move the start of loops to the positions `along` (R,), mm, and insert points there if necessary."""
    point, beyond = loops.find_segments(np.arange(loops.n_loops), along)
    ends = loops.following[point]
    size = np.hypot(*(loops.xy[ends] - loops.xy[point]).T)
    near_end = (size - beyond < _SAME_POINT) & (beyond >= _SAME_POINT)
    new = (beyond >= _SAME_POINT) & ~near_end
    first = np.where(near_end, ends, point)
    # With a new point the loop starts there and continues with the end of that segment.
    share = np.where(new, beyond / np.maximum(size, 1e-12), 0.0)
    place = loops.xy[point] * (1 - share[:, None]) + loops.xy[ends] * share[:, None]
    whole, other = loops.point[point], loops.point[ends]
    width = paths.width[whole] * (1 - share) + paths.width[other] * share
    head = np.where(new, other, loops.point[first])
    return _rotate_loops(paths, loops.path, head, new, (place, width, paths.support_ratio[whole]))


def _rotate_loops(
    paths: Toolpaths, path: Int, head: Int, new: np.ndarray, new_points: tuple[Float, Float, Float]
) -> Toolpaths:
    """Rotate the loops `path` (R,) so that they start with their point `head` (R,).

    Where `new` (R,) is true, a new point is added before it: position, width and support ratio in `new_points`.
    """
    size = np.diff(paths.start)
    extra, turn = np.zeros((2, paths.n_paths), np.int64)
    extra[path], turn[path] = new, head - paths.start[path]
    if not (extra.any() or turn.any()):
        return paths
    start = np.append(0, np.cumsum(size + extra))

    def find_points(some: slice) -> tuple[Int, Int]:
        """Return for the points of some paths the points that they were; new points are filled in afterwards."""
        count, first = size[some] + extra[some], paths.start[:-1][some]
        point = consecutive(first + turn[some] - extra[some], count)
        point[(start[:-1][some] - start[some.start])[extra[some] > 0]] += 1
        beyond = np.flatnonzero(point >= np.repeat(first + size[some], count))
        point[beyond] -= np.repeat(size[some], count)[beyond]
        return point, point

    rotated, columns = paths.rebuild(find_points, start, np.arange(paths.n_paths))
    at = start[path[new]]
    for name, column in zip(("xy", "width", "support_ratio"), new_points, strict=True):
        if name in columns:
            columns[name][at] = column[new]
    return rotated
