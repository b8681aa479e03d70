"""Round areas to the numbers that a file format holds: whole units or 32-bit floats."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from printer_slicer.arrays import Bool, Int, consecutive, frozen_array
from printer_slicer.geometry import Areas
from printer_slicer.values import Struct, force_setattr

__all__ = ["RoundedRings", "round_to_float32", "round_to_grid"]


class RoundedRings(Struct, frozen=True, eq=False):
    """Rings of a stack with coordinates rounded to the numbers of a file format.

    Points that equal the next one after rounding are removed, and so are rings that lose their area or change their
    direction. Rings that were closer together than the rounding may touch.

    Attributes:
        xy: (N, 2) units as int64, or mm as float32; the last point of a ring is not its first.
        ring_start: (R + 1,) ring `i` is `xy[ring_start[i]:ring_start[i + 1]]`.
        ring_layer: (R,) ascending.
        outer: (R,) whether the ring is the outline of a solid (counter-clockwise), not of a hole.
        n_layers: number of layers, including empty ones.
        error: largest change of a coordinate, mm, measured.
        lost: number of removed rings.
    """

    xy: NDArray[Any]
    ring_start: Int
    ring_layer: Int
    outer: Bool
    n_layers: int
    error: float
    lost: int

    def __post_init__(self) -> None:
        for name, dtype, shape in (
            ("xy", self.xy.dtype.type, (-1, 2)),
            ("ring_start", np.int64, (-1,)),
            ("ring_layer", np.int64, (-1,)),
            ("outer", np.bool_, (-1,)),
        ):
            force_setattr(self, name, frozen_array(getattr(self, name), dtype, shape))

    def layers(self) -> Iterator[range]:
        """Yield the ring indices of each layer, from the bed up."""
        first = np.searchsorted(self.ring_layer, np.arange(self.n_layers + 1)).tolist()
        return (range(begin, end) for begin, end in pairwise(first))

    def close_rings(self) -> tuple[NDArray[Any], list[int]]:
        """Return the points of all rings, each with its first point repeated at the end, and their offsets (R + 1,)."""
        sizes = np.diff(self.ring_start) + 1
        index = consecutive(self.ring_start[:-1], sizes)
        start = np.concatenate([[0], np.cumsum(sizes)])
        index[start[1:] - 1] = self.ring_start[:-1]
        return self.xy[index], start.tolist()

    def find_longest_edge(self) -> float:
        """Return the largest distance between neighbouring points, in the unit of `xy`; 0 without points."""
        xy, start = self.close_rings()
        length = np.hypot(*np.diff(xy.astype(np.float64), axis=0).T)
        length[np.array(start[1:-1], dtype=np.int64) - 1] = 0.0  # from the end of a ring to the next one
        return float(length.max(initial=0.0))


def round_to_grid(areas: Areas, units: float) -> RoundedRings:
    """Round areas to whole multiples of `units` mm; coordinates change by at most half a unit."""
    grid = np.rint(areas.xy / units)
    return _build_rounded_rings(
        areas, grid.astype(np.int64), float(np.abs(grid * units - areas.xy).max(initial=0.0))
    )


def round_to_float32(areas: Areas) -> RoundedRings:
    """Round areas to 32-bit floats, mm; coordinates change by at most 0.000 004 mm up to 128 mm from the origin."""
    single = areas.xy.astype(np.float32)
    return _build_rounded_rings(areas, single, float(np.abs(single - areas.xy).max(initial=0.0)))


def _build_rounded_rings(areas: Areas, values: NDArray[Any], error: float) -> RoundedRings:
    """Build the rounded rings of areas from the rounded coordinates `values` (N, 2)."""
    sizes = np.diff(areas.ring_start)
    differs = (values != values[areas.following]).any(axis=1) if len(values) else np.zeros(0, np.bool_)
    before = np.concatenate([[0], np.cumsum(differs)])
    count = before[areas.ring_start[1:]] - before[areas.ring_start[:-1]]
    moved = Areas(values.astype(np.float64), areas.ring_start, areas.ring_layer, areas.n_layers)
    sign = np.sign(moved.ring_area())
    good = (count >= 3) & (sign != 0) & (sign == np.sign(areas.ring_area()))
    return RoundedRings(
        xy=values[differs & np.repeat(good, sizes)],
        ring_start=np.concatenate([[0], np.cumsum(count[good])]),
        ring_layer=areas.ring_layer[good],
        outer=sign[good] > 0,
        n_layers=areas.n_layers,
        error=error,
        lost=int((~good).sum()),
    )
