"""Clip outlines to areas."""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, consecutive
from printer_slicer.geometry.areas import Areas
from printer_slicer.geometry.clipping import clip_with_sources
from printer_slicer.geometry.polylines import Polylines

__all__ = ["clip_outlines"]

_Paths = tuple[Float, Int, Int, Bool]


def clip_outlines(outlines: Areas, within: Areas) -> tuple[Float, Int, Int, Bool]:
    """Return the parts of the rings of `outlines` that lie in the areas of `within`, layer by layer.

    A ring that lies entirely inside stays closed; the parts of other rings are polylines. Parts along an outline of
    `within` may be included or not, depending on rounding. If open lines are enough, `outlines_within` is faster.

    Args:
        outlines: any rings.
        within: clean areas.

    Returns:
        Points (N, 2), and for each path the number of points (M,), the source ring (M,), ascending, and whether it is
        closed (M,).

    Raises:
        ValueError: the stacks have different numbers of layers.
    """
    if outlines.n_layers != within.n_layers:
        raise ValueError(
            f"the stacks have different numbers of layers: {outlines.n_layers} and {within.n_layers}"
        )
    sizes = np.diff(outlines.ring_start)
    # Each ring as an open line that ends at its first point.
    points = consecutive(outlines.ring_start[:-1], sizes + 1)
    points[np.cumsum(sizes + 1) - 1] = outlines.ring_start[:-1]
    parts, ring = clip_with_sources(within, Polylines.of(outlines.xy[points], sizes + 1, outlines.ring_layer))
    order = np.argsort(ring, kind="stable")
    ring, size = ring[order], parts.size[order]
    xy = parts.xy[consecutive(parts.start[:-1][order], size)]
    through = (parts.edge[order] < 0).T  # starts, or ends, at the first point of the ring
    closed = through[0] & through[1]
    # The part that ends there, the last of its ring, continues with the part that starts there, the first of its ring.
    first = np.flatnonzero(through[0] & ~closed)
    last = np.searchsorted(ring, ring[first], side="right") - 1
    continues = through[1][last] & ~closed[last] & (last > first)
    return _join_at_ring_starts((xy, size, ring, closed), first[continues], last[continues])


def _join_at_ring_starts(paths: _Paths, first: Int, last: Int) -> _Paths:
    """Append each path `first` to its path `last`; store the point at which they join only once."""
    xy, size, ring, closed = paths
    start = np.cumsum(size) - size
    alone = np.ones(len(size), np.bool_)
    alone[first] = False
    follower = np.full(len(size), -1)
    follower[last] = first
    kept = np.flatnonzero(alone)
    extra = np.where(follower[kept] >= 0, size[follower[kept]] - 1, 0)
    own = size[kept] - closed[kept]
    pieces_start = np.stack(
        [start[kept], np.where(follower[kept] >= 0, start[follower[kept]] + 1, 0)], axis=1
    )
    pieces_size = np.stack([own, extra], axis=1)
    points = consecutive(pieces_start.ravel(), pieces_size.ravel())
    return xy[points], own + extra, ring[kept], closed[kept]
