"""Read the facets that people painted in PrusaSlicer, Bambu Studio and OrcaSlicer to get supports or none.

The paint of a facet is a tree: a facet is either of one state or split into two, three or four facets, and so on. It
is stored as hexadecimal digits, the last digit first. The two low bits of a digit are the number of split sides. If it
is 0, the two high bits are the state (0 none, 1 enforced, 2 blocked, 3: the state is the next digit plus 3). Otherwise
they are the corner from which the corners are counted, and the digits of the smaller facets follow, the last one first.
All trees are read at once: a node's subtree ends where the count of missing nodes first falls below its start.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Final

import numpy as np

from printer_slicer.errors import MeshError
from printer_slicer.mesh_io.soundness import EXPORT_AGAIN
from printer_slicer.values import Struct

if TYPE_CHECKING:
    from printer_slicer.arrays import Bool, Float, Int
    from printer_slicer.mesh_io.limits import Limits

__all__ = ["BLOCKED", "ENFORCED", "split_painted_facets"]

ENFORCED: Final = 1
BLOCKED: Final = 2
MAX_DEPTH: Final = 20
"""Maximum number of times that a facet is split."""
DIGITS_PER_FACET: Final = 3
"""Maximum average number of digits for each facet that the limits allow."""
LONGEST_SHOWN: Final = 40
_CHILDREN: Final = (
    np.zeros((0, 3), np.int64),
    np.array([[0, 1, 4], [4, 2, 0]]),
    np.array([[0, 3, 5], [3, 1, 5], [1, 2, 5]]),
    np.array([[0, 3, 5], [3, 1, 4], [4, 2, 5], [3, 4, 5]]),
)
"""Smaller facets by number of split sides: indices of corners 0 to 2 and of the middles of sides 0-1, 1-2, 2-0."""
_DIGIT: Final = np.full(256, -1, np.int64)
_DIGIT[np.frombuffer(b"0123456789ABCDEF", np.uint8)] = np.arange(16)
_DIGIT[np.frombuffer(b"abcdef", np.uint8)] = np.arange(10, 16)


class _Trees(Struct, frozen=True, eq=False):
    """The nodes of all trees in the order of their digits.

    Attributes:
        first: (T,) the root of each tree.
        n_split: (N,) number of split sides; 0 for a leaf.
        value: (N,) state of a leaf; otherwise the corner from which corners are counted.
        tree: (N,) the tree of each node.
        end: (N,) the last node of the subtree of each node.
    """

    first: Int
    n_split: Int
    value: Int
    tree: Int
    end: Int


def split_painted_facets(
    paint: Mapping[int, str], triangles: Float, name: str, limits: Limits
) -> tuple[Float, Int]:
    """Split facets as they are painted.

    Args:
        paint: digits for each painted facet by its index.
        triangles: (F, 3, 3) of the object.
        name: path and object, for messages.
        limits: for the number of facets.

    Returns:
        The pieces (P, 3, 3) that are enforced or blocked, and the state (P,) of each, ENFORCED or BLOCKED.

    Raises:
        MeshError: the digits of a facet are not a valid tree, or there are too many; names the facet, from 1.
    """
    facets = np.fromiter(paint, np.int64, len(paint))
    trees = _read_trees(list(paint.values()), facets, name, limits)
    nodes, corners = trees.first, triangles[facets]
    found, states = [np.zeros((0, 3, 3))], [np.zeros(0, np.int64)]
    for _ in range(MAX_DEPTH + 1):
        is_leaf = trees.n_split[nodes] == 0
        state = trees.value[nodes]
        wanted = is_leaf & ((state == ENFORCED) | (state == BLOCKED))
        found.append(corners[wanted])
        states.append(state[wanted])
        if is_leaf.all():
            return np.concatenate(found), np.concatenate(states)
        nodes, corners = _split(trees, nodes[~is_leaf], corners[~is_leaf])
    facet = int(facets[trees.tree[nodes[0]]])
    raise _make_error(name, facet, f"is split more than {MAX_DEPTH} times")


def _split(trees: _Trees, nodes: Int, corners: Float) -> tuple[Int, Float]:
    """Return the children of nodes (M,) that are no leaves, with their corners (M', 3, 3)."""
    turn = (trees.value[nodes][:, None] + np.arange(3)) % 3
    corners = np.take_along_axis(corners, turn[:, :, None], axis=1)
    points = np.concatenate([corners, (corners + corners[:, [1, 2, 0]]) / 2], axis=1)
    found, pieces = [], []
    for n_split in (1, 2, 3):
        some = np.flatnonzero(trees.n_split[nodes] == n_split)
        child = nodes[some] + 1
        for row in _CHILDREN[n_split][::-1]:
            found.append(child)
            pieces.append(points[some][:, row])
            child = trees.end[np.minimum(child, len(trees.end) - 1)] + 1
    return np.concatenate(found), np.concatenate(pieces)


def _count_children(n_split: Int) -> Int:
    """Return the number of children for the number of split sides of a node."""
    return np.where(n_split > 0, n_split + 1, 0)


def _read_trees(texts: list[str], facets: Int, name: str, limits: Limits) -> _Trees:
    """Read the trees of facets and check that each is complete."""
    size = np.array([len(text) for text in texts], np.int64)
    most = DIGITS_PER_FACET * limits.facets
    if size.sum() > most:
        raise MeshError(f"{name}: the paint has more than {most} digits", remedy=EXPORT_AGAIN)
    raw = "".join(text[::-1] for text in texts).encode("latin-1", "replace")
    digit = _DIGIT[np.frombuffer(raw, np.uint8)]
    text = np.repeat(np.arange(len(texts)), size)
    is_state = _find_state_digits(digit, text)
    bad = digit < 0
    n_split = np.where(is_state, 0, digit & 3)
    bad |= (n_split > 0) & (digit >> 2 == 3)
    if bad.any() or not size.all():
        first = int(text[bad.argmax()]) if bad.any() else int(size.argmin())
        raise _make_error(name, int(facets[first]), f"has invalid paint: '{texts[first][:LONGEST_SHOWN]}'")
    node = np.flatnonzero(~is_state)
    n_split, tree = n_split[node], text[node]
    missing = np.cumsum(_count_children(n_split) - 1)
    last = np.flatnonzero(np.diff(tree, append=-1))
    _check_complete(missing, tree, last, _ends_with_leaf(digit, is_state, size), (texts, facets, name))
    return _Trees(
        np.flatnonzero(np.diff(tree, prepend=-1)),
        n_split,
        digit[node] >> 2,
        tree,
        _find_subtree_ends(n_split, missing),
    )


def _find_subtree_ends(n_split: Int, missing: Int) -> Int:
    """Return the last node (N,) of each subtree: the first at which one node less is missing than before it began."""
    n = len(missing)
    key = missing.max(initial=0) - missing
    order = np.argsort(key, kind="stable")
    sought = (key + _count_children(n_split)) * n + np.arange(n)
    return np.asarray(order[np.searchsorted(key[order] * n + order, sought)])


def _find_state_digits(digit: Int, text: Int) -> Bool:
    """Return which digits (N,) are states that belong to the digit before them, which is 12, a leaf of state 3.

    In a run of digits 12 within a text every other one is a leaf.
    """
    n = len(digit)
    begins = np.concatenate([[True], (text[1:] != text[:-1]) | (digit[:-1] != 12)])[:n]
    start = np.maximum.accumulate(np.where(begins, np.arange(n), 0))
    is_extended = (digit == 12) & ((np.arange(n) - start) % 2 == 0)
    is_state = np.zeros(n, np.bool_)
    is_state[1:] = is_extended[:-1] & (text[1:] == text[:-1])
    return is_state


def _ends_with_leaf(digit: Int, is_state: Bool, size: Int) -> Bool:
    """Return for each text (T,) whether its last digit is complete: no leaf of state 3 whose state is missing."""
    last = np.cumsum(size) - 1
    return np.asarray(is_state[last] | (digit[last] != 12))


def _check_complete(
    missing: Int, tree: Int, last: Int, is_whole: Bool, source: tuple[list[str], Int, str]
) -> None:
    """Check that each tree ends exactly at its last node.

    Raises:
        MeshError: digits are missing or left over.
    """
    texts, facets, name = source
    before = np.concatenate([[0], missing[last[:-1]]]) if len(last) else missing[:0]
    own = missing - before[tree]
    early = (own[last] >= 0) | ~is_whole
    done = np.flatnonzero(own < 0)
    late = np.zeros(len(last), np.bool_)
    late[tree[done[done < last[tree[done]]]]] = True
    if early.any() or late.any():
        k = int((early | late).argmax())
        what = "has digits after the end of its paint" if late[k] else "has paint that ends early"
        raise _make_error(name, int(facets[k]), f"{what}: '{texts[k][:LONGEST_SHOWN]}'")


def _make_error(name: str, facet: int, what: str) -> MeshError:
    """Return an error that names a facet, counted from 1."""
    return MeshError(f"{name}: triangle {facet + 1} {what}", remedy=EXPORT_AGAIN)
