"""Scarf seams: the start and end of a loop overlap in a slope, which hides the seam.

On the first section of the loop the nozzle rises from the layer below to the top of the layer, and the flow increases
with it. After a full turn the same section is printed again at the top of the layer, with the rest of the flow.
"""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Float, Int, consecutive
from printer_slicer.model import Toolpaths
from printer_slicer.ordering.loops import Loops
from printer_slicer.profile import Profile
from printer_slicer.roles import Role
from printer_slicer.values import replace

__all__ = ["add_scarfs"]


def add_scarfs(paths: Toolpaths, profile: Profile, allowed: Int | None = None) -> Toolpaths:
    """Add scarf seams to external perimeters that are long enough, except in the first layer.

    `allowed` (n,) are the loops that may have one; default: all.
    """
    quality = profile.quality
    if not quality.scarf_length:
        return paths
    roles = [Role.EXTERNAL_PERIMETER, *([Role.PERIMETER] if quality.scarf_inner else [])]
    allowed = np.flatnonzero(paths.closed) if allowed is None else allowed
    some = allowed[np.isin(paths.role[allowed], roles) & (paths.layer[allowed] > 0)]
    loops = Loops.of(paths, some)
    long = np.flatnonzero(loops.length > 2 * quality.scarf_length)
    if not len(long):
        return paths
    return _add_slopes(paths, Loops.of(paths, loops.path[long]), quality.scarf_length, quality.scarf_start)


def _add_slopes(paths: Toolpaths, loops: Loops, length: float, start_ratio: float) -> Toolpaths:
    """Open the loops and overlap them by `length` mm; extrusions start at `start_ratio` of their height."""
    size = np.diff(paths.start)
    within = np.bincount(
        np.repeat(np.arange(loops.n_loops), np.diff(loops.start))[(loops.reach > 0) & (loops.reach < length)],
        minlength=loops.n_loops,
    )
    every = np.arange(loops.n_loops)
    crest, _ = loops.find_segments(every, np.full(loops.n_loops, length))
    crest_xy = loops.points_at(every, np.full(loops.n_loops, length))
    count = size.copy()
    count[loops.path] += within + 4
    start = np.append(0, np.cumsum(count))
    source, along = _list_scarf_points(paths, loops, within, count, length)
    some = paths.of_points(source, start, np.arange(paths.n_paths))
    n = size[loops.path]
    first = start[loops.path]
    # Add a point at the end of the slope, once on the way up and once at the end of the loop.
    xy, width, support_ratio = some.xy.copy(), some.width.copy(), some.support_ratio.copy()
    for at in (first + within + 1, first + n + within + 3):
        xy[at], support_ratio[at] = crest_xy, paths.support_ratio[loops.point[crest]]
        width[at] = paths.width[loops.point[crest]]
    owner = np.repeat(every, count[loops.path])
    point = consecutive(first, count[loops.path])
    share, rise = some.flow_ratio.copy(), some.z_offset.copy()
    share[point], rise[point] = _compute_slope(
        along, loops.length[owner], paths.height[loops.path][owner], length, start_ratio
    )
    # The end of the turn occurs twice: with full flow before it, and with the remaining flow after it.
    share[first + n + 2] = 1.0 - start_ratio
    closed = paths.closed.copy()
    closed[loops.path] = False
    return replace(
        some, xy=xy, width=width, support_ratio=support_ratio, flow_ratio=share, z_offset=rise, closed=closed
    )


def _list_scarf_points(
    paths: Toolpaths, loops: Loops, within: Int, count: Int, length: float
) -> tuple[Int, Float]:
    """Return the source of every new point, and the position of every point along its loop, mm."""
    size = np.diff(paths.start)
    owner = np.repeat(np.arange(paths.n_paths), count)
    step = consecutive(np.zeros_like(count), count)
    source = paths.start[:-1][owner] + np.minimum(step, size[owner] - 1)
    n, k = size[loops.path], within
    of = np.repeat(np.arange(loops.n_loops), count[loops.path])
    at = consecutive(np.zeros_like(n), count[loops.path])
    n, k = n[of], k[of]
    # p0 .. pk, crest, pk+1 .. pn-1, p0, p0, p1 .. pk, crest
    point = np.where(at <= k, at, np.where(at <= n, at - 1, np.where(at <= n + 2, 0, at - n - 2)))
    point = np.minimum(np.where((at == k + 1) | (at == n + k + 3), k, point), n - 1)
    along = loops.reach[loops.start[of] + point] + np.where(at > n, loops.length[of], 0.0)
    along = np.where(at == k + 1, length, np.where(at == n + k + 3, loops.length[of] + length, along))
    source[consecutive((np.cumsum(count) - count)[loops.path], count[loops.path])] = (
        paths.start[:-1][loops.path][of] + point
    )
    return source, along


def _compute_slope(
    along: Float, loop_length: Float, height: Float, length: float, start_ratio: float
) -> tuple[Float, Float]:
    """Return flow ratio and z offset, mm, at positions along loops of length `loop_length`, mm."""
    climbed = start_ratio + (1.0 - start_ratio) * np.clip(along / length, 0.0, 1.0)
    left = (1.0 - start_ratio) * (1.0 - np.clip((along - loop_length) / length, 0.0, 1.0))
    again = along > loop_length
    return np.where(again, left, climbed), np.where(again, 0.0, -height * (1.0 - climbed))
