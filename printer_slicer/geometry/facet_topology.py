"""Topology of unconnected triangles: keys that identify equal corners and edges, edge faults, and bodies."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from printer_slicer.arrays import Bool, Float, Int
from printer_slicer.geometry.connectivity import label_components, weld_keys
from printer_slicer.kernel import load_kernel

__all__ = [
    "coordinate_keys",
    "corner_keys",
    "directed_edge_keys",
    "edge_keys",
    "expand_counts",
    "find_edge_faults",
    "label_bodies",
    "may_have_neighbours",
]

_UInt = NDArray[np.uint64]
_FACTORS = np.array(
    [0x9E3779B97F4A7C15, 0xBF58476D1CE4E5B9, 0x94D049BB133111EB, 0xD6E8FEB86659FD93], np.uint64
)
_CORNERS_AT_ONCE = 3 << 15
_WIDE_CELLS = 64  # cell width in distances
_AT_BORDER = 1 / 60  # of a wide cell: the distance, with a margin for rounded coordinates


def expand_counts(count: Int) -> tuple[Int, Int]:
    """Repeat the index of each item `count` times; return these indices, and 0, 1, 2, ... within each item."""
    owner = np.repeat(np.arange(len(count)), count)
    first = np.cumsum(count) - count
    return owner, np.arange(len(owner)) - first.take(owner)


def find_edge_faults(triangles: Float) -> tuple[Float, Float, Float]:
    """Find the edges of a mesh that do not join exactly two consistently oriented facets.

    Args:
        triangles: (F, 3, 3) mm.

    Returns:
        Middle points, each (n, 3) mm: of edges with one facet, of edges whose two facets face opposite directions, and
        of edges that more than two facets share. Corners are equal if their coordinates are.
    """
    tag = corner_keys(triangles.reshape(-1, 3)).reshape(-1, 3).T
    after = tag[[1, 2, 0]]
    used = np.flatnonzero(tag != after)  # edges without length belong to facets without area
    edge, firsts = weld_keys(edge_keys(tag).ravel()[used])
    count = np.bincount(edge, minlength=len(firsts))
    net = 2 * np.bincount(edge[(tag < after).ravel()[used]], minlength=len(firsts)) - count

    def middle_points(mask: Bool) -> Float:
        """Return the (n, 3) middle points of the masked edges, in order of their first occurrence."""
        corner, facet = np.divmod(used[np.sort(firsts[mask])], len(triangles))
        return np.asarray((triangles[facet, corner] + triangles[facet, (corner + 1) % 3]) / 2)

    return middle_points(count == 1), middle_points((count == 2) & (net != 0)), middle_points(count > 2)


def label_bodies(triangles: Float) -> Int:
    """Return the body (F,) of each facet, from 0: facets connected through shared corners are one body."""
    corner, firsts = weld_keys(corner_keys(triangles.reshape(-1, 3)))
    facet_corners = corner.reshape(-1, 3)
    return label_components(facet_corners.T, len(firsts))[facet_corners[:, 0]]


def corner_keys(corner: Float) -> _UInt:
    """Return 64-bit keys (n,) of corners with coordinates (n, 3); equal coordinates give equal keys."""
    mixed = np.zeros(len(corner), np.uint64)
    for at in range(0, len(corner), _CORNERS_AT_ONCE):
        some = slice(at, at + _CORNERS_AT_ONCE)
        mixed[some] = coordinate_keys(*corner[some].T)
    return mixed


def coordinate_keys(x: Float, y: Float, z: Float) -> _UInt:
    """Return the keys (n,) that `corner_keys` returns, given the coordinates as separate columns (n,).

    Multiplication carries a bit to higher bits only. Coordinates of symmetric parts differ in their highest bit, the
    sign, and in the last bits that 32-bit files have. Rotation moves both to the low end, so that either changes most
    bits of the key.
    """
    kernel = load_kernel()
    if kernel:
        columns = (np.ascontiguousarray(column, np.float64) for column in (x, y, z))
        return np.frombuffer(kernel.coordinate_keys(*columns), np.uint64)
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
    """Return a mask (n,) of points that may have another point within `distance` along every axis.

    All other points surely have none. This is cheaper than sorting: two near points lie in the same wide cell, or both
    lie near the border between their cells.

    Args:
        points: (n, 3) mm, or (n, 2) if `plane` is given.
        distance: mm.
        plane: (n,) plane of each point; only points of the same plane are near each other.
        shift: offset of the cells as a fraction of their width; a different shift gives other borders.
    """
    place = points / (_WIDE_CELLS * distance) + shift
    cell = np.floor(place)
    place -= cell
    at_border = (np.minimum(place, 1 - place) <= _AT_BORDER).any(axis=1)
    n = len(points)
    bits = n.bit_length() + 3
    key = corner_keys(cell if plane is None else np.column_stack([cell, plane]))
    bucket = (key >> np.uint64(64 - bits)).view(np.int64)
    # The last point written to a bucket stays. A point that finds another one there shares the bucket with it.
    last, itself = np.zeros(1 << bits, np.int32), np.arange(n, dtype=np.int32)
    last[bucket] = itself
    several = np.zeros(1 << bits, np.bool_)
    several[bucket[last[bucket] != itself]] = True
    return np.asarray(at_border | several[bucket])


def edge_keys(tag: _UInt) -> _UInt:
    """Return the 64-bit key (3, F) of the edge that starts at each corner, from the keys of the corners.

    Both directions of an edge have the same key.
    """
    after = tag[[1, 2, 0]]
    return directed_edge_keys(np.minimum(tag, after), np.maximum(tag, after))


def directed_edge_keys(low: _UInt, high: _UInt) -> _UInt:
    """Return 64-bit keys (n,) of directed edges from the keys of their ends; the two directions differ."""
    key = (low * np.uint64(0xD6E8FEB86659FD93)) ^ high
    key ^= key >> np.uint64(32)
    return np.asarray(key * np.uint64(0xD6E8FEB86659FD93))
