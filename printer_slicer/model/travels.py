"""Travel moves between paths."""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, frozen_array
from printer_slicer.deprecation import renamed_attribute
from printer_slicer.model.paths import Toolpaths
from printer_slicer.values import Struct, force_setattr

__all__ = ["Travels", "find_travel_ends"]


class Travels(Struct, frozen=True, eq=False):
    """Travel moves in printing order: travel `i` leads from the end of path `i - 1` to the start of path `i`.

    Attributes:
        xy: (P, 2) mm, waypoints of all travels, without start and end points.
        start: (M + 1,) travel `i` has the waypoints `xy[start[i]:start[i + 1]]`; there may be none.
        retract: (M,) whether filament is retracted for the travel; never for the first.
        crossings: (M,) how often the travel crosses outlines of its layer's section; 0 for the first.
    """

    xy: Float
    start: Int
    retract: Bool
    crossings: Int

    def __post_init__(self) -> None:
        n_ways = len(self.retract)
        for name, dtype, shape in (
            ("xy", np.float64, (-1, 2)),
            ("start", np.int64, (n_ways + 1,)),
            ("retract", np.bool_, (n_ways,)),
            ("crossings", np.int64, (n_ways,)),
        ):
            force_setattr(self, name, frozen_array(getattr(self, name), dtype, shape))

    def __repr__(self) -> str:
        crossing = int((self.crossings > 0).sum())
        return f"<Travels: {self.n_travels} travels, {int(self.retract.sum())} retract, {crossing} cross outlines>"

    @classmethod
    def straight(cls, retract: Bool, crossings: Int) -> Travels:
        """Build travels (M,) without waypoints."""
        return cls(np.zeros((0, 2)), np.zeros(len(retract) + 1, np.int64), retract, crossings)

    @property
    def n_travels(self) -> int:
        """Number of travels, equal to the number of paths."""
        return len(self.retract)

    n_ways = renamed_attribute("Travels.n_ways", "Travels.n_travels")


def find_travel_ends(paths: Toolpaths) -> tuple[Float, Float]:
    """Return the start and end points, (M, 2) each, of the travel to each path; the first travel starts at (0, 0)."""
    start = paths.xy[paths.start[:-1]]
    end = np.where(paths.closed[:, None], start, paths.xy[paths.start[1:] - 1])
    return np.concatenate([np.zeros((1, 2)), end])[:-1], start
