"""Edges of a stack that come near each other: how far other rings are, and where a ring meets itself.

Edge `i` of a stack runs from point `i` to the point after it around its ring.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from printer_slicer.geometry import Areas, Bool, Float, Int
from printer_slicer.geometry.nearest import distance_to_segments
from printer_slicer.geometry.planar import SegmentTree

__all__ = ["clearance", "contacts"]

_SAME: Final = 1e-9  # mm; what is nearer than this touches
_AT_ONCE: Final = 8192  # edges to look around; in dense contours each may have thousands of others in reach


def clearance(areas: Areas, reach: float) -> Float:
    """(N,) mm from each edge to the nearest edge of another ring of its layer, `reach` where none is nearer."""
    ring = np.repeat(np.arange(areas.n_rings), np.diff(areas.ring_start))
    result = np.full(len(areas.xy), reach)
    for first, second in _near(areas, reach):
        other = ring[first] != ring[second]
        here, there = first[other], second[other]
        gap = _distance(areas, here, there)
        np.minimum.at(result, here, gap)
        np.minimum.at(result, there, gap)
    return result


def contacts(areas: Areas) -> tuple[Int, Int]:
    """Pairs of edges of the same ring that cross or touch, other than neighbours in the point that they share."""
    ring = np.repeat(np.arange(areas.n_rings), np.diff(areas.ring_start))
    found = [(np.zeros(0, np.int64), np.zeros(0, np.int64))]
    for first, second in _near(areas, _SAME):
        same = ring[first] == ring[second]
        here, there = first[same], second[same]
        meet = _meet(areas, here, there)
        found.append((here[meet], there[meet]))
    firsts, seconds = zip(*found, strict=True)
    return np.concatenate(firsts), np.concatenate(seconds)


def _meet(areas: Areas, first: Int, second: Int) -> Bool:
    """(P,) whether the edges of each pair of one ring have more in common than the point that neighbours share."""
    following = areas.following
    closes = following[second] == first  # the last edge of a ring and its first
    first, second = np.where(closes, second, first), np.where(closes, first, second)
    neighbours = following[first] == second
    gap = np.zeros(len(first))
    gap[~neighbours] = _distance(areas, first[~neighbours], second[~neighbours])
    # Two edges from one point touch elsewhere only where the far end of one lies on the other.
    begin, corner = areas.xy[first[neighbours]], areas.xy[second[neighbours]]
    end = areas.xy[following[second[neighbours]]]
    folded = np.minimum(distance_to_segments(begin, corner, end), distance_to_segments(end, begin, corner))
    gap[neighbours] = folded
    return np.asarray(gap <= _SAME)


def _near(areas: Areas, reach: float) -> Iterator[tuple[Int, Int]]:
    """Pairs of edges of one layer whose boxes are at most `reach` apart, the lower index first, some at a time."""
    if not areas.n_rings:
        return
    layer = np.repeat(areas.ring_layer, np.diff(areas.ring_start))
    begin, end = areas.xy, areas.xy[areas.following]
    low, high = np.minimum(begin, end), np.maximum(begin, end)
    # One tree for all layers: each has a cell of its own on a square lattice, too far from the others to be met.
    span = float((high.max(axis=0) - low.min(axis=0)).max())
    side = int(np.ceil(np.sqrt(areas.n_layers)))
    cell = np.column_stack(np.divmod(layer, side)) * (span + 4 * reach + 1.0)
    tree = SegmentTree(np.stack([begin + cell, end + cell], axis=1))
    # Twice the reach, since far from the origin the corners of the boxes are rounded.
    low, high = low + cell - 2 * reach, high + cell + 2 * reach
    for at in range(0, len(low), _AT_ONCE):
        first, second = tree.meeting(low[at : at + _AT_ONCE], high[at : at + _AT_ONCE])
        once = first + at < second
        yield first[once] + at, second[once]


def _distance(areas: Areas, first: Int, second: Int) -> Float:
    """(P,) mm between the edges of each pair, 0 where they cross."""
    following = areas.following
    a, b = areas.xy[first], areas.xy[following[first]]
    c, d = areas.xy[second], areas.xy[following[second]]
    ends = [distance_to_segments(*way) for way in ((a, c, d), (b, c, d), (c, a, b), (d, a, b))]
    crossing = (_side(a, b, c) * _side(a, b, d) < 0) & (_side(c, d, a) * _side(c, d, b) < 0)
    return np.where(crossing, 0.0, np.minimum.reduce(ends))


def _side(a: Float, b: Float, point: Float) -> Float:
    """(P,) positive where the point lies to the left of the way from a to b."""
    along, gap = b - a, point - a
    return np.asarray(along[:, 0] * gap[:, 1] - along[:, 1] * gap[:, 0])
