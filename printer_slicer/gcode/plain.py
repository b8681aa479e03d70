"""The numbers of ordinary moves, `G1 X10.5 Y3 E0.02 F1800`, read from all lines at once.

Nine lines of ten are such moves. Their digits are added up column by column over the whole text; the value is the whole
number of all digits divided by a power of ten, both exact, so it is the same as Python's `float` gives.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import isnan
from typing import Final

import numpy as np
from numpy.typing import NDArray

from printer_slicer.arrays import Bool, Float, Int
from printer_slicer.gcode.reading import ReadingState, follow_line

__all__ = ["LETTERS", "Plain", "follow_plain", "plain_moves"]

_Text = NDArray[np.uint8]
_Kinds = NDArray[np.int8]

LETTERS: Final = "XYZEF"
"""The words of a plain move, in the order of its columns."""

_MOST_DIGITS: Final = 15  # a number of so many is exact as a float
_MOST: Final = 1e9  # no machine goes there; the careful reader decides what such a number means
_OTHER, _DIGIT, _DOT, _SIGN, _LETTER, _BLANK, _END = range(7)
_POWERS: Final = 10.0 ** np.arange(_MOST_DIGITS + 2)


def _table() -> _Kinds:
    kinds = np.full(256, _OTHER, np.int8)
    for characters, kind in (("0123456789", _DIGIT), (".", _DOT), ("+-", _SIGN), (LETTERS, _LETTER)):
        kinds[[ord(one) for one in characters]] = kind
    kinds[ord(" ")], kinds[ord("\n")] = _BLANK, _END
    return kinds


def _allowed() -> Bool:
    """[kind, kind behind it]: which neighbours a plain move may have."""
    allowed = np.zeros((7, 7), np.bool_)
    for before, after in (
        (_DIGIT, (_DIGIT, _DOT, _BLANK, _END)),
        (_DOT, (_DIGIT, _BLANK, _END)),
        (_SIGN, (_DIGIT, _DOT)),
        (_LETTER, (_DIGIT, _DOT, _SIGN)),
        (_BLANK, (_LETTER,)),
        (_END, (_OTHER, _DIGIT, _DOT, _SIGN, _LETTER, _BLANK, _END)),
    ):
        allowed[before, list(after)] = True
    return allowed


_KINDS: Final = _table()
_ALLOWED: Final = _allowed().reshape(-1)


@dataclass(frozen=True, slots=True, eq=False)
class Plain:
    """The plain moves among some commands.

    Attributes:
        index: (n,) which of the commands they are, ascending.
        words: (n, 5) the numbers of X, Y, Z, E and F as they are written, nan for those that are not there.
    """

    index: Int
    words: Float


def plain_moves(commands: Sequence[bytes]) -> Plain:
    """The commands that are G0 or G1, one blank before each word and nothing but numbers in them.

    Of a letter that comes twice the last number counts. What is written in any other way is left to others.

    Args:
        commands: without comments and line breaks.
    """
    text = np.frombuffer(b"\n" + b"\n".join(commands) + b"\n", np.uint8)
    kind = _KINDS[text]
    breaks = np.flatnonzero(kind == _END)
    plain = _begin_as_moves(text, breaks)
    # "G1" itself is no word: its two characters pass as the end of the line before.
    kind[breaks[:-1][plain] + 1] = kind[breaks[:-1][plain] + 2] = _END
    wrong = np.flatnonzero(~_ALLOWED[kind[:-1].astype(np.int16) * 7 + kind[1:]])
    plain[np.searchsorted(breaks, wrong, side="right") - 1] = False
    letter = np.flatnonzero(kind == _LETTER)
    line = np.searchsorted(breaks, letter) - 1
    letter, line = letter[plain[line]], line[plain[line]]
    words = np.full((len(plain), len(LETTERS)), np.nan)
    value, good = _numbers(text, kind, letter + 1)
    words[line, _COLUMN[text[letter]]] = value
    plain[line[~good]] = False
    index = np.flatnonzero(plain)
    return Plain(index, words[index])


_COLUMN: Final = np.zeros(256, np.int64)
_COLUMN[[ord(letter) for letter in LETTERS]] = np.arange(len(LETTERS))


def _begin_as_moves(text: _Text, breaks: Int) -> Bool:
    """Which lines begin with `G0 ` or `G1 `, and no more than a blank behind it being there."""
    first = breaks[:-1]
    last = len(text) - 1
    code = (text[first + 1] == ord("G")) & (np.isin(text[np.minimum(first + 2, last)], (ord("0"), ord("1"))))
    return np.asarray(code & (text[np.minimum(first + 3, last)] == ord(" ")))


def _numbers(text: _Text, kind: _Kinds, start: Int) -> tuple[Float, Bool]:
    """The numbers that begin at these places, and which of them are good: digits in them, not too many, one dot."""
    negative = text[start] == ord("-")
    at = start + (kind[start] == _SIGN)
    mantissa = np.zeros(len(at), np.int64)
    digits = np.zeros(len(at), np.int64)
    decimals = np.zeros(len(at), np.int64)
    dots = np.zeros(len(at), np.int64)
    on = np.arange(len(at))
    place = at
    for _ in range(_MOST_DIGITS + 2):
        here = kind[place]
        more = (here == _DIGIT) | (here == _DOT)
        if not more.all():
            on, place, here = on[more], place[more], here[more]
        if not len(on):
            break
        digit = here == _DIGIT
        mantissa[on] = np.where(digit, mantissa[on] * 10 + (text[place] - np.uint8(ord("0"))), mantissa[on])
        decimals[on] += digit & (dots[on] > 0)
        digits[on] += digit
        dots[on] += ~digit
        place = place + 1
    good = (digits > 0) & (digits <= _MOST_DIGITS) & (dots <= 1)
    good[on] = False
    value = np.where(good, mantissa, 0) / _POWERS[np.where(good, decimals, 0)]
    return np.where(negative, -value, value), good & (value < _MOST)


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
