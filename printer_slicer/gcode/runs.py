"""Many plain moves at once: what `reading` says one by one, over arrays, to the last bit."""

from __future__ import annotations

from collections.abc import Sequence
from math import isnan
from typing import Final

import numpy as np

from printer_slicer.arrays import Float, Int
from printer_slicer.gcode.reading import ReadingState, follow_line

__all__ = ["follow_plain"]

_FEW: Final = 6  # moves that are sooner done one by one
_XYZEF: Final = "XYZEF"


def follow_plain(state: ReadingState, words: Float, index: Int) -> None:
    """Make plain moves that follow each other.

    Args:
        state: of the machine; it is changed.
        words: (n, 5) the numbers of X, Y, Z, E, F, nan where there is none.
        index: (n,) of the commands.
    """
    if len(index) < _FEW:
        for row, place in zip(words.tolist(), index.tolist(), strict=True):
            there = {letter: at for letter, at in zip(_XYZEF, row, strict=True) if not isnan(at)}
            follow_line(state, there, place)
        return
    start = np.array(state.position)
    end = np.stack(
        [
            _axis(words[:, axis], start[axis], unit, offset, relative=relative)
            for axis, (unit, offset, relative) in enumerate(_readings(state))
        ],
        axis=1,
    )
    delta = np.diff(end, axis=0, prepend=start[None])
    feed = _held(np.where(words[:, 4] > 0, words[:, 4] * state.unit / 60, np.nan), state.feed)
    travels = (delta[:, :3] != 0).any(axis=1)
    lays = delta[:, 3] != 0
    acceleration = np.where(lays, np.where(travels, state.printing, state.retract), state.travel)
    moves = travels | lays
    table = np.column_stack(
        [end[:, :3], delta, feed * state.speed_ratio, acceleration, index, np.full(len(index), state.tool)]
    )
    state.rows.extend(table if moves.all() else table[moves])
    state.position = end[-1].tolist()
    state.feed = float(feed[-1])


def _readings(state: ReadingState) -> Sequence[tuple[float, float, bool]]:
    """Of x, y, z and e: mm in a unit of the text, what is taken off, whether numbers count from where it is."""
    head = [(state.unit, offset, state.relative) for offset in state.offset[:3]]
    return [*head, (state.unit_e, state.offset[3], state.relative_e)]


def _axis(words: Float, start: float, unit: float, offset: float, *, relative: bool) -> Float:
    """(n,) where an axis is after each move."""
    if relative:
        steps = np.where(np.isnan(words), 0.0, words * unit)
        return np.asarray(np.cumsum(np.append(start, steps))[1:])
    return _held(words * unit - offset, start)


def _held(values: Float, start: float) -> Float:
    """(n,) the last value that is a number, `start` before the first."""
    values = np.append(start, values)
    last = np.maximum.accumulate(np.where(np.isnan(values), 0, np.arange(len(values))))
    return np.asarray(values[last][1:])
