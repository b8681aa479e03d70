"""Connectivity of items stored in arrays: equal keys, linked items, chains and cycles."""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from printer_slicer.arrays import Float, Int, consecutive
from printer_slicer.kernel import load_kernel

__all__ = [
    "Index",
    "count_chain_steps",
    "find_chain_ends",
    "find_cycles",
    "find_lowest_in_chain",
    "group_close_points",
    "label_components",
    "weld_keys",
]

Index = NDArray[np.int32]

_Whole = TypeVar("_Whole", np.int32, np.int64)

_SPREAD = 0x9E3779B97F4A7C15
_STEP = 0x2545F4914F6CDD1D
_AT_ONCE = 1 << 20
_CROWD = 100  # points
_NEAR = 1 << 17  # keys welded together first


def weld_keys(key: NDArray[np.uint64]) -> tuple[Index, Index]:
    """Number keys so that equal keys get equal numbers.

    All keys are written to a hash table at once. A key that finds another one in its slot tries again with another
    hash function. This takes a quarter of the time of sorting, and about 16 bytes per key. Equal keys of meshes lie
    near each other, so each block is welded first, in a table that fits the processor's cache, and then the results of
    all blocks.

    Args:
        key: (n,) 64-bit keys.

    Returns:
        The number of each key (n,), from 0, and the last index of the key with each number (m,), ascending.
    """
    kernel = load_kernel()
    if kernel:
        numbers, last = kernel.weld_keys(np.ascontiguousarray(key))
        return np.frombuffer(numbers, np.int32), np.frombuffer(last, np.int32)
    if len(key) <= 2 * _NEAR:
        return _weld_in_one_table(key)
    number, one = np.zeros(len(key), np.int32), []
    total = 0
    blocks = [slice(at, at + _NEAR) for at in range(0, len(key), _NEAR)]
    for block in blocks:
        there, firsts = _weld_in_one_table(key[block])
        number[block] = there + np.int32(total)
        one.append(firsts + np.int32(block.start))
        total += len(firsts)
    of_block = np.concatenate(one)
    overall, firsts = _weld_in_one_table(key.take(of_block))
    for block in blocks:
        number[block] = overall.take(number[block])
    return number, of_block.take(firsts)


def _weld_in_one_table(key: NDArray[np.uint64]) -> tuple[Index, Index]:
    """Number keys as `weld_keys` does, with one hash table."""
    n = len(key)
    bits = max(n.bit_length(), 4)
    owner = np.zeros(n, np.int32)
    table = np.zeros(1 << bits, np.int32)
    left, rest, attempt = np.arange(n, dtype=np.int32), key, 0
    while len(left):
        factor, shift = np.uint64((_SPREAD + 2 * attempt * _STEP) % 2**64), np.uint64(64 - bits)
        lost, pieces = [], [slice(at, at + _AT_ONCE) for at in range(0, len(left), _AT_ONCE)]
        for piece in pieces:
            place = ((rest[piece] * factor) >> shift).view(np.int64)
            table[place] = left[piece]
        for piece in pieces:
            if len(pieces) > 1:
                place = ((rest[piece] * factor) >> shift).view(np.int64)
            winner = table.take(place)
            owner[left[piece]] = winner
            lost.append(np.flatnonzero(key.take(winner) != rest[piece]) + piece.start)
        again = np.concatenate(lost)
        left, rest, attempt = left.take(again), rest.take(again), attempt + 1
    is_first = owner == np.arange(n, dtype=np.int32)
    number = np.cumsum(is_first, dtype=np.int32) - np.int32(1)
    return number.take(owner), np.flatnonzero(is_first).astype(np.int32)


def label_components(members: Index | Int, n: int) -> Int:
    """Label the connected components of items joined by links.

    In each round every item is attached to a lower linked item, and attached items move to the end of their chain. The
    remaining links join fewer and fewer items.

    Args:
        members: (k, M) items that each of M links joins.
        n: number of items.

    Returns:
        The component (n,) of each item, from 0, in the order of their lowest items.
    """
    columns = [np.asarray(column, np.int32) for column in members]
    one, other = (np.concatenate([np.zeros(0, np.int32), *some]) for some in (columns[:-1], columns[1:]))
    kernel = load_kernel()
    if kernel:
        return np.frombuffer(kernel.label_components(one, other, n), np.int64)
    label = np.arange(n, dtype=np.int32)
    itself = label.copy()
    while len(one):
        # Links mostly come in rising order. Written backward, the lowest linked item wins.
        low, high = np.minimum(one, other)[::-1], np.maximum(one, other)[::-1]
        parent = itself.copy()
        parent[high] = low
        parent = find_chain_ends(parent)
        label = parent.take(label)
        one, other = parent.take(low), parent.take(high)
        apart = np.flatnonzero(one != other)
        one, other = one.take(apart), other.take(apart)
    number = np.cumsum(label == itself) - 1
    return np.asarray(number.take(label), np.int64)


def find_chain_ends(following: NDArray[_Whole]) -> NDArray[_Whole]:
    """Return the last item (n,) of the chain that starts at each item.

    The last item of a chain is followed by itself; there must be no cycles. Pointer jumping doubles the distance in
    each round, until all items point to the end.
    """
    while True:
        further = following.take(following)
        if np.array_equal(further, following):
            return following
        following = further


def count_chain_steps(following: NDArray[_Whole]) -> tuple[NDArray[_Whole], NDArray[_Whole]]:
    """Return the last item of each chain (n,), as `find_chain_ends` does, and the number of steps (n,) to it."""
    end = following
    steps = (end != np.arange(len(end))).astype(following.dtype)
    while True:
        further = end.take(end)
        if np.array_equal(further, end):
            return end, steps
        steps, end = steps + steps.take(end), further


def group_close_points(points: Float, reach: float) -> Int:
    """Group points (n, d) that are within `reach` of each other along every axis.

    The points are sorted into cells of twice the reach, on grids shifted by half a cell along each axis, so that each
    such pair shares a cell in at least one grid. Pairs that share a cell are then compared, except in groups of more
    than a hundred points.

    Returns:
        The group (n,) of each point, from 0.
    """
    rough = _group_by_shared_cells(points, reach)
    order = np.argsort(rough, kind="stable")
    size = np.bincount(rough)
    first = np.cumsum(size) - size
    crowd = size > _CROWD
    following = np.flatnonzero(crowd[rough[order]][1:] & (np.diff(rough[order]) == 0))
    member = np.flatnonzero(((size > 1) & ~crowd)[rough])
    group = rough[member]
    one, other = np.repeat(member, size[group]), order[consecutive(first[group], size[group])]
    near = (np.abs(points[one] - points[other]) <= reach).all(axis=1)
    links = np.stack([one[near], other[near]])
    return label_components(
        np.concatenate([links, [order[following], order[following + 1]]], axis=1), len(points)
    )


def _group_by_shared_cells(points: Float, reach: float) -> Int:
    """Group points that share cells, directly or through other points; return groups (n,) from 0."""
    n, dimensions = points.shape
    pairs = []
    for shift in np.ndindex(*(2,) * dimensions):
        cell = np.floor(points / (2 * reach) + np.array(shift) / 2)
        order = np.lexsort(cell.T)
        same = (cell[order[1:]] == cell[order[:-1]]).all(axis=1)
        pairs.append(np.stack([order[1:][same], order[:-1][same]]))
    return label_components(np.concatenate(pairs, axis=1), n)


def find_lowest_in_chain(following: Int | Index) -> Int:
    """Return the lowest index (N,) on the chain that starts at each item, including the item itself.

    By pointer jumping: after round k every item knows the lowest of 2^k followers, so the number of rounds is the
    logarithm of the longest chain.
    """
    return _find_lowest_index(following).astype(np.int64)


def _find_lowest_index(following: Int | Index) -> Index:
    """Return the result of `find_lowest_in_chain` as 32-bit indices."""
    # 32-bit indices take half the time, because memory access dominates.
    jump = following.astype(np.int32)
    lowest: Index = np.arange(len(following), dtype=np.int32)
    while True:
        better = np.minimum(lowest, lowest.take(jump))
        if np.array_equal(better, lowest):
            return lowest
        lowest, jump = better, jump.take(jump)


def find_cycles(following: Int) -> tuple[Int, Int]:
    """Return the lowest index in the cycle of each item of a permutation, and the steps (n,) from there to the item."""
    kernel = load_kernel()
    found = kernel.find_cycles(np.ascontiguousarray(following, np.int64).data) if kernel else None
    if found:
        lowest_in, steps_to = found
        return np.frombuffer(lowest_in, np.int64), np.frombuffer(steps_to, np.int64)
    n = len(following)
    lowest = _find_lowest_index(following)
    # Count the steps to the first item of the cycle, by pointer jumping along the chain that ends there.
    itself = np.arange(n, dtype=np.int32)
    is_first = lowest == itself
    _, steps = count_chain_steps(np.where(is_first[following], itself, following.astype(np.int32)))
    length = np.bincount(lowest, minlength=n)
    return lowest.astype(np.int64), np.where(is_first, 0, length[lowest] - 1 - steps)
