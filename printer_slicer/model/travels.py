"""How the nozzle gets from path to path."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, frozen_array
from printer_slicer.model.paths import Toolpaths

__all__ = ["Travels", "leaves"]


@dataclass(frozen=True, slots=True, eq=False)
class Travels:
    """Ways to paths in printing order: way `i` leads from where path `i - 1` ends to where path `i` begins.

    Attributes:
        xy: (P, 2) mm, what the nozzle passes, without the ends of the ways.
        start: (M + 1,) way `i` passes the points `xy[start[i]:start[i + 1]]`, which may be none.
        retract: (M,) whether the filament is pulled back on the way; never on the first one.
        crossings: (M,) how often the way crosses outlines of its layer's section; none counts for the first one.
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
            object.__setattr__(self, name, frozen_array(getattr(self, name), dtype, shape))

    def __repr__(self) -> str:
        crossing = int((self.crossings > 0).sum())
        return f"<Travels: {self.n_ways} ways, {int(self.retract.sum())} retract, {crossing} cross outlines>"

    @classmethod
    def straight(cls, retract: Bool, crossings: Int) -> Travels:
        """Ways (M,) that pass nothing."""
        return cls(np.zeros((0, 2)), np.zeros(len(retract) + 1, np.int64), retract, crossings)

    @property
    def n_ways(self) -> int:
        """Number of ways, as many as there are paths."""
        return len(self.retract)


def leaves(paths: Toolpaths) -> tuple[Float, Float]:
    """Where the way to each path begins and ends, (M, 2) both; the first one begins at 0, 0."""
    begin = paths.xy[paths.start[:-1]]
    end = np.where(paths.closed[:, None], begin, paths.xy[paths.start[1:] - 1])
    return np.concatenate([np.zeros((1, 2)), end])[:-1], begin
