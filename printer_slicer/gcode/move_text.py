"""Format moves as bytes, one column of characters at a time.

Each word is a number of columns with one character per move: letter, sign, digits, point, digits. Characters that a row
does not need (leading and trailing zeros, missing words) are 0 and dropped when the columns are joined to rows. Values
are rounded once, by numpy's `rint` (ties to even), to integers of the last decimal, so sums of E are exact.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from printer_slicer.arrays import Bool, Int, run_starts
from printer_slicer.kernel import load_kernel
from printer_slicer.model import Program
from printer_slicer.roles import Role
from printer_slicer.values import Struct

__all__ = ["E_DECIMALS", "XY_DECIMALS", "Z_DECIMALS", "MoveText", "format_moves"]

XY_DECIMALS, Z_DECIMALS, E_DECIMALS = 3, 4, 5
_BATCH = 8192  # rows whose matrices fit the processor's cache
_ZERO, _ONE, _MINUS, _POINT = (np.uint8(ord(letter)) for letter in "01-.")
_Letters = NDArray[np.uint8]


class MoveText(Struct, frozen=True, eq=False):
    """The text of all moves.

    Attributes:
        text: all rows, each ending in a newline.
        start: (K + 1,) offset of each move's row in `text`; a move that changes no decimal has an empty row.
        fed: (K,) filament written by the end of each move, in units of the last decimal of E.
        feed: (K,) speed of each move as written, mm/min.
    """

    text: bytes
    start: Int
    fed: Int
    feed: Int


def format_moves(program: Program, *, relative: bool, full: Int | None = None) -> MoveText:
    """Format the moves of a program as rows of G0 to G3.

    Args:
        program: the moves.
        relative: relative extrusion (M83); otherwise absolute (M82).
        full: moves whose row holds x, y, z and speed even if they do not change; if a row is empty, the next one does.
    """
    fed = np.rint(np.cumsum(program.filament) * 10**E_DECIMALS).astype(np.int64)
    all_feed = np.maximum(np.rint(program.speed * 60).astype(np.int64), 1)
    if not program.n_moves:
        return MoveText(b"", np.zeros(1, np.int64), fed, all_feed)
    head, last = _group_moves_into_rows(program, all_feed)
    kept = _find_visible_rows(program, last, fed)
    head, last = head[kept], last[kept]
    feeds = np.add.reduceat(program.filament != 0, head) > 0
    rows = _Rows(
        head, last, _defer_filament(fed[last], feeds), all_feed[last], _find_full_rows(head, full), relative
    )
    length_of = np.zeros(program.n_moves, np.int64)
    texts = []
    for first in range(0, len(head), _BATCH):
        text, length = _format_batch(program, rows, first)
        texts.append(text)
        length_of[head[first : first + _BATCH]] = length
    start = np.zeros(program.n_moves + 1, np.int64)
    np.cumsum(length_of, out=start[1:])
    rows_before = np.searchsorted(head, np.arange(program.n_moves), side="right")
    return MoveText(b"".join(texts), start, np.append(0, rows.fed)[rows_before], all_feed)


class _Rows(Struct, frozen=True, eq=False):
    """The rows of text that moves become.

    Attributes:
        head: (n,) first move of each row.
        last: (n,) last move of each row.
        fed: (n,) filament written by the end of each row, in units of the last decimal of E.
        feed: (n,) speed, mm/min.
        anew: (n,) whether the row holds x, y, z and speed even if they do not change.
        relative: relative extrusion.
    """

    head: Int
    last: Int
    fed: Int
    feed: Int
    anew: Bool
    relative: bool


def _format_batch(program: Program, rows: _Rows, first: int) -> tuple[bytes, Int]:
    """Format `_BATCH` rows from row `first` on; return their text and the length of each row."""
    here = slice(first, first + _BATCH)
    ends = _round_positions(program, rows.last[max(first - 1, 0) : here.stop])
    ends = ends if first else np.concatenate([ends[:1] - 1, ends])  # the first row holds every axis
    moved = (np.diff(ends, axis=0) != 0) | rows.anew[here, None]
    ends, fed, feed = ends[1:], rows.fed[here], rows.feed[here]
    step = np.diff(fed, prepend=rows.fed[first - 1] if first else 0)
    new_feed = np.diff(feed, prepend=rows.feed[first - 1] if first else -1) != 0
    code, i, j = _compute_arcs(program, rows.head[here], rows.last[here])
    codes: _Letters = np.where(code > 0, code, step != 0).astype(np.uint8)
    arc = codes > 1
    columns = [
        (b" X", ends[:, 0], XY_DECIMALS, moved[:, 0]),
        (b" Y", ends[:, 1], XY_DECIMALS, moved[:, 1]),
        (b" Z", ends[:, 2], Z_DECIMALS, moved[:, 2]),
        *([(b" I", i, XY_DECIMALS, arc), (b" J", j, XY_DECIMALS, arc)] if arc.any() else []),
        (b" E", step if rows.relative else fed, E_DECIMALS, step != 0),
        (b" F", feed, 0, new_feed | rows.anew[here]),
    ]
    return _format_rows(codes, columns)


_Columns = list[tuple[bytes, Int, int, Bool]]  # name, values, number of decimals, whether a row has the word


def _round_positions(program: Program, moves: Int) -> Int:
    """Return the positions (n, 3) at the end of moves (n,), in units of the last decimal."""
    decimals = 10.0 ** np.array([XY_DECIMALS, XY_DECIMALS, Z_DECIMALS])
    return np.rint(program.xyz.take(moves, axis=0) * decimals).astype(np.int64)


def _group_moves_into_rows(program: Program, feed: Int) -> tuple[Int, Int]:
    """Return the first and the last move of each row of text: the chords of an arc share one row."""
    if not program.has_arcs:
        every = np.arange(program.n_moves)
        return every, every
    head = np.flatnonzero(~program.on_same_arc | run_starts(feed) | run_starts(program.layer))
    return head, np.append(head[1:], program.n_moves) - 1


def _compute_arcs(program: Program, head: Int, last: Int) -> tuple[Int, Int, Int]:
    """Return, for each row (n,), 2 or 3 for an arc (G2, G3), else 0; also the centre relative to the start (x, y)."""
    arc = last > head
    code, off = np.zeros(len(head), np.int64), np.zeros((len(head), 2), np.int64)
    if arc.any():
        first = head[arc]
        begin = _round_positions(program, np.maximum(first - 1, 0))[:, :2]
        centre = program.centre[first]
        off[arc] = np.rint(centre * 10**XY_DECIMALS).astype(np.int64) - begin
        out, chord = program.start[first, :2] - centre, program.xyz[first, :2] - program.start[first, :2]
        code[arc] = np.where(out[:, 0] * chord[:, 1] > out[:, 1] * chord[:, 0], 3, 2)
    return code, off[:, 0], off[:, 1]


def _find_full_rows(kept: Int, full: Int | None) -> Bool:
    """Return a mask (n,) of the kept rows: the first one at or after each move in `full`."""
    anew = np.zeros(len(kept), np.bool_)
    if full is not None:
        place = np.searchsorted(kept, full)
        anew[place[place < len(kept)]] = True
    return anew


def _find_visible_rows(program: Program, last: Int, fed: Int) -> Int:
    """Return the indices of the rows that change a word after rounding; other moves get no row of their own.

    Args:
        program: the moves.
        last: (n,) last move of each row.
        fed: (K,) filament written by the end of each move, in units of the last decimal of E.
    """
    is_visible = np.zeros(len(last), np.bool_)
    for first in range(0, len(last), _BATCH):
        here = slice(first, first + _BATCH)
        moves = last[max(first - 1, 0) : here.stop]
        ends, total = _round_positions(program, moves), fed[moves]
        if not first:
            ends, total = np.concatenate([ends[:1] - 1, ends]), np.append(0, total)
        retracts = (program.role[last[here]] == Role.TRAVEL) & (np.diff(total) != 0)
        is_visible[here] = np.diff(ends, axis=0).any(axis=1) | retracts
    return np.flatnonzero(is_visible)


def _defer_filament(fed: Int, feeds: Bool) -> Int:
    """Return E at the end of each row (n,); filament of a row without E is added to the next row with E."""
    last = np.maximum.accumulate(np.where(feeds, np.arange(len(fed)), -1))
    return np.where(last >= 0, fed[np.maximum(last, 0)], 0)


def _format_rows(code: _Letters, columns: _Columns) -> tuple[bytes, Int]:
    """Format rows; return their text and the length of each row. `code` is the number after the G."""
    kernel = load_kernel()
    if not kernel:
        return _format_rows_in_columns(code, columns)
    words = b"".join(name[1:] + bytes([decimals]) for name, _, decimals, _ in columns)
    values = np.stack([value for _, value, _, _ in columns])
    present = np.stack([present for _, _, _, present in columns])
    text, lengths = kernel.format_move_rows(code.data, words, values.data, present.data)
    return text, np.frombuffer(lengths, np.int64)


def _format_rows_in_columns(code: _Letters, columns: _Columns) -> tuple[bytes, Int]:
    """Format rows as `_format_rows` does."""
    letters = [np.full(len(code), ord("G"), np.uint8), code + _ZERO]
    for name, value, decimals, present in columns:
        letters += [present * np.uint8(letter) for letter in name]
        letters += [letter * present for letter in _format_numbers(value, decimals)]
    letters.append(np.full(len(code), ord("\n"), np.uint8))
    length = np.zeros(len(code), np.uint8)
    for letter in letters:
        length += letter != 0
    return _join_columns(letters), length.astype(np.int64)


def _format_numbers(value: Int, decimals: int) -> list[_Letters]:
    """Return columns of characters of numbers: sign, integer digits, point, decimals; each (n,), 0 for no character.

    `value` counts units of the last decimal.
    """
    rest = np.abs(value)
    most = int(rest.max(initial=0))
    rest = rest.astype(np.uint32) if most < 1 << 32 else rest.view(np.uint64)
    ten = rest.dtype.type(10)
    digits: list[_Letters] = []  # the last digit comes first
    while len(digits) <= decimals or most >= 10 ** len(digits):
        tenth = rest // ten
        digits.append((rest - tenth * ten).astype(np.uint8))
        rest = tenth
    shown = np.zeros(len(value), np.bool_)
    for place in range(decimals):  # drop trailing zeros
        shown |= digits[place] != 0
        digits[place] = (digits[place] + _ZERO) * shown
    point = shown * _POINT
    shown = np.zeros(len(value), np.bool_)
    for place in range(len(digits) - 1, decimals, -1):  # and leading zeros
        shown |= digits[place] != 0
        digits[place] = (digits[place] + _ZERO) * shown
    digits[decimals] += _ZERO
    return [(value < 0) * _MINUS, *digits[: decimals - len(digits) - 1 : -1], point, *digits[:decimals][::-1]]


def _join_columns(letters: list[_Letters]) -> bytes:
    """Join columns of characters to rows, without zeros.

    Columns are packed by eights: moving single bytes takes three times as long.
    """
    packed = np.zeros((len(letters[0]), -(-len(letters) // 8)), "<u8")
    for at in range(packed.shape[1]):
        eight = np.zeros(len(letters[0]), np.uint64)
        for place, letter in enumerate(letters[8 * at : 8 * at + 8]):
            eight |= letter.astype(np.uint64) << np.uint64(8 * place)
        packed[:, at] = eight
    text = packed.view(np.uint8).ravel()
    return text.compress(text != 0).tobytes()
