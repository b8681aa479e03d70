"""Format moves as bytes, one column of characters at a time.

Each word is a number of columns with one character per move: letter, sign, digits, point, digits. Characters that a row
does not need (leading and trailing zeros, missing words) are 0 and dropped when the columns are joined to rows. Values
are rounded once, by numpy's `rint` (ties to even), to integers of the last decimal, so sums of E are exact.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from printer_slicer.arrays import Bool, Int, run_starts
from printer_slicer.kernel import load_kernel
from printer_slicer.model import Program
from printer_slicer.roles import Role
from printer_slicer.values import Struct

__all__ = [
    "E_DECIMALS",
    "XY_DECIMALS",
    "Z_DECIMALS",
    "RowPlan",
    "RowText",
    "format_rows",
    "plan_rows",
    "split_by_layers",
]

XY_DECIMALS, Z_DECIMALS, E_DECIMALS = 3, 4, 5
_BATCH = 8192  # rows whose matrices fit the processor's cache
_ZERO, _ONE, _MINUS, _POINT = (np.uint8(ord(letter)) for letter in "01-.")
_Letters = NDArray[np.uint8]


class RowPlan(Struct, frozen=True, eq=False):
    """Which rows of text moves become, and their E; `format_rows` makes the text.

    Attributes:
        program: the moves.
        is_row: (K,) whether a row begins with the move; other moves change no decimal, or are chords of the arc before.
        fed: (K,) filament written by the end of each move, in units of the last decimal of E.
        full: moves whose row holds x, y, z and speed even if they do not change; if a row is empty, the next one does.
        relative: relative extrusion (M83); otherwise absolute (M82).
    """

    program: Program
    is_row: Bool
    fed: Int
    full: Int
    relative: bool

    def feed_before(self, move: int) -> int:
        """Return the speed of the move before this one, mm/min."""
        return int(_round_speeds(self.program, slice(move - 1, move))[0])


def plan_rows(program: Program, *, relative: bool, full: Int | None = None) -> RowPlan:
    """Choose the rows of G0 to G3 of a program, and compute their E; arguments as in `RowPlan`."""
    fed = np.cumsum(program.filament)
    fed *= 10**E_DECIMALS
    units = np.rint(fed, out=fed).astype(np.int64)
    del fed
    is_row = np.zeros(program.n_moves, np.bool_)
    for moves in split_by_layers(program):
        head, last = _group_moves_into_rows(program, moves)
        is_row[head[_find_visible_rows(program, head, last, units)]] = True
    _defer_filament(program, is_row, units)
    return RowPlan(program, is_row, units, np.zeros(0, np.int64) if full is None else full, relative)


def split_by_layers(program: Program) -> Iterator[slice]:
    """Yield ranges of moves that together are the program: whole layers, at most `_BATCH` moves or one layer."""
    ends = np.append(np.flatnonzero(run_starts(program.layer))[1:], program.n_moves)
    first = 0
    while first < program.n_moves:
        within = int(np.searchsorted(ends, first + _BATCH, side="right")) - 1
        last = int(ends[within]) if within >= 0 else first
        if last <= first:
            last = int(ends[within + 1])
        yield slice(first, last)
        first = last


class RowText(Struct, frozen=True, eq=False):
    """The text of the rows of some moves.

    Attributes:
        text: all rows, each ending in a newline.
        start: (n + 1,) offset of each move's row in `text`; a move without a row has an empty one.
        feed: speed of the last row, mm/min; -1 if there is none so far.
    """

    text: bytes
    start: Int
    feed: int


def format_rows(rows: RowPlan, moves: slice, feed: int) -> RowText:
    """Format the rows of a range of moves.

    Args:
        rows: the rows of the program.
        moves: range of moves from `split_by_layers`.
        feed: speed of the last row before the range, mm/min; -1: no row.
    """
    head, last = _group_moves_into_rows(rows.program, moves)
    kept = rows.is_row[head]
    head, last = head[kept], last[kept]
    is_full = _find_full_rows(rows, head)
    texts = []
    length_of = np.zeros(moves.stop - moves.start, np.int64)
    for first in range(0, len(head), _BATCH):
        here = slice(first, first + _BATCH)
        before = int(last[first - 1]) if first else moves.start - 1
        text, length, feed = _format_batch(rows, _Batch(head[here], last[here], is_full[here], before, feed))
        texts.append(text)
        length_of[head[here] - moves.start] = length
    start = np.zeros(len(length_of) + 1, np.int64)
    np.cumsum(length_of, out=start[1:])
    return RowText(texts[0] if len(texts) == 1 else b"".join(texts), start, feed)


class _Batch(Struct, frozen=True, eq=False):
    """Rows that are formatted at once.

    Attributes:
        head: (n,) first move of each row.
        last: (n,) last move of each row.
        is_full: (n,) whether the row holds x, y, z and speed even if they do not change.
        before: a move that ends where the first row starts; -1: no move.
        feed: speed of the row before, mm/min; -1: no row.
    """

    head: Int
    last: Int
    is_full: Bool
    before: int
    feed: int


def _format_batch(rows: RowPlan, batch: _Batch) -> tuple[bytes, Int, int]:
    """Format rows; return their text, the length of each row and the speed of the last one."""
    program, head, last = rows.program, batch.head, batch.last
    is_first = batch.before < 0
    ends = _round_positions(program, last if is_first else np.append(batch.before, last))
    ends = np.concatenate([ends[:1] - 1, ends]) if is_first else ends  # the first row holds every axis
    moved = (np.diff(ends, axis=0) != 0) | batch.is_full[:, None]
    ends, fed = ends[1:], rows.fed[last]
    step = np.diff(fed, prepend=0 if is_first else rows.fed[batch.before])
    feed = _round_speeds(program, last)
    new_feed = np.diff(feed, prepend=batch.feed) != 0
    code, i, j = _compute_arcs(program, head, last)
    codes: _Letters = np.where(code > 0, code, step != 0).astype(np.uint8)
    arc = codes > 1
    columns = [
        (b" X", ends[:, 0], XY_DECIMALS, moved[:, 0]),
        (b" Y", ends[:, 1], XY_DECIMALS, moved[:, 1]),
        (b" Z", ends[:, 2], Z_DECIMALS, moved[:, 2]),
        *([(b" I", i, XY_DECIMALS, arc), (b" J", j, XY_DECIMALS, arc)] if arc.any() else []),
        (b" E", step if rows.relative else fed, E_DECIMALS, step != 0),
        (b" F", feed, 0, new_feed | batch.is_full),
    ]
    text, length = _format_rows(codes, columns)
    return text, length, int(feed[-1])


_Columns = list[tuple[bytes, Int, int, Bool]]  # name, values, number of decimals, whether a row has the word


def _round_positions(program: Program, moves: Int) -> Int:
    """Return the positions (n, 3) at the end of moves (n,), in units of the last decimal."""
    decimals = 10.0 ** np.array([XY_DECIMALS, XY_DECIMALS, Z_DECIMALS])
    return np.rint(program.xyz.take(moves, axis=0) * decimals).astype(np.int64)


def _round_speeds(program: Program, moves: Int | slice) -> Int:
    """Return the speeds of moves (n,), mm/min, as they are written."""
    return np.maximum(np.rint(program.speed[moves] * 60).astype(np.int64), 1)


def _group_moves_into_rows(program: Program, moves: slice) -> tuple[Int, Int]:
    """Return the first and the last move of each row of text: the chords of an arc share one row.

    A row begins with the first move of the range, and with the move after it.
    """
    every = np.arange(moves.start, moves.stop)
    same = program.find_same_arcs(moves)
    if not same.any():
        return every, every
    head = np.flatnonzero(
        ~same | run_starts(_round_speeds(program, moves)) | run_starts(program.layer[moves])
    )
    return head + moves.start, np.append(head[1:], len(every)) + (moves.start - 1)


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


def _find_full_rows(rows: RowPlan, head: Int) -> Bool:
    """Return a mask (n,) of rows by their first moves: the first one at or after each move in `RowPlan.full`."""
    anew = np.zeros(len(head), np.bool_)
    if len(head) and len(rows.full):
        # a row belongs to these moves as far back as the row before it, which may lie in the range before
        before = np.append(_find_row_before(rows, int(head[0])), head[:-1])
        anew = np.searchsorted(rows.full, head, side="right") > np.searchsorted(
            rows.full, before, side="right"
        )
    return anew


def _find_row_before(rows: RowPlan, move: int) -> int:
    """Return the move with which the last row before a move begins; -1: none."""
    while move > 0:
        first = max(move - _BATCH, 0)
        found = np.flatnonzero(rows.is_row[first:move])
        if len(found):
            return first + int(found[-1])
        move = first
    return -1


def _find_visible_rows(program: Program, head: Int, last: Int, fed: Int) -> Bool:
    """Return a mask (n,) of the rows that change a word after rounding; other moves get no row of their own.

    Args:
        program: the moves.
        head: (n,) first move of each of consecutive rows.
        last: (n,) last move of each row.
        fed: (K,) filament fed by the end of each move, in units of the last decimal of E.
    """
    is_visible = np.zeros(len(last), np.bool_)
    for first in range(0, len(last), _BATCH):
        here = slice(first, first + _BATCH)
        before = int(head[first]) - 1
        moves = last[here] if before < 0 else np.append(before, last[here])
        ends, total = _round_positions(program, moves), fed[moves]
        if before < 0:
            ends, total = np.concatenate([ends[:1] - 1, ends]), np.append(0, total)
        retracts = (program.role[last[here]] == Role.TRAVEL) & (np.diff(total) != 0)
        is_visible[here] = np.diff(ends, axis=0).any(axis=1) | retracts
    return is_visible


def _defer_filament(program: Program, is_row: Bool, fed: Int) -> None:
    """Change `fed` (K,) to what rows have written: filament of a row without E is added to the next row with E."""
    begin, written = 0, np.int64(0)
    while begin < program.n_moves:
        end = min(begin + _BATCH, program.n_moves)
        later = is_row[end:]
        end += int(later.argmax()) if later.any() else len(later)  # the range ends where a row begins
        head, last = _group_moves_into_rows(program, slice(begin, end))
        kept = is_row[head]
        head, last = head[kept], last[kept]
        feeds = np.logical_or.reduceat(program.filament[begin:end] != 0, head - begin)
        source = np.maximum.accumulate(np.where(feeds, np.arange(len(head)), -1))
        total = np.where(source >= 0, fed[last[np.maximum(source, 0)]], written)
        fed[begin:end] = total.repeat(np.diff(head, append=end))
        begin, written = end, total[-1]


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
