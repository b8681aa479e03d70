"""Points along paths that are close enough together to follow a surface."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from printer_slicer.arrays import Float, Int, consecutive
from printer_slicer.model import Toolpaths
from printer_slicer.values import Struct

__all__ = ["FinePoints", "split_by_length"]

_SIDE: Final = 0.45  # widths of an extrusion from its centre to its sides, as far as these are looked at
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

    def find_sides(self, paths: Toolpaths) -> Float:
        """Return the vectors (N, 2) from each point almost to the left side of its extrusion, mm."""
        step = paths.xy.take(paths.following, axis=0) - paths.xy
        step *= (_SIDE * paths.width / np.maximum(np.hypot(*step.T), 1e-12))[:, None]
        return np.stack([-step[:, 1], step[:, 0]], axis=1).take(self.corner, axis=0)


def split_by_length(paths: Toolpaths, chosen: Int, spacing: float) -> Iterator[Int]:
    """Yield batches of the paths `chosen` (n,) with a limited number of points, unless one path has more.

    The points are `spacing` mm apart.
    """
    points = np.cumsum(paths.length()[chosen] / spacing + np.diff(paths.start)[chosen])
    batch = (points / _POINTS_AT_ONCE).astype(np.int64)
    for number in range(int(batch.max(initial=-1)) + 1):
        if (batch == number).any():
            yield chosen[batch == number]
