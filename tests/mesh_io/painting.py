"""Write the paint of facets as PrusaSlicer stores it, and split facets one by one: an oracle for the reader."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from hypothesis import strategies as st

from printer_slicer.arrays import Float

__all__ = ["Tree", "digits_of", "painted_pieces", "trees"]

Tree = int | tuple[int, tuple["Tree", ...]]
"""The state of a facet, or the corner from which corners are counted and the smaller facets, two to four."""


def digits_of(tree: Tree) -> str:
    """The digits as they stand in the file: the last one is read first."""
    return "".join(_digits_in_order(tree))[::-1]


def _digits_in_order(tree: Tree) -> Iterator[str]:
    if isinstance(tree, int):
        yield from (f"{tree << 2:X}",) if tree < 3 else ("C", f"{tree - 3:X}")
        return
    corner, children = tree
    yield f"{(len(children) - 1) | corner << 2:X}"
    for child in reversed(children):
        yield from _digits_in_order(child)


def painted_pieces(tree: Tree, triangle: Float) -> list[tuple[int, Float]]:
    """State and corners (3, 3) of each smallest facet."""
    if isinstance(tree, int):
        return [(tree, triangle)]
    corner, children = tree
    v0, v1, v2 = np.roll(triangle, -corner, axis=0)
    a, b, c = (v0 + v1) / 2, (v1 + v2) / 2, (v2 + v0) / 2
    corners = {
        2: [(v0, v1, b), (b, v2, v0)],
        3: [(v0, a, c), (a, v1, c), (v1, v2, c)],
        4: [(v0, a, c), (a, v1, b), (b, v2, c), (a, b, c)],
    }[len(children)]
    pairs = zip(children, corners, strict=True)
    return [piece for child, some in pairs for piece in painted_pieces(child, np.array(some))]


def trees(most: int = 40, states: int = 18) -> st.SearchStrategy[Tree]:
    """Random trees of paint with states 0 to `states`."""
    return st.recursive(
        st.integers(0, states),
        lambda inner: st.tuples(st.integers(0, 2), st.lists(inner, min_size=2, max_size=4).map(tuple)),
        max_leaves=most,
    )
