"""Connectivity of items given as arrays: equal keys, linked items, chains and cycles."""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from printer_slicer.arrays import Float, Int, consecutive

__all__ = [
    "Index",
    "chain_ends",
    "chain_steps",
    "cycles",
    "group_close_points",
    "label_components",
    "lowest_of_chain",
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
    """Numbers for keys, the same for equal ones.

    A table with about one place per key is written by all keys at once; who finds another key in its place tries again
    with another table. That takes a quarter of the time of sorting, and about 16 bytes per key. Equal keys of meshes
    stand near each other, so they are looked for block by block first, in tables that fit the processor's cache, and
    then among what is left of all blocks.

    Args:
        key: (n,) 64 bits.

    Returns:
        (n,) the number of each key, from 0, and (m,) one item of each number.
    """
    if len(key) <= 2 * _NEAR:
        return _welded(key)
    number, one = np.zeros(len(key), np.int32), []
    total = 0
    blocks = [slice(at, at + _NEAR) for at in range(0, len(key), _NEAR)]
    for block in blocks:
        there, firsts = _welded(key[block])
        number[block] = there + np.int32(total)
        one.append(firsts + np.int32(block.start))
        total += len(firsts)
    of_block = np.concatenate(one)
    overall, firsts = _welded(key.take(of_block))
    for block in blocks:
        number[block] = overall.take(number[block])
    return number, of_block.take(firsts)


def _welded(key: NDArray[np.uint64]) -> tuple[Index, Index]:
    """The same by one table for all."""
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
    """(n,) the group of each of `n` items, from 0: two items are in one group when links lead from one to the other.

    Args:
        members: (k, M) items that each of M links holds together.
        n: number of items.

    Each round every item that meets a lower one hooks to it, and hooked items move to the end of their chain; what is
    left of the links joins fewer and fewer items.
    """
    label = np.arange(n, dtype=np.int32)
    itself = label.copy()
    columns = [np.asarray(column, np.int32) for column in members]
    one, other = (np.concatenate([np.zeros(0, np.int32), *some]) for some in (columns[:-1], columns[1:]))
    while len(one):
        # Links are mostly given by rising items: written backward, each item is left with its lowest.
        low, high = np.minimum(one, other)[::-1], np.maximum(one, other)[::-1]
        parent = itself.copy()
        parent[high] = low
        parent = chain_ends(parent)
        label = parent.take(label)
        one, other = parent.take(low), parent.take(high)
        apart = np.flatnonzero(one != other)
        one, other = one.take(apart), other.take(apart)
    number = np.cumsum(label == itself) - 1
    return np.asarray(number.take(label), np.int64)


def chain_ends(following: NDArray[_Whole]) -> NDArray[_Whole]:
    """(n,) where each item comes to when it goes on to `following` again and again.

    The last item of a chain is followed by itself; there must be no cycles. Everyone points to who their next points
    to, until all point to the end: twice as far each time.
    """
    while True:
        further = following.take(following)
        if np.array_equal(further, following):
            return following
        following = further


def chain_steps(following: NDArray[_Whole]) -> tuple[NDArray[_Whole], NDArray[_Whole]]:
    """(n,) where each item comes to as with `chain_ends`, and in how many steps."""
    end = following
    steps = (end != np.arange(len(end))).astype(following.dtype)
    while True:
        further = end.take(end)
        if np.array_equal(further, end):
            return end, steps
        steps, end = steps + steps.take(end), further


def group_close_points(points: Float, reach: float) -> Int:
    """(n,) groups, from 0, of points (n, d): those within `reach` of each other along every axis are together.

    Cells of twice the reach, shifted by half a cell along each axis or not, hold every such pair at least once. What
    shares cells without being so near is told apart then, but in crowds of more than a hundred.
    """
    rough = _sharing_cells(points, reach)
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


def _sharing_cells(points: Float, reach: float) -> Int:
    """(n,) groups, from 0, of points that share cells, however far along."""
    n, dimensions = points.shape
    pairs = []
    for shift in np.ndindex(*(2,) * dimensions):
        cell = np.floor(points / (2 * reach) + np.array(shift) / 2)
        order = np.lexsort(cell.T)
        same = (cell[order[1:]] == cell[order[:-1]]).all(axis=1)
        pairs.append(np.stack([order[1:][same], order[:-1][same]]))
    return label_components(np.concatenate(pairs, axis=1), n)


def lowest_of_chain(following: Int | Index) -> Int:
    """(N,) the lowest index that each item meets when it goes on to `following` again and again, itself included.

    Pointer jumping: after round k every item knows the lowest of 2^k followers, so the number of rounds is the
    logarithm of the longest chain.
    """
    return _lowest(following).astype(np.int64)


def _lowest(following: Int | Index) -> Index:
    # Half the bits, half the time: nothing is done here but fetching from memory.
    jump = following.astype(np.int32)
    lowest: Index = np.arange(len(following), dtype=np.int32)
    while True:
        better = np.minimum(lowest, lowest.take(jump))
        if np.array_equal(better, lowest):
            return lowest
        lowest, jump = better, jump.take(jump)


def cycles(following: Int) -> tuple[Int, Int]:
    """For a permutation: the lowest index of each item's cycle, and the steps from there to the item."""
    n = len(following)
    lowest = _lowest(following)
    # Steps to the cycle's first item, by the same doubling along the chain that ends there.
    itself = np.arange(n, dtype=np.int32)
    is_first = lowest == itself
    _, steps = chain_steps(np.where(is_first[following], itself, following.astype(np.int32)))
    length = np.bincount(lowest, minlength=n)
    return lowest.astype(np.int64), np.where(is_first, 0, length[lowest] - 1 - steps)
