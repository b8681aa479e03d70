"""Order units island by island: visit the nearest unit next, then shorten the tour."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import groupby

import numpy as np

from printer_slicer.arrays import Bool, Float, Int
from printer_slicer.ordering.tour_improvement import shorten_tour
from printer_slicer.ordering.units import Units

__all__ = ["route_units"]

_MAX_UNITS = 20_000  # units; nearest neighbour is quadratic, and takes minutes for more


def route_units(units: Units) -> tuple[Int, Bool]:
    """Return the units (U,) in printing order, and which of them (U,) are reversed."""
    sequence, is_reversed = _order_by_nearest(units)
    sequence, is_reversed = _reorder_islands(units, sequence, is_reversed)
    step = _number_runs(units.layer[sequence], units.island[sequence], units.step[sequence])
    return _shorten_within_groups(units, sequence, is_reversed, step)


def _number_runs(*columns: Int) -> Int:
    """Return for each item the number of its run of consecutive items with equal values in all columns."""
    new = np.zeros(len(columns[0]), np.bool_)
    for column in columns:
        new[1:] |= np.diff(column) != 0
    return np.cumsum(new)


def _find_entries_and_exits(units: Units, sequence: Int, is_reversed: Bool) -> tuple[Float, Float]:
    """Return the points (U, 2) at which the nozzle enters and leaves each unit of a sequence, mm."""
    start, end = units.begin[sequence], units.end[sequence]
    return np.where(is_reversed[:, None], end, start), np.where(is_reversed[:, None], start, end)


def _shorten_within_groups(units: Units, sequence: Int, is_reversed: Bool, group: Int) -> tuple[Int, Bool]:
    """Shorten the tour by moving units within their groups."""
    begin, end = _find_entries_and_exits(units, sequence, is_reversed)
    order, around = shorten_tour(begin, end, units.free[sequence], group)
    return sequence[order], is_reversed[order] ^ around


def _reorder_islands(units: Units, sequence: Int, is_reversed: Bool) -> tuple[Int, Bool]:
    """Reorder the islands of each layer for a shorter tour; the order within islands is kept."""
    island = _number_runs(units.layer[sequence], units.island[sequence])
    first = np.flatnonzero(np.diff(island, prepend=-1))
    last = np.append(first[1:], len(sequence)) - 1
    begin, end = _find_entries_and_exits(units, sequence, is_reversed)
    around = units.island[sequence][first] < 0
    group = np.cumsum(
        (np.diff(units.layer[sequence][first], prepend=-1) != 0) | around | np.append(False, around[:-1])
    )
    order, _ = shorten_tour(begin[first], end[last], np.zeros(len(first), np.bool_), group)
    size = (last + 1 - first)[order]
    moved = np.arange(len(sequence)) - np.repeat(np.cumsum(size) - size - first[order], size)
    return sequence[moved], is_reversed[moved]


def _order_by_nearest(units: Units) -> tuple[Int, Bool]:
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
        for place in nozzle.sort_islands(islands):
            for first, last in islands[place]:
                nozzle.visit(first, last)
    return np.array(nozzle.sequence, np.int64), np.array(nozzle.is_reversed, np.bool_)


class _Nozzle:
    """The position of the nozzle, and the units it has visited."""

    def __init__(self, units: Units) -> None:
        self.sequence: list[int] = []
        self.is_reversed: list[bool] = []
        self._units = units
        self._x, self._y = 0.0, 0.0
        # A unit that cannot be reversed cannot be entered at its end.
        self._end = np.where(units.free[:, None], units.end, np.inf)

    def visit(self, first: int, last: int) -> None:
        """Visit the units from `first` up to `last` by nearest neighbour."""
        n = last - first
        if n == 1 or n > _MAX_UNITS:
            for unit in range(first, last):
                self._visit_unit(unit)
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
            self.sequence.append(first + chosen)
            self.is_reversed.append(nearest >= n)
            self._x, self._y = out_x[nearest], out_y[nearest]
            x[chosen] = x[chosen + n] = np.inf

    def _visit_unit(self, unit: int) -> None:
        """Visit one unit, from its nearer end if it may be reversed."""
        units = self._units
        (bx, by), (ex, ey) = units.begin[unit].tolist(), units.end[unit].tolist()
        to_begin, to_end = (
            (bx - self._x) ** 2 + (by - self._y) ** 2,
            (ex - self._x) ** 2 + (ey - self._y) ** 2,
        )
        is_reversed = bool(units.free[unit]) and to_end < to_begin
        self.sequence.append(unit)
        self.is_reversed.append(is_reversed)
        self._x, self._y = (bx, by) if is_reversed else (ex, ey)

    def sort_islands(self, islands: dict[int, list[tuple[int, int]]]) -> Iterator[int]:
        """Yield the islands of one layer in visiting order: always the island that starts nearest to the nozzle."""
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
