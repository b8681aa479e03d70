"""Points along paths that are close enough together to follow a surface."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from printer_slicer.arrays import Float, Int, consecutive
from printer_slicer.model import Toolpaths
from printer_slicer.values import Struct

__all__ = ["FinePoints", "split_by_length"]

_SHORTEST: Final = 1e-12  # mm; shorter lines have no direction
_POINTS_AT_ONCE: Final = 1 << 18  # bounds the memory for points of paths that are not contoured


class FinePoints(Struct, frozen=True, eq=False):
    """Points of paths at most a given distance apart.

    Attributes:
        start: (M + 1,) index of the first point of each path.
        corner: (N,) index of the point of the path, or of the one before an added point.
        share: (N,) position between this point and the next one, 0 to 1.
        xy: (N, 2) mm.
    """

    start: Int
    corner: Int
    share: Float
    xy: Float

    @classmethod
    def of(cls, paths: Toolpaths, spacing: float) -> FinePoints:
        """Add points to all lines of paths, at most `spacing` mm apart."""
        step = paths.xy.take(paths.following, axis=0) - paths.xy
        count = np.maximum(np.ceil(np.hypot(*step.T) / spacing), 1).astype(np.int64)
        corner = np.repeat(np.arange(len(count)), count)
        share = consecutive(np.zeros_like(count), count) / count.take(corner)
        xy = paths.xy.take(corner, axis=0) + share[:, None] * step.take(corner, axis=0)
        return cls(np.append(0, np.cumsum(count))[paths.start], corner, share, xy)

    @property
    def owner(self) -> Int:
        """Path (N,) of each point."""
        return np.repeat(np.arange(len(self.start) - 1), np.diff(self.start))

    def find_sides(self, paths: Toolpaths, share: float) -> Float:
        """Return the vectors (N, 2) from each point to the left, as long as a share of the width, mm.

        At points that coincide with the next one, and at the ends of open paths, they are those of the nearest line.
        """
        step = paths.xy.take(paths.following, axis=0) - paths.xy
        length = np.hypot(*step.T)
        line = _find_lines(length, paths.start)
        step = step[line] * (share * paths.width / np.maximum(length[line], _SHORTEST))[:, None]
        return np.stack([-step[:, 1], step[:, 0]], axis=1).take(self.corner, axis=0)


def _find_lines(length: Float, start: Int) -> Int:
    """Return the point (N,) where the next line with a length begins, or else the last such line of the path.

    Args:
        length: (N,) of the lines that begin at the points, mm.
        start: (M + 1,) index of the first point of each path.
    """
    number = np.arange(len(length))
    is_real = length > _SHORTEST
    after = np.minimum.accumulate(np.where(is_real, number, len(length))[::-1])[::-1]
    before = np.maximum.accumulate(np.where(is_real, number, -1))
    size = np.diff(start)
    first, end = np.repeat(start[:-1], size), np.repeat(start[1:], size)
    return np.where(after < end, after, np.where(before >= first, before, number))


def split_by_length(paths: Toolpaths, chosen: Int, spacing: float) -> Iterator[Int]:
    """Yield batches of the paths `chosen` (n,) with a limited number of points, unless one path has more.

    The points are `spacing` mm apart.
    """
    points = np.cumsum(paths.length()[chosen] / spacing + np.diff(paths.start)[chosen])
    batch = (points / _POINTS_AT_ONCE).astype(np.int64)
    for number in range(int(batch.max(initial=-1)) + 1):
        if (batch == number).any():
            yield chosen[batch == number]
