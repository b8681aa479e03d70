"""Order units island by island, by nearest neighbour, then shorten the tour."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import groupby

import numpy as np

from printer_slicer.arrays import Bool, Float, Int
from printer_slicer.ordering.tour_improvement import shorten_tour
from printer_slicer.ordering.units import Units

__all__ = ["route_units"]

_SMALL_CHOICE = 20_000  # units; nearest neighbour is quadratic, and takes minutes for more


def route_units(units: Units) -> tuple[Int, Bool]:
    """Return the units in printing order, and which of these are reversed, (U,) each."""
    taken, turned = _nearest_first(units)
    taken, turned = _reorder_islands(units, taken, turned)
    step = _number_runs(units.layer[taken], units.island[taken], units.step[taken])
    return _shorten(units, taken, turned, step)


def _number_runs(*columns: Int) -> Int:
    """Return the number of the run of equal values that each item is in."""
    new = np.zeros(len(columns[0]), np.bool_)
    for column in columns:
        new[1:] |= np.diff(column) != 0
    return np.cumsum(new)


def _entry_and_exit(units: Units, taken: Int, turned: Bool) -> tuple[Float, Float]:
    start, end = units.begin[taken], units.end[taken]
    return np.where(turned[:, None], end, start), np.where(turned[:, None], start, end)


def _shorten(units: Units, taken: Int, turned: Bool, group: Int) -> tuple[Int, Bool]:
    """Shorten the tour by moving units within their groups."""
    begin, end = _entry_and_exit(units, taken, turned)
    order, around = shorten_tour(begin, end, units.free[taken], group)
    return taken[order], turned[order] ^ around


def _reorder_islands(units: Units, taken: Int, turned: Bool) -> tuple[Int, Bool]:
    """Reorder the islands of each layer for a shorter tour; the order within islands is kept."""
    island = _number_runs(units.layer[taken], units.island[taken])
    first = np.flatnonzero(np.diff(island, prepend=-1))
    last = np.append(first[1:], len(taken)) - 1
    begin, end = _entry_and_exit(units, taken, turned)
    around = units.island[taken][first] < 0
    group = np.cumsum(
        (np.diff(units.layer[taken][first], prepend=-1) != 0) | around | np.append(False, around[:-1])
    )
    order, _ = shorten_tour(begin[first], end[last], np.zeros(len(first), np.bool_), group)
    size = (last + 1 - first)[order]
    moved = np.arange(len(taken)) - np.repeat(np.cumsum(size) - size - first[order], size)
    return taken[moved], turned[moved]


def _nearest_first(units: Units) -> tuple[Int, Bool]:
    """Order units by nearest neighbour, island by island and step by step."""
    nozzle = _Nozzle(units)
    key = np.stack([units.layer, units.island, units.step])
    starts = np.flatnonzero(np.append(True, (np.diff(key, axis=1) != 0).any(axis=0)))
    groups = zip(
        key[0, starts].tolist(),
        key[1, starts].tolist(),
        zip(starts.tolist(), [*starts[1:].tolist(), units.n_units], strict=True),
        strict=True,
    )
    for _, same_layer in groupby(groups, key=lambda entry: entry[0]):
        islands: dict[int, list[tuple[int, int]]] = {}
        for _, place, group in same_layer:
            islands.setdefault(place, []).append(group)
        for first, last in islands.pop(-1, []):
            nozzle.visit(first, last)
        for place in nozzle.nearest_islands(islands):
            for first, last in islands[place]:
                nozzle.visit(first, last)
    return np.array(nozzle.taken, np.int64), np.array(nozzle.turned, np.bool_)


class _Nozzle:
    """The position of the nozzle, and the units it has visited."""

    def __init__(self, units: Units) -> None:
        self.taken: list[int] = []
        self.turned: list[bool] = []
        self._units = units
        self._x, self._y = 0.0, 0.0
        # A unit that cannot be reversed cannot be entered at its end.
        self._end = np.where(units.free[:, None], units.end, np.inf)

    def visit(self, first: int, last: int) -> None:
        """Visit the units from `first` up to `last` by nearest neighbour."""
        n = last - first
        if n == 1 or n > _SMALL_CHOICE:
            for unit in range(first, last):
                self._take_alone(unit)
            return
        units = self._units
        x, y = np.ascontiguousarray(np.concatenate([units.begin[first:last], self._end[first:last]]).T)
        out_x, out_y = np.concatenate([units.end[first:last], units.begin[first:last]]).T.tolist()
        for _ in range(n):
            gap, gap_y = x - self._x, y - self._y
            gap *= gap
            gap_y *= gap_y
            gap += gap_y
            nearest = int(gap.argmin())
            chosen = nearest % n
            self.taken.append(first + chosen)
            self.turned.append(nearest >= n)
            self._x, self._y = out_x[nearest], out_y[nearest]
            x[chosen] = x[chosen + n] = np.inf

    def _take_alone(self, unit: int) -> None:
        units = self._units
        (bx, by), (ex, ey) = units.begin[unit].tolist(), units.end[unit].tolist()
        to_begin, to_end = (
            (bx - self._x) ** 2 + (by - self._y) ** 2,
            (ex - self._x) ** 2 + (ey - self._y) ** 2,
        )
        turned = bool(units.free[unit]) and to_end < to_begin
        self.taken.append(unit)
        self.turned.append(turned)
        self._x, self._y = (bx, by) if turned else (ex, ey)

    def nearest_islands(self, islands: dict[int, list[tuple[int, int]]]) -> Iterator[int]:
        """Yield the islands of one layer, each time the one that starts nearest to the nozzle."""
        if len(islands) < 2:
            yield from islands
            return
        places = list(islands)
        # The units of the first step of each island.
        heads = [islands[place][0] for place in places]
        begin = np.concatenate([self._units.begin[first:last] for first, last in heads])
        size = np.array([last - first for first, last in heads])
        owner, first = np.repeat(np.arange(len(places)), size), np.cumsum(size) - size
        for _ in places:
            gap = begin - (self._x, self._y)
            nearest = int(owner[np.argmin(gap[:, 0] * gap[:, 0] + gap[:, 1] * gap[:, 1])])
            begin[first[nearest] : first[nearest] + size[nearest]] = np.inf
            yield places[nearest]
