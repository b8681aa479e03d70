"""Triangles as loose corners: keys that make equal corners and edges known, and what edges tell of a surface."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from printer_slicer.arrays import Bool, Float, Int
from printer_slicer.geometry.connectivity import label_components, weld_keys

__all__ = [
    "corner_keys",
    "directed_keys",
    "edge_keys",
    "find_edge_faults",
    "keys_of",
    "label_bodies",
    "may_have_neighbours",
    "spread",
]

_UInt = NDArray[np.uint64]
_FACTORS = np.array(
    [0x9E3779B97F4A7C15, 0xBF58476D1CE4E5B9, 0x94D049BB133111EB, 0xD6E8FEB86659FD93], np.uint64
)
_CORNERS_AT_ONCE = 3 << 15
_WIDE_CELLS = 64  # distances
_AT_BORDER = 1 / 60  # of a wide cell; more than the distance, by more than coordinates are rounded


def spread(count: Int) -> tuple[Int, Int]:
    """For items that own `count` slots each: the owner of every slot, and the slot's place within its owner."""
    owner = np.repeat(np.arange(len(count)), count)
    first = np.cumsum(count) - count
    return owner, np.arange(len(owner)) - first.take(owner)


def find_edge_faults(triangles: Float) -> tuple[Float, Float, Float]:
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
    edge, firsts = weld_keys(edge_keys(tag).ravel()[used])
    count = np.bincount(edge, minlength=len(firsts))
    net = 2 * np.bincount(edge[(tag < after).ravel()[used]], minlength=len(firsts)) - count

    def middles(of: Bool) -> Float:
        """(n, 3) of some of the edges, in the order in which they first come up."""
        corner, facet = np.divmod(used[np.sort(firsts[of])], len(triangles))
        return np.asarray((triangles[facet, corner] + triangles[facet, (corner + 1) % 3]) / 2)

    return middles(count == 1), middles((count == 2) & (net != 0)), middles(count > 2)


def label_bodies(triangles: Float) -> Int:
    """(F,) the body that each facet belongs to, from 0: facets that share corners, however far along, are one body."""
    corner, firsts = weld_keys(corner_keys(triangles.reshape(-1, 3)))
    facet_corners = corner.reshape(-1, 3)
    return label_components(facet_corners.T, len(firsts))[facet_corners[:, 0]]


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


def may_have_neighbours(
    points: Float, distance: float, *, plane: Int | None = None, shift: float = 0.0
) -> Bool:
    """(n,) all points but those that surely have no other within `distance` along every axis; cheaper than sorting.

    Two that are near lie in one wide cell, or the border between their cells is near to both.

    Args:
        points: (n, 3) mm, or (n, 2) with the number of the `plane` (n,) on which each lies.
        distance: mm.
        plane: only points of one plane are near to each other.
        shift: of the cells, in their width: what is at a border of some is in the middle of others.
    """
    place = points / (_WIDE_CELLS * distance) + shift
    cell = np.floor(place)
    place -= cell
    at_border = (np.minimum(place, 1 - place) <= _AT_BORDER).any(axis=1)
    n = len(points)
    bits = n.bit_length() + 3
    key = corner_keys(cell if plane is None else np.column_stack([cell, plane]))
    bucket = (key >> np.uint64(64 - bits)).view(np.int64)
    # Who comes last to a bucket stands there; whoever finds another one there is not alone, nor is that one.
    last, itself = np.zeros(1 << bits, np.int32), np.arange(n, dtype=np.int32)
    last[bucket] = itself
    several = np.zeros(1 << bits, np.bool_)
    several[bucket[last[bucket] != itself]] = True
    return np.asarray(at_border | several[bucket])


def edge_keys(tag: _UInt) -> _UInt:
    """(3, F) 64 bits for the edge after each corner, from the keys of the corners; both directions have the same."""
    after = tag[[1, 2, 0]]
    return directed_keys(np.minimum(tag, after), np.maximum(tag, after))


def directed_keys(low: _UInt, high: _UInt) -> _UInt:
    """(n,) 64 bits for edges from one end to the other, from the keys of the ends; the other way they differ."""
    key = (low * np.uint64(0xD6E8FEB86659FD93)) ^ high
    key ^= key >> np.uint64(32)
    return np.asarray(key * np.uint64(0xD6E8FEB86659FD93))
