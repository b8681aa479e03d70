"""Shorter ways: units that are visited one after the other change places or are turned around.

Source: Croes 1958, "A method for solving traveling-salesman problems" (2-opt); Or 1976 (Or-opt), for units with two
ends. All units of all layers stand in one row; what is tried are changes within some places of the row, all of them at
once, and the best of those that do not touch each other are made together.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, consecutive, distinct

__all__ = ["shorten_tour"]

_REACH = 24
_LEAST = 0.01  # mm that a change must save
_ROUNDS = 60
_AT_ONCE = 1 << 12  # rows whose changes are compared at once
_TURN, _LATER, _LATER_TURNED, _EARLIER, _EARLIER_TURNED = range(5)


def shorten_tour(begin: Float, end: Float, free: Bool, group: Int) -> tuple[Int, Bool]:
    """A shorter order of units that are visited in a row.

    Args:
        begin: (U, 2) mm, where each begins, in the order in which they are visited now.
        end: (U, 2) where each ends.
        free: (U,) which may be turned around.
        group: (U,) ascending; units only change places with those of their group.

    Returns:
        (U,) the units in their new order, and which of these (U,) are turned around.
    """
    row = _Row(np.arange(len(begin)), np.zeros(len(begin), np.bool_), _pad(begin), _pad(end), free, group)
    # One of a kind can do no more than turn around.
    alone = np.bincount(group, minlength=1)[group] == 1 if len(group) else np.zeros(0, np.bool_)
    active = np.flatnonzero(~alone | free)
    last = np.searchsorted(group, group, side="right") - 1
    for _ in range(_ROUNDS):
        if not len(active):
            break
        # Those with few places before them side by side: what is compared is as wide as the widest asks for.
        active = active[np.argsort(np.minimum(last[active] - active, _REACH), kind="stable")]
        changes = [
            _best_changes(row, active[first : first + _AT_ONCE]) for first in range(0, len(active), _AT_ONCE)
        ]
        place, span, kind, saved = (np.concatenate(column) for column in zip(*changes, strict=True))
        chosen = _select_changes(place, span, saved, len(group))
        if not len(chosen):
            break
        row = row.changed(place[chosen], span[chosen], kind[chosen])
        active = _nearby_places(place[chosen], span[chosen], group)
    return row.unit, row.turned


def _pad(points: Float) -> Float:
    """With one more before the first and one after the last, to which no way leads: it is nowhere."""
    nowhere = np.full((1, 2), np.nan)
    return np.concatenate([nowhere, points, nowhere])


@dataclass(frozen=True, slots=True, eq=False)
class _Row:
    """Units as they stand; of begin and end, one more at each side."""

    unit: Int
    turned: Bool
    begin: Float
    end: Float
    free: Bool
    group: Int

    def changed(self, place: Int, span: Int, kind: Int) -> _Row:
        """The row after changes of `kind` (C,) from `place` (C,) over `span` (C,) more places."""
        source, turn = np.arange(len(self.unit)), np.zeros(len(self.unit), np.bool_)
        for i, k, what in zip(place.tolist(), span.tolist(), kind.tolist(), strict=True):
            j = i + k
            if what == _TURN:
                source[i : j + 1] = source[i : j + 1][::-1].copy()
                turn[i : j + 1] = True
            elif what <= _LATER_TURNED:
                source[i : j + 1] = np.roll(source[i : j + 1], -1)
                turn[j] = what == _LATER_TURNED
            else:
                source[i : j + 1] = np.roll(source[i : j + 1], 1)
                turn[i] = what == _EARLIER_TURNED
        begin, end = self.begin[1:-1][source], self.end[1:-1][source]
        return _Row(
            self.unit[source],
            self.turned[source] ^ turn,
            _pad(np.where(turn[:, None], end, begin)),
            _pad(np.where(turn[:, None], begin, end)),
            self.free[source],
            self.group,
        )


def _best_changes(row: _Row, place: Int) -> tuple[Int, Int, Int, Float]:
    """The change that saves most from each place (A,) on: the place, how far it reaches, its kind, mm saved."""
    n, reach = len(row.group), min(_REACH, len(row.group))
    # Only as wide as the largest group asks for.
    last = np.searchsorted(row.group, row.group[place], side="right") - 1
    width = int(min(reach, (last - place).max(initial=0) + 1))
    ahead = place[:, None] + np.arange(width)
    within = ahead <= last[:, None]
    j = np.minimum(ahead, n - 1)
    turns = np.cumsum(row.free[j], axis=1) == np.arange(1, width + 1)
    saved = np.stack(_savings(row, place[:, None], j))
    moves = within & (np.arange(width) > 0)
    first_free, last_free = row.free[place][:, None], row.free[j]
    allowed = np.stack([within & turns, moves, moves & first_free, moves, moves & last_free])
    saved = np.where(allowed, saved, -1.0).transpose(1, 0, 2).reshape(len(place), -1)
    best = saved.argmax(axis=1)
    return place, best % width, best // width, saved[np.arange(len(place)), best]


def _savings(row: _Row, i: Int, j: Int) -> list[Float]:
    """For each kind of change from places `i` (A, 1) to `j` (A, W) how many mm it saves."""
    i, j = i + 1, j + 1  # of what is padded
    bx, by, ex, ey = (np.ascontiguousarray(column) for of in (row.begin, row.end) for column in of.T)
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
    """Mm between places; 0 to what is nowhere."""
    x, y = one[0] - other[0], one[1] - other[1]
    x *= x
    y *= y
    x += y
    return np.asarray(np.nan_to_num(np.sqrt(x, out=x), copy=False, nan=0.0))


def _select_changes(place: Int, span: Int, saved: Float, n: int) -> Int:
    """Changes that save something and do not touch each other, the best first."""
    better = np.flatnonzero(saved > _LEAST)
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


def _nearby_places(place: Int, span: Int, group: Int) -> Int:
    """The places from which a change may reach what has just been changed, or whose neighbours have."""
    first = np.maximum(place - _REACH, 0)
    last = np.minimum(place + span + 2, len(group))
    near = consecutive(first, last - first)
    # A change in a group alters the way to the one before and the one after, and those of its own.
    owner = np.repeat(np.arange(len(place)), last - first)
    beside = (near >= place[owner] - 1) | (group[near] == group[place[owner]])
    return distinct(near[beside])
