"""Intersect windows of neighbouring layers with few pairwise intersections."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeVar

import numpy as np

from printer_slicer.arrays import Int, distinct

__all__ = ["intersect_windows"]

T = TypeVar("T")
Intersect = Callable[[list[T], list[T]], list[T]]
"""Function that intersects two lists entry by entry."""


def intersect_windows(layers: Sequence[T], first: Int, last: Int, intersect: Intersect[T]) -> list[T]:
    """Return the intersection of `layers[first[k]:last[k]]` for every window k.

    Entry i of table p is the intersection of the 2^p layers from i on. It is the intersection of two entries of the
    previous table. A window is the intersection of two entries, at its start and at its end. The cost grows with the
    logarithm of the width, and unused entries are not computed.

    Args:
        layers: one entry per layer, of the type that `intersect` takes.
        first: (W,) first layer of each window.
        last: (W,) one after its last layer; no window is empty or leaves the layers.
        intersect: returns the intersections of two lists, entry by entry.

    Source: the sparse table of Bender & Farach-Colton, The LCA Problem Revisited, 2000, for range minima.
    """
    # frexp is exact for integers: width = m * 2^e with 0.5 <= m < 1, so e - 1 is floor(log2(width)).
    level = np.frexp((last - first).astype(np.float64))[1].astype(np.int64) - 1
    tail = last - (1 << level)
    tables = _build_tables(layers, _find_needed_entries(first, tail, level), intersect)
    pairs = [
        (tables[p][i], tables[p][j])
        for p, i, j in zip(level.tolist(), first.tolist(), tail.tolist(), strict=True)
    ]
    result = [head for head, _ in pairs]
    both = np.flatnonzero(first != tail).tolist()
    made = intersect([pairs[k][0] for k in both], [pairs[k][1] for k in both])
    for k, value in zip(both, made, strict=True):
        result[k] = value
    return result


def _find_needed_entries(first: Int, tail: Int, level: Int) -> list[Int]:
    """Return for each table the entries that the windows or the next table need."""
    top = int(level.max(initial=0))
    needed = [distinct(np.concatenate([first[level == p], tail[level == p]])) for p in range(top + 1)]
    for p in range(top, 0, -1):
        half = 1 << (p - 1)
        needed[p - 1] = distinct(np.concatenate([needed[p - 1], needed[p], needed[p] + half]))
    return needed


def _build_tables(layers: Sequence[T], needed: list[Int], intersect: Intersect[T]) -> list[dict[int, T]]:
    """Compute the needed entries of each table; table 0 holds the layers themselves."""
    tables = [{i: layers[i] for i in needed[0].tolist()}]
    for p in range(1, len(needed)):
        below, half, entries = tables[-1], 1 << (p - 1), needed[p].tolist()
        made = intersect([below[i] for i in entries], [below[i + half] for i in entries])
        tables.append(dict(zip(entries, made, strict=True)))
    return tables
