"""Moves as bytes, a column of digits at a time.

Each word is a matrix of characters with one row per move: letter, sign, digits, point, digits. What a row does not need
(leading and trailing zeros, a missing word) is masked out, and one boolean take leaves the text. Rounding is numpy's
`rint`, ties to even, done once on integers of the last decimal, so sums of E come out exact.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from printer_slicer.model import Bool, Int, Program, Role

__all__ = ["Rows", "rows_of"]

XY_DECIMALS, Z_DECIMALS, E_DECIMALS = 3, 4, 5
_AT_ONCE = 8192  # rows whose matrices fit the processor's cache


@dataclass(frozen=True, slots=True, eq=False)
class Rows:
    """The text of all moves.

    Attributes:
        text: all rows one after the other, each ending in a newline.
        start: (K + 1,) where the row of each move begins in `text`; moves too short to show have an empty row.
    """

    text: bytes
    start: Int


def rows_of(program: Program, *, relative: bool) -> Rows:
    """G0 and G1 rows of a program's moves.

    Args:
        program: the moves.
        relative: E words are differences (M83); otherwise they count from 0 (M82).
    """
    xyz = np.rint(program.xyz * 10.0 ** np.array([XY_DECIMALS, XY_DECIMALS, Z_DECIMALS])).astype(np.int64)
    fed = np.rint(np.cumsum(program.filament) * 10**E_DECIMALS).astype(np.int64)
    feed = np.rint(program.speed * 60).astype(np.int64)
    feed = np.maximum(feed, 1)
    kept = _visible(xyz, fed, program.role == Role.TRAVEL)
    xyz, fed, feed = xyz[kept], _without_travels(fed[kept], program.filament[kept] != 0), feed[kept]
    step = np.diff(fed, prepend=0)
    moved = np.diff(xyz, axis=0, prepend=xyz[:1] - 1) != 0
    columns = [
        (b" X", xyz[:, 0], XY_DECIMALS, moved[:, 0]),
        (b" Y", xyz[:, 1], XY_DECIMALS, moved[:, 1]),
        (b" Z", xyz[:, 2], Z_DECIMALS, moved[:, 2]),
        (b" E", step if relative else fed, E_DECIMALS, step != 0),
        (b" F", feed, 0, np.diff(feed, prepend=-1) != 0),
    ]
    extrudes = step != 0
    texts, lengths = [], []
    for first in range(0, len(xyz), _AT_ONCE):
        some = slice(first, first + _AT_ONCE)
        text, length = _block(extrudes[some], [(w, v[some], d, p[some]) for w, v, d, p in columns])
        texts.append(text)
        lengths.append(length)
    length_of = np.zeros(program.n_moves, np.int64)
    length_of[kept] = np.concatenate([np.zeros(0, np.int64), *lengths])
    return Rows(b"".join(texts), np.concatenate([[0], np.cumsum(length_of)]))


def _visible(xyz: Int, fed: Int, pure: Bool) -> Int:
    """Which moves still change something once rounded; a bead too short to show leaves its filament to the next one."""
    travels = np.diff(xyz, axis=0, prepend=xyz[:1] - 1).any(axis=1)
    turns = travels | (pure & (np.diff(fed, prepend=0) != 0))
    return np.flatnonzero(turns)


def _without_travels(fed: Int, feeds: Bool) -> Int:
    """E at the end of each row, where rows that feed nothing leave what is owed to the next one that does."""
    last = np.maximum.accumulate(np.where(feeds, np.arange(len(fed)), -1))
    return np.where(last >= 0, fed[np.maximum(last, 0)], 0)


def _block(extrudes: Bool, columns: list[tuple[bytes, Int, int, Bool]]) -> tuple[bytes, Int]:
    """The text of some rows and the length of each."""
    n = len(extrudes)
    command = np.tile(np.frombuffer(b"G0", np.uint8), (n, 1))
    command[extrudes, 1] = ord("1")
    parts = [(command, np.ones((n, 2), np.bool_))]
    parts += [_word(word, value, decimals, present) for word, value, decimals, present in columns]
    parts.append((np.full((n, 1), ord("\n"), np.uint8), np.ones((n, 1), np.bool_)))
    mask = np.concatenate([part[1] for part in parts], axis=1)
    letters = np.concatenate([part[0] for part in parts], axis=1)
    return letters[mask].tobytes(), mask.sum(axis=1)


def _word(word: bytes, value: Int, decimals: int, present: Bool) -> tuple[NDArray[np.uint8], Bool]:
    """Characters (n, w) and mask (n, w) of one word; `value` counts units of its last decimal."""
    size = np.abs(value)
    n_digits = max(len(str(int(size.max(initial=0)))), decimals + 1)
    digits = np.zeros((len(value), n_digits), np.uint8)
    rest = size
    for place in range(n_digits - 1, -1, -1):
        rest, digit = np.divmod(rest, 10)
        digits[:, place] = digit
    whole = n_digits - decimals
    shown = np.zeros((len(value), n_digits), np.bool_)
    nonzero = digits != 0
    shown[:, :whole] = np.logical_or.accumulate(nonzero[:, :whole], axis=1)
    shown[:, whole - 1] = True
    shown[:, whole:] = np.logical_or.accumulate(nonzero[:, whole:][:, ::-1], axis=1)[:, ::-1]
    head = np.tile(np.frombuffer(word + b"-", np.uint8), (len(value), 1))
    head_mask = np.ones(head.shape, np.bool_)
    head_mask[:, -1] = value < 0
    point = np.full((len(value), 1), ord("."), np.uint8)
    point_mask = shown[:, whole:].any(axis=1, keepdims=True)
    text = digits + np.uint8(ord("0"))
    letters = np.concatenate([head, text[:, :whole], point, text[:, whole:]], axis=1)
    mask = np.concatenate([head_mask, shown[:, :whole], point_mask, shown[:, whole:]], axis=1)
    mask &= present[:, None]
    return letters, mask
