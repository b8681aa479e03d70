"""Stretches of paths: where areas hold them, and cut out of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from printer_slicer.arrays import Float, Int, consecutive, frozen_array, run_begins
from printer_slicer.geometry import Areas, Polylines
from printer_slicer.geometry.clipping import spans
from printer_slicer.model import Toolpaths

__all__ = ["Spans", "cut", "opened", "runs", "spans_between", "spans_within"]

_NOTHING = 1e-6  # mm


@dataclass(frozen=True, slots=True, eq=False)
class Spans:
    """Stretches of paths.

    Attributes:
        path: (S,) ascending.
        begin: (S,) mm along the path, ascending within a path.
        end: (S,) mm; beyond the length of a closed path where the stretch goes on from its first point.
    """

    path: Int
    begin: Float
    end: Float

    def __post_init__(self) -> None:
        n = len(self.path)
        for name, dtype in (("path", np.int64), ("begin", np.float64), ("end", np.float64)):
            object.__setattr__(self, name, frozen_array(getattr(self, name), dtype, (n,)))

    def take(self, chosen: Int) -> Spans:
        """Some of them, by their indices."""
        return Spans(self.path[chosen], self.begin[chosen], self.end[chosen])


def opened(paths: Toolpaths, rounds: int = 1) -> tuple[Int, Int]:
    """(K,) the points of the paths one after the other, and (M + 1,) where each begins; loops end where they began.

    Loops are gone around as often as `rounds` says.
    """
    size = np.diff(paths.start)
    count = np.where(paths.closed, rounds * size + 1, size)
    step = consecutive(np.zeros(paths.n_paths, np.int64), count)
    first = np.repeat(paths.start[:-1], count)
    return first + step % np.repeat(size, count), np.append(0, np.cumsum(count))


def runs(paths: Toolpaths) -> tuple[Float, Int, Int]:
    """What is fully carried of the paths: points (N, 2), where each run begins (R + 1,), its layer (R,)."""
    point, start = opened(paths)
    owner = np.repeat(np.arange(paths.n_paths), np.diff(start))
    laid = np.append(np.diff(owner) == 0, False)
    laid &= paths.carried[point] >= 1
    first = np.flatnonzero(laid & ~np.append(False, laid[:-1]))
    last = np.flatnonzero(laid & ~np.append(laid[1:], False))
    size = last - first + 2
    chosen = point[consecutive(first, size)]
    return paths.xy.take(chosen, axis=0), np.append(0, np.cumsum(size)), paths.layer[owner[first]]


def spans_within(paths: Toolpaths, areas: Areas, shortest: float) -> Spans:
    """What of the paths lies in the areas of their layers, in stretches of at least `shortest` mm."""
    point, start = opened(paths)
    lines = Polylines.of(paths.xy.take(point, axis=0), np.diff(start), paths.layer)
    path, begin, end = spans(areas, lines)
    order = np.argsort(path, kind="stable")
    path, begin, end = path[order], begin[order], end[order]
    long = paths.length()
    new = run_begins(path)
    first = np.flatnonzero(new & paths.closed[path] & (begin <= _NOTHING))
    last = np.searchsorted(path, path[first], side="right") - 1
    goes_on = (end[last] >= long[path[last]] - _NOTHING) & (last > first)
    first, last = first[goes_on], last[goes_on]
    end[last] = long[path[last]] + end[first]
    kept = end - begin >= shortest
    kept[first] = False
    return Spans(path, begin, end).take(np.flatnonzero(kept))


def spans_between(paths: Toolpaths, inside: Spans) -> Spans:
    """What is left of the paths that have stretches cut out of them."""
    long = paths.length()
    path, low, high = inside.path, inside.begin, inside.end
    is_first = run_begins(path)
    is_last = np.append(np.diff(path) != 0, True)[: len(path)]
    first, last = np.flatnonzero(is_first), np.flatnonzero(is_last)
    around = paths.closed[path[first]]
    # From the end of each stretch to the beginning of the next one, of a loop's last one to that of the first.
    following = np.append(low[1:], 0.0)[: len(path)]
    following[last] = long[path[last]] + np.where(around, low[first], 0.0)
    before = first[~around]
    path = np.concatenate([path, path[before]])
    begin = np.concatenate([high, np.zeros(len(before))])
    end = np.concatenate([following, low[before]])
    order = np.lexsort((begin, path))
    order = order[(end - begin)[order] > _NOTHING]
    return Spans(path[order], begin[order], end[order])


def cut(paths: Toolpaths, stretches: Spans) -> Toolpaths:
    """Paths of their own of some stretches, with the widths and the shares carried that they have there.

    A stretch that is all of a loop stays closed.
    """
    if not len(stretches.path):
        return paths.take(np.zeros(0, np.int64))
    point, start = opened(paths, 2)
    xy = paths.xy.take(point, axis=0)
    step = np.hypot(*np.diff(xy, axis=0, append=xy[-1:]).T)
    step[start[1:] - 1] = 1.0  # from path to path, so that distances ascend
    reached = np.cumsum(step) - step
    once = np.diff(paths.start) - ~paths.closed
    long = reached[start[:-1] + once] - reached[start[:-1]]
    origin = reached[start[:-1]][stretches.path]
    whole = paths.closed[stretches.path] & (
        stretches.end - stretches.begin >= long[stretches.path] - _NOTHING
    )
    low, high = origin + stretches.begin, origin + stretches.end
    first = np.searchsorted(reached, low + _NOTHING)
    inner = np.maximum(np.searchsorted(reached, high - _NOTHING) - first, 0)
    size = inner + 2 - whole
    begins = np.cumsum(size) - size
    place = np.zeros(int(size.sum()))
    place[begins] = low
    place[consecutive(begins + 1, inner)] = reached[consecutive(first, inner)]
    place[(begins + size - 1)[~whole]] = high[~whole]
    segment = np.searchsorted(reached, place + _NOTHING, side="right") - 1
    layer, columns = paths.layer[stretches.path], (*xy.T, paths.width[point])
    x, y, width = (np.interp(place, reached, column) for column in columns)
    return Toolpaths.gathered(
        paths.plan,
        xy=np.column_stack([x, y]),
        size=size,
        layer=layer,
        role=paths.role[stretches.path],
        width=width,
        closed=whole,
        height=paths.height[stretches.path],
        carried=paths.carried[point[segment]],
    )
