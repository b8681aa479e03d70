"""The medial axis as a graph whose pieces can be divided."""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Float, Int, compact_ids, consecutive
from printer_slicer.geometry.medial_axis import MedialAxis, follow_parts
from printer_slicer.geometry.vectors import norm
from printer_slicer.kernel import load_kernel
from printer_slicer.values import Struct

__all__ = ["AxisGraph", "find_crossings", "thin_and_thick_ends"]


class AxisGraph(Struct, frozen=True, eq=False):
    """Points and pieces of a medial axis, named as in `MedialAxis`.

    Attributes:
        xy: (V, 2) mm.
        radius: (V,) mm.
        layer: (V,).
        start: (H,).
        foot: (H, 2, 2) mm.
        following: (H,).
        steepness: (E,) change of the radius per length along the piece, 0 to 1.
        origin: (E,) the piece of the medial axis that contains this piece.
    """

    xy: Float
    radius: Float
    layer: Int
    start: Int
    foot: Float
    following: Int
    steepness: Float
    origin: Int

    @classmethod
    def of(cls, axis: MedialAxis) -> AxisGraph:
        """Return the graph of a whole medial axis."""
        ends = axis.start.reshape(-1, 2)
        length = norm(axis.xy.take(ends[:, 1], axis=0) - axis.xy.take(ends[:, 0], axis=0))
        rise = np.abs(axis.radius[ends[:, 1]] - axis.radius[ends[:, 0]])
        steepness = np.where(length > 1e-6, rise / np.maximum(length, 1e-6), 0.0)
        return cls(
            axis.xy,
            axis.radius,
            axis.layer,
            axis.start,
            axis.foot,
            axis.following,
            steepness,
            np.arange(len(ends)),
        )

    @property
    def ends(self) -> Int:
        """Return the points (E, 2) at both ends of each piece."""
        return self.start.reshape(-1, 2)

    @property
    def piece_layer(self) -> Int:
        """Return the layer (E,) of each piece."""
        return np.asarray(self.layer[self.ends[:, 0]])

    @property
    def length(self) -> Float:
        """Return the length (E,) of each piece, mm."""
        ends = self.ends
        return np.asarray(norm(self.xy.take(ends[:, 1], axis=0) - self.xy.take(ends[:, 0], axis=0)))

    @property
    def middle_radius(self) -> Float:
        """Return the radius (E,) at the middle of each piece, mm."""
        low, high = self.radius.take(self.ends.T)
        return np.asarray((low + high) / 2)

    def with_pieces(self, kept: Int) -> AxisGraph:
        """Return the graph of only the pieces `kept` (n,), ascending; walks skip removed pieces."""
        number = np.full(len(self.start), -1)
        half = np.stack([2 * kept, 2 * kept + 1], axis=1).ravel()
        number[half] = np.arange(len(half))
        following = np.full(len(half), -1)
        left, ahead = np.arange(len(half)), self.following[half]
        while len(left):
            known = ahead >= 0
            left, ahead = left[known], ahead[known]
            following[left] = number[ahead]
            gone = number[ahead] < 0
            left, ahead = left[gone], self.following[ahead[gone] ^ 1]
        points, start = compact_ids(self.start[half], len(self.xy))
        return AxisGraph(
            self.xy.take(points, axis=0),
            self.radius[points],
            self.layer[points],
            start,
            self.foot.take(half, axis=0),
            following,
            self.steepness[kept],
            self.origin[kept],
        )

    def divide_pieces(self, piece: Int, share: Float) -> AxisGraph:
        """Divide pieces at positions (0 to 1) along them, given in any order."""
        order = np.lexsort((share, piece))
        piece, share = piece[order], share[order]
        start, foot, following, owner = _divide(self, piece, share)
        ends = self.ends
        along = _interpolate(self.xy.take(ends[piece], axis=0), share[:, None])
        return AxisGraph(
            np.concatenate([self.xy, along]),
            np.concatenate([self.radius, _interpolate(self.radius[ends[piece]], share)]),
            np.concatenate([self.layer, self.layer[ends[piece, 0]]]),
            start,
            foot,
            following,
            self.steepness[owner],
            self.origin[owner],
        )


def _divide(graph: AxisGraph, piece: Int, share: Float) -> tuple[Int, Float, Int, Int]:
    """Divide pieces at ascending positions (n,); return `start`, `foot` and `following` of the parts, and their pieces.

    Each position becomes a new point.
    """
    kernel = load_kernel()
    if kernel:
        arrays = graph.start, graph.foot, graph.following, piece, share
        found = kernel.divide_pieces(len(graph.xy), *(array.data for array in arrays))
        start, following, owner = (np.frombuffer(found[i], np.int64) for i in (0, 2, 3))
        return start, np.frombuffer(found[1]).reshape(-1, 2, 2), following, owner
    n_new = np.bincount(piece, minlength=len(graph.steepness))
    count = n_new + 1
    ends, new = graph.ends, len(graph.xy) + np.cumsum(n_new) - n_new
    owner, step = np.repeat(np.arange(len(count)), count), consecutive(np.zeros_like(count), count)
    is_first, is_last = step == 0, step == n_new[owner]
    points = np.stack(
        [
            np.where(is_first, ends[owner, 0], new[owner] + step - 1),
            np.where(is_last, ends[owner, 1], new[owner] + step),
        ],
        axis=1,
    )
    low, high = np.zeros(len(owner)), np.ones(len(owner))
    low[~is_first], high[~is_last] = share, share
    foot = _interpolate_feet(graph.foot, owner, low, high)
    return points.ravel(), foot, follow_parts(graph.following, count), owner


def _interpolate(ends: Float, share: Float) -> Float:
    """Interpolate between the values at both ends (n, 2, ...)."""
    return np.asarray(ends[:, 0] + (ends[:, 1] - ends[:, 0]) * share)


def _interpolate_feet(foot: Float, owner: Int, low: Float, high: Float) -> Float:
    """Return the feet (H, 2, 2) of parts of the pieces `owner`, each from position `low` to `high` on its piece."""
    up, down = foot.take(2 * owner, axis=0), foot.take(2 * owner + 1, axis=0)
    low, high = low[:, None], high[:, None]
    parts = [
        np.stack([_interpolate(up, low), _interpolate(up, high)], axis=1),
        np.stack([_interpolate(down, 1 - high), _interpolate(down, 1 - low)], axis=1),
    ]
    return np.stack(parts, axis=1).reshape(-1, 2, 2)


def thin_and_thick_ends(ends: Int, radius: Float) -> tuple[Int, Int]:
    """Return for each piece the end (n,) with the smaller radius, and the end (n,) with the larger one."""
    first, second = ends.T
    falls = radius.take(first) >= radius.take(second)
    return np.where(falls, second, first), np.where(falls, first, second)


def find_crossings(ends: Float, level: Float) -> tuple[Int, Float]:
    """Find where values interpolated between `ends` (n, 2) cross `level` (n,); return items and positions, 0 to 1."""
    low, high = (ends - level[:, None]).T
    item = np.flatnonzero(low * high < 0)
    share = low[item] / (low[item] - high[item])
    inside = (share > 1e-6) & (share < 1 - 1e-6)
    return item[inside], share[inside]
