"""Triangles as loose corners: keys that make equal corners and edges known, and what edges tell of a surface."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from printer_slicer.geometry.areas import Bool, Float, Int
from printer_slicer.geometry.joints import linked, welded

__all__ = [
    "connected",
    "corner_keys",
    "directed_keys",
    "edge_faults",
    "edge_keys",
    "keys_of",
    "spread",
]

_UInt = NDArray[np.uint64]
_FACTORS = np.array(
    [0x9E3779B97F4A7C15, 0xBF58476D1CE4E5B9, 0x94D049BB133111EB, 0xD6E8FEB86659FD93], np.uint64
)
_CORNERS_AT_ONCE = 3 << 15


def spread(count: Int) -> tuple[Int, Int]:
    """For items that own `count` slots each: the owner of every slot, and the slot's place within its owner."""
    owner = np.repeat(np.arange(len(count)), count)
    first = np.cumsum(count) - count
    return owner, np.arange(len(owner)) - first.take(owner)


def edge_faults(triangles: Float) -> tuple[Float, Float, Float]:
    """Edges of a mesh that do not have one facet on each side.

    Args:
        triangles: (F, 3, 3) mm.

    Returns:
        Middle points, each (n, 3) mm: of edges with one facet, of edges whose two facets face opposite ways, and of
        edges that more than two facets share. Equal coordinates make equal corners.
    """
    tag = corner_keys(triangles.reshape(-1, 3)).reshape(-1, 3).T
    after = tag[[1, 2, 0]]
    used = np.flatnonzero(tag != after)  # an edge of no length belongs to a facet of no area
    edge, firsts = welded(edge_keys(tag).ravel()[used])
    count = np.bincount(edge, minlength=len(firsts))
    net = 2 * np.bincount(edge[(tag < after).ravel()[used]], minlength=len(firsts)) - count

    def middles(of: Bool) -> Float:
        corner, facet = np.divmod(used[np.sort(firsts[of])], len(triangles))
        return np.asarray((triangles[facet, corner] + triangles[facet, (corner + 1) % 3]) / 2)

    return middles(count == 1), middles((count == 2) & (net != 0)), middles(count > 2)


def connected(triangles: Float) -> Int:
    """(F,) the body that each facet belongs to, from 0: facets that share corners, however far along, are one body."""
    corner, firsts = welded(corner_keys(triangles.reshape(-1, 3)))
    facet_corners = corner.reshape(-1, 3)
    return linked(facet_corners.T, len(firsts))[facet_corners[:, 0]]


def corner_keys(corner: Float) -> _UInt:
    """(n,) 64 bits from the coordinates (n, 3) of each corner; equal coordinates, equal bits."""
    mixed = np.zeros(len(corner), np.uint64)
    for at in range(0, len(corner), _CORNERS_AT_ONCE):
        some = slice(at, at + _CORNERS_AT_ONCE)
        mixed[some] = keys_of(*corner[some].T)
    return mixed


def keys_of(x: Float, y: Float, z: Float) -> _UInt:
    """(n,) the same from columns (n,) of coordinates.

    A product carries a bit to higher ones only. Coordinates of symmetric parts differ in their highest bit, the sign,
    and in the last ones that 32-bit files have: turned so that both stand low, either changes most bits of the key.
    """
    keys = np.zeros(len(x), np.uint64)
    for column, factor in zip((x, y, z), _FACTORS[:3], strict=True):
        bits = (column + 0.0).view(np.uint64)  # adding zero turns -0.0 into 0.0
        keys ^= bits << np.uint64(23)
        keys ^= bits >> np.uint64(41)
        keys *= factor
        keys ^= keys >> np.uint64(29)
    keys *= _FACTORS[3]
    keys ^= keys >> np.uint64(32)
    return keys


def edge_keys(tag: _UInt) -> _UInt:
    """(3, F) 64 bits for the edge after each corner, from the keys of the corners; both directions have the same."""
    after = tag[[1, 2, 0]]
    return directed_keys(np.minimum(tag, after), np.maximum(tag, after))


def directed_keys(low: _UInt, high: _UInt) -> _UInt:
    """(n,) 64 bits for edges from one end to the other, from the keys of the ends; the other way they differ."""
    key = (low * np.uint64(0xD6E8FEB86659FD93)) ^ high
    key ^= key >> np.uint64(32)
    return np.asarray(key * np.uint64(0xD6E8FEB86659FD93))
