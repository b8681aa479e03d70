"""Check whether a mesh is one closed surface that faces outward and needs no repair, as most parts are."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from printer_slicer.arrays import Bool, Float
from printer_slicer.geometry.connectivity import Index, label_components, weld_keys
from printer_slicer.geometry.facet_topology import coordinate_keys, edge_keys
from printer_slicer.kernel import load_kernel

__all__ = ["is_sound"]

_MIN_VOLUME_RATIO = 1e-6  # of the volume below all facets: less than this is rounding
_FACETS_AT_ONCE = 1 << 15  # facets whose edges stay in the processor's cache
_Keys = NDArray[np.uint64]


class _Edges(NamedTuple):
    """The edges of a block of facets without a partner in the block, and the block's connected pieces.

    Attributes:
        key: (n,) key of each edge, the same for both directions.
        upward: (n,) whether the facet uses it towards the corner with the higher key.
        piece: (n,) the piece of the block that the facet belongs to.
        pieces: number of pieces in the block.
    """

    key: _Keys
    upward: Bool
    piece: Index
    pieces: int


def is_sound(triangles: Float) -> bool:
    """Return whether facets (F, 3, 3) are one closed surface that faces outward.

    Every edge must have one facet on each side, and all facets must be connected by edges; bodies that touch only in a
    corner or an edge do not count as connected. Where a body touches itself along an edge, the result may depend on
    the blocks.
    """
    blocks, volume, shaded = [], 0.0, 0.0
    bottom = float(triangles[:, :, 2].min(initial=0.0))
    for at in range(0, len(triangles), _FACETS_AT_ONCE):
        x, y, z = np.ascontiguousarray(triangles[at : at + _FACETS_AT_ONCE].transpose(2, 1, 0))
        blocks.append(_match_edges(x.ravel(), y.ravel(), z.ravel()))
        # Sum the columns between the lowest corner and each facet; columns below facets that face down are negative.
        columns = (x[1] - x[0]) * (y[2] - y[0]) - (x[2] - x[0]) * (y[1] - y[0])
        columns *= z[0] + z[1] + z[2] - 3 * bottom
        volume += float(columns.sum())
        shaded += float(np.abs(columns).sum())
    return volume > _MIN_VOLUME_RATIO * shaded and _is_one_closed_surface(blocks)


def _match_edges(x: Float, y: Float, z: Float) -> _Edges:
    """Match the edges of a block of n facets, given the coordinates of their corners (3 n,), the first corners first.

    Returns:
        The unmatched edges.
    """
    kernel = load_kernel()
    if kernel:
        return _read_edges(kernel.match_edges(x, y, z))
    tag = coordinate_keys(x, y, z).reshape(3, -1)
    key, upward = edge_keys(tag).ravel(), (tag < tag[[1, 2, 0]]).ravel()
    n = tag.shape[1]
    number, firsts = weld_keys(key)
    passes = np.bincount(number, minlength=len(firsts)), np.bincount(number[upward], minlength=len(firsts))
    joined = (passes[0] == 2) & (passes[1] == 1)
    beside = np.zeros((2, len(firsts)), np.int32)
    for side, which in enumerate((np.flatnonzero(upward), np.flatnonzero(~upward))):
        beside[side, number[which]] = which % n
    piece = label_components(beside.compress(joined, axis=1), n)
    alone = np.flatnonzero(~joined[number])
    return _Edges(key[alone], upward[alone], piece[alone % n].astype(np.int32), int(piece.max()) + 1)


def _read_edges(made: tuple[bytes, bytes, bytes, bytes]) -> _Edges:
    """Return the edges that the compiled kernel found."""
    key, upward, piece, pieces = made
    n_pieces = int(np.frombuffer(pieces, np.int64)[0])
    return _Edges(
        np.frombuffer(key, np.uint64),
        np.frombuffer(upward, np.bool_),
        np.frombuffer(piece, np.int32),
        n_pieces,
    )


def _is_one_closed_surface(blocks: list[_Edges]) -> bool:
    """Return whether the unmatched edges of all blocks pair up and connect all pieces."""
    key = np.concatenate([block.key for block in blocks])
    upward = np.concatenate([block.upward for block in blocks])
    offset = np.cumsum([0, *(block.pieces for block in blocks)])
    piece = np.concatenate([block.piece + first for block, first in zip(blocks, offset, strict=False)])
    n_edges = len(key) // 2
    if 2 * n_edges != len(key) or np.count_nonzero(upward) != n_edges:
        return False
    number, firsts = weld_keys(key)
    if len(firsts) != n_edges:
        return False
    beside = np.full((2, n_edges), -1, np.int32)
    for side, which in enumerate((np.flatnonzero(upward), np.flatnonzero(~upward))):
        beside[side, number[which]] = piece[which]
    return int(beside.min(initial=0)) >= 0 and int(label_components(beside, int(offset[-1])).max()) == 0
