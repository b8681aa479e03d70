"""The lines of paths, and stretches of them that grow by joining neighbours, all over the stack at once."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, run_begins
from printer_slicer.model import Toolpaths

__all__ = ["Fits", "PathLines", "stretches"]

_SAME_WIDTH = 0.002  # mm
_ROUNDS = 40

Fits = Callable[[Int, Int], Bool]
"""Whether stretches of lines, from `first` (T,) up to `stop` (T,), may be one."""


@dataclass(frozen=True, slots=True, eq=False)
class PathLines:
    """The lines of all paths.

    Attributes:
        begin: (S,) point at which each begins.
        end: (S,) point at which it ends.
        xy: (S, 2) mm, of its begin.
        way: (S, 2) mm.
        apart: (S,) whether it cannot be one arc with the line before it.
    """

    begin: Int
    end: Int
    xy: Float
    way: Float
    apart: Bool

    @classmethod
    def of(cls, paths: Toolpaths) -> PathLines:
        """Path by path; loops end with the line to their first point."""
        begin, end = paths.ends_of_beads
        owner = np.repeat(np.arange(paths.n_paths), paths.beads_of_each)
        way = paths.xy[end] - paths.xy[begin]
        even = np.abs(paths.width[end] - paths.width[begin]) < _SAME_WIDTH
        flat = (paths.rise[begin] == paths.rise[end]) & (paths.share[begin] == paths.share[end])
        plain = even & flat
        apart = run_begins(owner)
        apart |= ~plain | ~np.append(False, plain[:-1])
        apart[1:] |= (paths.carried[begin[1:]] != paths.carried[begin[:-1]]) | (
            np.abs(paths.width[begin[1:]] - paths.width[begin[:-1]]) > _SAME_WIDTH
        )
        return cls(begin, end, paths.xy[begin], way, apart)


def stretches(line: PathLines, fits: Fits) -> tuple[Int, Int]:
    """All lines in stretches (T,), from `first` up to `stop`, none of which can be joined with the next one."""
    first = np.arange(len(line.begin))
    stop = first + 1
    idle = 0  # rounds in which nothing was joined
    for turn in range(_ROUNDS):
        first, stop, joined = _joined(line, first, stop, fits, odd=turn % 2 == 1)
        idle = 0 if joined else idle + 1
        if idle == 2:
            break
    return first, stop


def _joined(line: PathLines, first: Int, stop: Int, fits: Fits, *, odd: bool) -> tuple[Int, Int, bool]:
    """Stretches of lines (T,), some of them joined with the next one; and whether any were.

    Of each two neighbours one is asked, every other time the other one.
    """
    may = np.flatnonzero(np.append(~line.apart[first[1:]], False))
    run = np.cumsum(np.append(True, np.diff(may) > 1)) if len(may) else may
    begins = np.flatnonzero(np.append(True, np.diff(run) != 0)) if len(may) else may
    within = np.arange(len(may)) - begins[run - 1] if len(may) else may
    asked = may[within % 2 == int(odd)]
    if not len(asked):
        return first, stop, False
    good = asked[fits(first[asked], stop[asked + 1])]
    kept = np.ones(len(first), np.bool_)
    kept[good + 1] = False
    stop = stop.copy()
    stop[good] = stop[good + 1]
    return first[kept], stop[kept], len(good) > 0
