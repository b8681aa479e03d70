"""Shorten a tour of units with two ends by local changes: reversing sequences and moving single units.

Source: Croes 1958, "A method for solving traveling-salesman problems" (2-opt); Or 1976 (Or-opt). The units of all
layers form one row. All changes within a limited reach are evaluated at once, and the best non-overlapping ones are
applied together.
"""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, consecutive, distinct
from printer_slicer.values import Struct

__all__ = ["shorten_tour"]

_MAX_SPAN = 24
_MIN_SAVING = 0.01  # mm that a change must save
_MAX_ROUNDS = 60
_BLOCK_SIZE = 1 << 12  # places evaluated at once
_REVERSE, _MOVE_LATER, _MOVE_LATER_REVERSED, _MOVE_EARLIER, _MOVE_EARLIER_REVERSED = range(5)


def shorten_tour(begin: Float, end: Float, free: Bool, group: Int) -> tuple[Int, Bool]:
    """Reverse units and move them within their group to shorten the travels of a tour.

    Args:
        begin: (U, 2) mm, start of each unit, in the current order.
        end: (U, 2) mm, end of each unit.
        free: (U,) which units may be reversed.
        group: (U,) ascending; units stay within their group.

    Returns:
        (U,) the units in their new order, and (U,) which of these are reversed.
    """
    tour = _Tour(
        np.arange(len(begin)),
        np.zeros(len(begin), np.bool_),
        _pad_with_dummies(begin),
        _pad_with_dummies(end),
        free,
        group,
    )
    # A unit alone in its group can only be reversed.
    alone = np.bincount(group, minlength=1)[group] == 1 if len(group) else np.zeros(0, np.bool_)
    active = np.flatnonzero(~alone | free)
    last = np.searchsorted(group, group, side="right") - 1
    for _ in range(_MAX_ROUNDS):
        if not len(active):
            break
        # Sort by the number of places ahead, because the arrays of a block are as wide as its widest one.
        active = active[np.argsort(np.minimum(last[active] - active, _MAX_SPAN), kind="stable")]
        changes = [
            _find_best_changes(tour, active[first : first + _BLOCK_SIZE])
            for first in range(0, len(active), _BLOCK_SIZE)
        ]
        place, span, kind, saved = (np.concatenate(column) for column in zip(*changes, strict=True))
        chosen = _select_changes(place, span, saved, len(group))
        if not len(chosen):
            break
        tour = tour.apply_changes(place[chosen], span[chosen], kind[chosen])
        active = _find_nearby_places(place[chosen], span[chosen], group)
    return tour.unit, tour.is_reversed


def _pad_with_dummies(points: Float) -> Float:
    """Add a dummy point (nan) before the first and after the last point; travels to a dummy have length 0."""
    nowhere = np.full((1, 2), np.nan)
    return np.concatenate([nowhere, points, nowhere])


class _Tour(Struct, frozen=True, eq=False):
    """A tour: units in their current order; `begin` and `end` have a dummy point on each side."""

    unit: Int
    is_reversed: Bool
    begin: Float
    end: Float
    free: Bool
    group: Int

    def apply_changes(self, place: Int, span: Int, kind: Int) -> _Tour:
        """Apply changes of `kind` (C,) from `place` (C,) over `span` (C,) more places."""
        source, turn = np.arange(len(self.unit)), np.zeros(len(self.unit), np.bool_)
        for i, k, what in zip(place.tolist(), span.tolist(), kind.tolist(), strict=True):
            j = i + k
            if what == _REVERSE:
                source[i : j + 1] = source[i : j + 1][::-1].copy()
                turn[i : j + 1] = True
            elif what <= _MOVE_LATER_REVERSED:
                source[i : j + 1] = np.roll(source[i : j + 1], -1)
                turn[j] = what == _MOVE_LATER_REVERSED
            else:
                source[i : j + 1] = np.roll(source[i : j + 1], 1)
                turn[i] = what == _MOVE_EARLIER_REVERSED
        begin, end = self.begin[1:-1][source], self.end[1:-1][source]
        return _Tour(
            self.unit[source],
            self.is_reversed[source] ^ turn,
            _pad_with_dummies(np.where(turn[:, None], end, begin)),
            _pad_with_dummies(np.where(turn[:, None], begin, end)),
            self.free[source],
            self.group,
        )


def _find_best_changes(tour: _Tour, place: Int) -> tuple[Int, Int, Int, Float]:
    """Return the best change at each place (A,): place, span, kind, and mm of travel saved."""
    n, reach = len(tour.group), min(_MAX_SPAN, len(tour.group))
    # The arrays are only as wide as the largest group needs.
    last = np.searchsorted(tour.group, tour.group[place], side="right") - 1
    width = int(min(reach, (last - place).max(initial=0) + 1))
    ahead = place[:, None] + np.arange(width)
    within = ahead <= last[:, None]
    j = np.minimum(ahead, n - 1)
    turns = np.cumsum(tour.free[j], axis=1) == np.arange(1, width + 1)
    saved = np.stack(_compute_savings(tour, place[:, None], j))
    moves = within & (np.arange(width) > 0)
    first_free, last_free = tour.free[place][:, None], tour.free[j]
    allowed = np.stack([within & turns, moves, moves & first_free, moves, moves & last_free])
    saved = np.where(allowed, saved, -1.0).transpose(1, 0, 2).reshape(len(place), -1)
    best = saved.argmax(axis=1)
    return place, best % width, best // width, saved[np.arange(len(place)), best]


def _compute_savings(tour: _Tour, i: Int, j: Int) -> list[Float]:
    """Return for each kind of change from places `i` (A, 1) to `j` (A, W) the travel that it saves, mm."""
    i, j = i + 1, j + 1  # indices in the padded arrays
    bx, by, ex, ey = (np.ascontiguousarray(column) for of in (tour.begin, tour.end) for column in of.T)
    b_i, e_i, b_j, e_j = ((x[at], y[at]) for at in (i, j) for x, y in ((bx, by), (ex, ey)))
    before_i, after_j = (ex[i - 1], ey[i - 1]), (bx[j + 1], by[j + 1])
    hop = _distances((ex[:-1], ey[:-1]), (bx[1:], by[1:]))  # into the unit after each
    over = _distances((ex[:-2], ey[:-2]), (bx[2:], by[2:]))  # past the unit after each
    into_i, out_of_j, from_j_to_i = hop[i - 1], hop[j], _distances(e_j, b_i)
    across, around = _distances(before_i, e_j), _distances(b_i, after_j)
    without_i = into_i + hop[i] - over[i - 1] + out_of_j
    without_j = hop[j - 1] + out_of_j - over[j - 1] + into_i
    return [
        into_i + out_of_j - across - around,
        without_i - from_j_to_i - _distances(e_i, after_j),
        without_i - _distances(e_j, e_i) - around,
        without_j - _distances(before_i, b_j) - from_j_to_i,
        without_j - across - _distances(b_j, b_i),
    ]


def _distances(one: tuple[Float, Float], other: tuple[Float, Float]) -> Float:
    """Return distances between points, mm; 0 to dummy points."""
    x, y = one[0] - other[0], one[1] - other[1]
    x *= x
    y *= y
    x += y
    return np.asarray(np.nan_to_num(np.sqrt(x, out=x), copy=False, nan=0.0))


def _select_changes(place: Int, span: Int, saved: Float, n: int) -> Int:
    """Select changes that shorten the tour and do not overlap, the best first."""
    better = np.flatnonzero(saved > _MIN_SAVING)
    better = better[np.argsort(-saved[better], kind="stable")]
    taken = bytearray(n + 2)
    chosen = []
    for change, i, j in zip(
        better.tolist(), place[better].tolist(), (place + span)[better].tolist(), strict=True
    ):
        if not any(taken[i : j + 3]):
            taken[i : j + 3] = b"\1" * (j + 3 - i)
            chosen.append(change)
    return np.array(chosen, np.int64)


def _find_nearby_places(place: Int, span: Int, group: Int) -> Int:
    """Return the places near these changes, where possible changes must be evaluated again."""
    first = np.maximum(place - _MAX_SPAN, 0)
    last = np.minimum(place + span + 2, len(group))
    near = consecutive(first, last - first)
    # A change affects the units of its group, and the units right before and after it.
    owner = np.repeat(np.arange(len(place)), last - first)
    beside = (near >= place[owner] - 1) | (group[near] == group[place[owner]])
    return distinct(near[beside])
