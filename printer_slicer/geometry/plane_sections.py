"""Intersect triangles with horizontal planes, and join the segments through shared edges.

The level of a corner is the number of planes at or below it. All decisions use these integers, so there is no
tolerance, and the planes may have any spacing. A corner that lies on a plane counts as above it: the section at z is
the limit from below, and each plane crosses an edge once or not at all.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from printer_slicer.arrays import Bool, Float, Int, reorder_points
from printer_slicer.geometry.areas import Areas
from printer_slicer.geometry.connectivity import Index, find_cycles, weld_keys
from printer_slicer.geometry.facet_topology import coordinate_keys, directed_edge_keys, expand_counts
from printer_slicer.geometry.vectors import cross
from printer_slicer.kernel import load_kernel
from printer_slicer.values import Struct

__all__ = ["Crossings", "intersect_with_planes", "section_areas", "section_contours"]

_SEGMENTS_AT_ONCE = 60_000  # per batch, so that the arrays stay in the processor's cache
_UInt = NDArray[np.uint64]


class Crossings(Struct, frozen=True, eq=False):
    """Sections of a mesh: nodes where its edges cross planes, and segments that join pairs of nodes.

    Attributes:
        xy: (N, 2) the nodes, each computed once for all facets that share its edge.
        plane: (N,) plane of each node.
        tail: (S,) node at which each segment starts; the solid lies to the left of the segment.
        head: (S,) node at which each segment ends.
        unpaired: number of edges that do not have one facet on each side.
    """

    xy: Float
    plane: Int
    tail: Int
    head: Int
    unpaired: int


def intersect_with_planes(triangles: Float, planes: Float) -> Iterator[Crossings]:
    """Yield the segments where `planes` (P,), ascending, cut `triangles` (F, 3, 3), joined through shared edges.

    A rising half-edge and the falling half-edge of the neighbouring facet have the same ends, hence the same 64-bit
    key. Equal keys pair them without welding corners first. Where half-edges remain unpaired, the mesh is open or
    wrongly oriented, and the nodes on such edges have only one segment.

    Planes are processed in batches of about 60 000 segments, so that memory is bounded for any mesh.
    """
    level = np.zeros((3, len(triangles)), np.int32)
    for corner in range(3):
        level[corner] = np.searchsorted(planes, np.ascontiguousarray(triangles[:, corner, 2]), side="right")
    for facets, low, high in _split_into_batches(level, len(planes)):
        yield _cross_planes(triangles.take(facets, axis=0), level.take(facets, axis=1), planes, low, high)


def section_areas(triangles: Float, planes: Float) -> Float:
    """Return the area of the section at each of `planes` (P,) ascending, mm²; holes count negative.

    This needs no contours: the shoelace sum works on the oriented segments in any order.
    """
    total = np.zeros(len(planes))
    for part in intersect_with_planes(triangles, planes):
        tail, head = part.xy.take(part.tail, axis=0), part.xy.take(part.head, axis=0)
        twice = cross(tail, head)
        total += np.bincount(part.plane[part.tail], weights=twice, minlength=len(planes)) / 2
    return total


def section_contours(triangles: Float, planes: Float) -> Areas:
    """Return the contours of the section at each of `planes` (P,) ascending, one layer per plane; they may overlap.

    Open contours are closed from any end to any start.
    """
    n = len(planes)
    return Areas.concatenate([_join_rings(part, n) for part in intersect_with_planes(triangles, planes)], n)


def _split_into_batches(level: Index, n_planes: int) -> Iterator[tuple[Int, int, int]]:
    """Yield batches: facets, the first plane that they cross, and the plane after the last one."""
    bottom = np.minimum(np.minimum(level[0], level[1]), level[2])
    top = np.maximum(np.maximum(level[0], level[1]), level[2])
    crossing = np.flatnonzero(bottom < top)
    bottom, top = bottom[crossing], top[crossing]
    change = np.bincount(bottom, minlength=n_planes + 1) - np.bincount(top, minlength=n_planes + 1)
    segments = np.cumsum(np.cumsum(change))  # up to and including each plane
    low = 0
    while low < n_planes and len(crossing):
        before = int(segments[low - 1]) if low else 0
        high = max(int(np.searchsorted(segments, before + _SEGMENTS_AT_ONCE, side="right")), low + 1)
        high = min(high, n_planes)
        yield crossing[(bottom < high) & (top > low)], low, high
        low = high


class _HalfEdges(NamedTuple):
    """Edges of facets that planes cross, from the lower end to the upper one.

    Attributes:
        item: (H,) the start corner in its facet, as corner times number of facets plus facet.
        low, high: (H,) the corners at its ends, numbered likewise.
    """

    item: Int
    low: Int
    high: Int


def _cross_planes(triangles: Float, level: Index, planes: Float, low: int, high: int) -> Crossings:
    """Return the segments in the planes from `low` up to `high`, given the facets that cross these planes."""
    corners = np.ascontiguousarray(triangles.transpose(2, 1, 0))
    x, y, z = corners  # (3, n): corner, facet
    clipped = np.clip(level, low, high)
    after = clipped[[1, 2, 0]]
    rising, falling = _select_half_edges(clipped < after), _select_half_edges(clipped > after, turned=True)
    tag = coordinate_keys(x.ravel(), y.ravel(), z.ravel())
    key = np.concatenate(
        [directed_edge_keys(tag.take(side.low), tag.take(side.high)) for side in (rising, falling)]
    )
    edge_of_rising, edge_of_falling, chosen, alone = _pair_half_edges(key, len(rising.item))
    ends = [
        np.concatenate([one, other]).take(chosen) for one, other in zip(rising[1:], falling[1:], strict=True)
    ]
    flat = clipped.ravel().astype(np.int64)
    first, last = flat.take(ends[0]), flat.take(ends[1])
    base = np.cumsum(last - first) - last  # node of (edge, plane) is base[edge] + plane
    xy, plane = _cut_edges(corners, flat, ends[0], ends[1], planes)
    bottom = np.minimum(np.minimum(clipped[0], clipped[1]), clipped[2])
    top = np.maximum(np.maximum(clipped[0], clipped[1]), clipped[2])
    slot = np.cumsum(top - bottom) - top  # the slot of (facet, plane) is slot[facet] + plane
    head = _find_nodes(rising, flat, slot, base.take(edge_of_rising))
    tail = _find_nodes(falling, flat, slot, base.take(edge_of_falling))
    # An edge that spans several batches counts in the batch where it starts.
    unpaired = int((level.ravel()[ends[0][alone]] >= low).sum())
    return Crossings(xy, plane, tail, head, unpaired)


def _select_half_edges(which: Bool, *, turned: bool = False) -> _HalfEdges:
    """Return the half-edges for which the mask `which` (3, n) is true; `turned` marks those that run downward."""
    item = np.flatnonzero(which)
    after = item + which.shape[1]
    after[after >= which.size] -= which.size
    return _HalfEdges(item, after, item) if turned else _HalfEdges(item, item, after)


def _find_nodes(half_edges: _HalfEdges, level: Int, slot: Int, base: Int) -> Int:
    """Return the node (S,) where each plane crosses the rising (or falling) half-edge of its facet."""
    kernel = load_kernel()
    if kernel:
        edges = np.stack([*half_edges, base])
        return np.frombuffer(kernel.number_cuts(level.data, edges.data, slot.data), np.int64)
    first = level.take(half_edges.low)
    owner, place = expand_counts(level.take(half_edges.high) - first)
    plane = first.take(owner) + place
    nodes = np.zeros(len(owner), np.int64)
    nodes[slot.take(half_edges.item % len(slot)).take(owner) + plane] = base.take(owner) + plane
    return nodes


def _cut_edges(corners: Float, level: Int, low: Int, high: Int, planes: Float) -> tuple[Float, Int]:
    """Return the points (N, 2) where planes cut edges, edge by edge, and the plane (N,) of each.

    Args:
        corners: (3, 3, n) x, y and z of the corners.
        level: (3 * n,) number of planes at or below each corner.
        low: (E,) corner at the lower end of each edge.
        high: (E,) corner at its upper end.
        planes: (P,) heights of the planes.
    """
    kernel = load_kernel()
    if kernel:
        arrays = (np.ascontiguousarray(array).data for array in (corners, level, low, high, planes))
        xy, plane = kernel.cut_edges(*arrays)
        return np.frombuffer(xy, np.float64).reshape(-1, 2), np.frombuffer(plane, np.int64)
    first = level.take(low)
    owner, place = expand_counts(level.take(high) - first)
    planes_of = first.take(owner) + place
    x, y, z = corners.reshape(3, -1)
    return _interpolate((x, y, z), low.take(owner), high.take(owner), planes.take(planes_of)), planes_of


def _interpolate(corner: tuple[Float, Float, Float], low: Int, high: Int, z: Float) -> Float:
    """Return points (n, 2) where the edges from corner `low` to corner `high` reach height `z`, exact at both ends."""
    *across, zs = corner
    bottom = zs.take(low)
    ratio = (z - bottom) / (zs.take(high) - bottom)
    # A corner that lies on the plane must keep its exact coordinates.
    on_plane = np.flatnonzero(ratio == 1)
    xy = np.zeros((len(z), 2))
    for axis, column in enumerate(across):
        start, end = column.take(low), column.take(high)
        value = start + ratio * (end - start)
        value[on_plane] = end[on_plane]
        xy[:, axis] = value
    return xy


def _pair_half_edges(key: _UInt, n_rising: int) -> tuple[Int, Int, Int, Int]:
    """Number the edges, and pair the two half-edges of each.

    Args:
        key: keys of all rising half-edges, then of all falling ones.
        n_rising: number of rising half-edges.

    Returns:
        The edge of each rising half-edge, the edge of each falling one, one half-edge (index into `key`) per edge, and
        the edges of half-edges without a partner.
    """
    edge, one = weld_keys(key)
    rising, falling = edge[:n_rising], edge[n_rising:]
    n_edges = len(one)
    if n_edges == n_rising == len(falling) and all(
        np.bincount(side, minlength=n_edges).max(initial=1) == 1 for side in (rising, falling)
    ):
        return rising.astype(np.int64), falling.astype(np.int64), one.astype(np.int64), np.zeros(0, np.int64)
    # Copies of the same key pair by rank: the k-th rising with the k-th falling one; the rest stays unpaired.
    ranks = [_count_earlier_equal(side, n_edges) for side in (rising, falling)]
    copy = np.concatenate(ranks) * np.int64(n_edges) + edge
    _, chosen, number, count = np.unique(copy, return_index=True, return_inverse=True, return_counts=True)
    return number[:n_rising], number[n_rising:], chosen, np.flatnonzero(count == 1)


def _count_earlier_equal(edge: Index, n_edges: int) -> Int:
    """Return for each entry the number (n,) of earlier entries with the same edge."""
    order = np.argsort(edge, kind="stable")
    begin = np.cumsum(np.bincount(edge, minlength=n_edges)) - np.bincount(edge, minlength=n_edges)
    rank = np.zeros(len(edge), np.int64)
    rank[order] = np.arange(len(edge)) - begin[edge[order]]
    return rank


def _join_rings(part: Crossings, n_planes: int) -> Areas:
    """Join the segments of several planes into rings; open contours are closed from any end to any start."""
    following = np.arange(len(part.xy))
    following[part.tail] = part.head
    if part.unpaired:
        begins, ends = np.setdiff1d(part.tail, part.head), np.setdiff1d(part.head, part.tail)
        following[ends[np.argsort(part.plane[ends], kind="stable")]] = begins[
            np.argsort(part.plane[begins], kind="stable")
        ]
    ring, rank = find_cycles(following)
    first = np.flatnonzero(rank == 0)
    first = first[np.argsort(part.plane[first], kind="stable")]
    start = np.append(0, np.cumsum(np.bincount(ring, minlength=len(ring))[first]))
    place_of_ring = np.zeros(len(ring), np.int64)
    place_of_ring[first] = start[:-1]
    return Areas(reorder_points(part.xy, place_of_ring.take(ring) + rank), start, part.plane[first], n_planes)
