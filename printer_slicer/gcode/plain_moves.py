"""Read the numbers of plain moves, such as `G1 X10.5 Y3 E0.02 F1800`, from all lines at once.

Nine of ten lines are plain moves. Their digits are added up position by position over the whole text. A value is the
integer of all its digits divided by a power of ten; both are exact, so it equals the result of Python's `float`.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import isnan
from typing import Final

import numpy as np
from numpy.typing import NDArray

from printer_slicer.arrays import Bool, Float, Int
from printer_slicer.gcode.move_actions import ReaderState, move_straight
from printer_slicer.values import Struct

__all__ = ["LETTERS", "PlainMoves", "apply_plain_moves", "read_plain_moves"]

_Text = NDArray[np.uint8]
_Kinds = NDArray[np.int8]

LETTERS: Final = "XYZEF"
"""The words of a plain move, in the order of its columns."""

_MAX_DIGITS: Final = 15  # numbers with up to 15 digits are exact as a float
_MAX_VALUE: Final = 1e9  # larger numbers are left to `lexer.parse`
_OTHER, _DIGIT, _DOT, _SIGN, _LETTER, _BLANK, _END = range(7)
_POWERS: Final = 10.0 ** np.arange(_MAX_DIGITS + 2)


def _build_character_kinds() -> _Kinds:
    """Return the kind of each character, by its code."""
    kinds = np.full(256, _OTHER, np.int8)
    for characters, kind in (("0123456789", _DIGIT), (".", _DOT), ("+-", _SIGN), (LETTERS, _LETTER)):
        kinds[[ord(one) for one in characters]] = kind
    kinds[ord(" ")], kinds[ord("\n")] = _BLANK, _END
    return kinds


def _build_allowed_pairs() -> Bool:
    """Return which kinds of characters may follow each other in a plain move, as a table [kind, next kind]."""
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


_KINDS: Final = _build_character_kinds()
_ALLOWED: Final = _build_allowed_pairs().reshape(-1)


class PlainMoves(Struct, frozen=True, eq=False):
    """The plain moves among some commands.

    Attributes:
        index: (n,) indices of the plain moves among the commands, ascending.
        words: (n, 5) numbers of X, Y, Z, E and F as written; nan for missing words.
    """

    index: Int
    words: Float


def read_plain_moves(commands: Sequence[bytes]) -> PlainMoves:
    """Find G0 and G1 commands with one blank before each word and read their numbers.

    If a letter occurs twice, its last number counts. Commands written in any other way are skipped.

    Args:
        commands: without comments and line breaks.
    """
    text = np.frombuffer(b"\n" + b"\n".join(commands) + b"\n", np.uint8)
    kind = _KINDS[text]
    breaks = np.flatnonzero(kind == _END)
    plain = _find_move_lines(text, breaks)
    # "G1" itself is not a word: treat its two characters as part of the line break before it.
    kind[breaks[:-1][plain] + 1] = kind[breaks[:-1][plain] + 2] = _END
    wrong = np.flatnonzero(~_ALLOWED[kind[:-1].astype(np.int16) * 7 + kind[1:]])
    plain[np.searchsorted(breaks, wrong, side="right") - 1] = False
    letter = np.flatnonzero(kind == _LETTER)
    line = np.searchsorted(breaks, letter) - 1
    letter, line = letter[plain[line]], line[plain[line]]
    words = np.full((len(plain), len(LETTERS)), np.nan)
    value, good = _parse_numbers(text, kind, letter + 1)
    words[line, _COLUMN[text[letter]]] = value
    plain[line[~good]] = False
    index = np.flatnonzero(plain)
    return PlainMoves(index, words[index])


_COLUMN: Final = np.zeros(256, np.int64)
_COLUMN[[ord(letter) for letter in LETTERS]] = np.arange(len(LETTERS))


def _find_move_lines(text: _Text, breaks: Int) -> Bool:
    """Return which lines begin with `G0 ` or `G1 `."""
    first = breaks[:-1]
    last = len(text) - 1
    code = (text[first + 1] == ord("G")) & (np.isin(text[np.minimum(first + 2, last)], (ord("0"), ord("1"))))
    return np.asarray(code & (text[np.minimum(first + 3, last)] == ord(" ")))


def _parse_numbers(text: _Text, kind: _Kinds, start: Int) -> tuple[Float, Bool]:
    """Return the numbers that begin at `start`, and which are valid: with 1 to 15 digits and at most one point."""
    negative = text[start] == ord("-")
    at = start + (kind[start] == _SIGN)
    mantissa = np.zeros(len(at), np.int64)
    digits = np.zeros(len(at), np.int64)
    decimals = np.zeros(len(at), np.int64)
    dots = np.zeros(len(at), np.int64)
    on = np.arange(len(at))
    place = at
    for _ in range(_MAX_DIGITS + 2):
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
    good = (digits > 0) & (digits <= _MAX_DIGITS) & (dots <= 1)
    good[on] = False
    value = np.where(good, mantissa, 0) / _POWERS[np.where(good, decimals, 0)]
    return np.where(negative, -value, value), good & (value < _MAX_VALUE)


_MIN_VECTORIZED: Final = 6  # fewer moves are faster one by one
_XYZEF: Final = "XYZEF"


def apply_plain_moves(state: ReaderState, words: Float, index: Int) -> None:
    """Apply consecutive plain moves to the state.

    Args:
        state: changed in place.
        words: (n, 5) numbers of X, Y, Z, E and F; nan for missing words.
        index: (n,) indices of the commands.
    """
    if len(index) < _MIN_VECTORIZED:
        for row, place in zip(words.tolist(), index.tolist(), strict=True):
            there = {letter: at for letter, at in zip(_XYZEF, row, strict=True) if not isnan(at)}
            move_straight(state, there, place)
        return
    start = np.array(state.position)
    end = np.stack(
        [
            _compute_positions(words[:, axis], start[axis], unit, offset, relative=relative)
            for axis, (unit, offset, relative) in enumerate(_list_axis_rules(state))
        ],
        axis=1,
    )
    delta = np.diff(end, axis=0, prepend=start[None])
    feed = _fill_with_last(np.where(words[:, 4] > 0, words[:, 4] * state.unit / 60, np.nan), state.feed)
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


def _list_axis_rules(state: ReaderState) -> Sequence[tuple[float, float, bool]]:
    """Return the rules for reading x, y, z and e: unit in mm, offset to subtract, and whether relative."""
    head = [(state.unit, offset, state.relative) for offset in state.offset[:3]]
    return [*head, (state.filament_per_e, state.offset[3], state.relative_e)]


def _compute_positions(words: Float, start: float, unit: float, offset: float, *, relative: bool) -> Float:
    """Return the position of an axis after each move, (n,)."""
    if relative:
        steps = np.where(np.isnan(words), 0.0, words * unit)
        return np.asarray(np.cumsum(np.append(start, steps))[1:])
    return _fill_with_last(words * unit - offset, start)


def _fill_with_last(values: Float, start: float) -> Float:
    """Replace each nan by the last number before it, or by `start`; (n,)."""
    values = np.append(start, values)
    last = np.maximum.accumulate(np.where(np.isnan(values), 0, np.arange(len(values))))
    return np.asarray(values[last][1:])
