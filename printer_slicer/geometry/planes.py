"""Horizontal planes against triangles, all planes at once, in integers as far as possible.

The level of a corner is the number of planes at or below it; from there on everything is integer, so there is no
tolerance and any uneven list of planes will do. A corner that lies on a plane counts as above it: the section at z is
the limit from below, and each plane crosses an edge either once or not at all.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from printer_slicer.geometry.areas import Bool, Float, Int
from printer_slicer.geometry.joints import linked, lowest_of_chain, welded

__all__ = [
    "Crossings",
    "balanced",
    "connected",
    "corner_keys",
    "cross",
    "edge_faults",
    "edge_keys",
    "lowest_of_chain",
    "section_areas",
    "spread",
]

_UInt = NDArray[np.uint64]
_FACETS_AT_ONCE = 200_000
_CORNERS_AT_ONCE = 200_000
_PAIRS_AT_ONCE = 4_000_000  # facet-plane pairs held at the same time: about 0.5 GB


@dataclass(frozen=True, slots=True, eq=False)
class Crossings:
    """What the planes leave of a mesh: nodes where edges cross planes, joined two by two by segments.

    Attributes:
        xy: (N, 2) the nodes, each computed once for all facets that share its edge.
        plane: (N,) plane of each node.
        tail: (S,) node at which each segment begins; segments are in the order of the facets, solid to the left.
        head: (S,) node at which each segment ends.
        unpaired: number of edges that do not have one facet on each side.
    """

    xy: Float
    plane: Int
    tail: Int
    head: Int
    unpaired: int


def spread(count: Int) -> tuple[Int, Int]:
    """For items that own `count` slots each: the owner of every slot, and the slot's place within its owner."""
    owner = np.repeat(np.arange(len(count)), count)
    first = np.cumsum(count) - count
    return owner, np.arange(len(owner)) - first[owner]


def cross(triangles: Float, planes: Float) -> Crossings:
    """All segments in which `planes` (P,) ascending meet `triangles` (F, 3, 3), joined through shared edges.

    A rising half-edge and the falling half-edge of the neighbouring facet have the same ends, hence the same 64-bit
    key; sorting both lists of keys pairs them without welding corners first. Where the lists differ the mesh is open
    or wrongly oriented there, and the nodes on such edges are left with one segment only.
    """
    triangles, level = _crossed(triangles, planes)
    following = [1, 2, 0]
    rise = level < level[:, following]
    fall = level > level[:, following]
    rising, falling = np.flatnonzero(rise), np.flatnonzero(fall)
    corner = triangles.reshape(-1, 3)
    tag = corner_keys(corner)
    after = np.arange(len(corner)).reshape(-1, 3)[:, following].ravel()
    low = np.concatenate([rising, after[falling]])
    high = np.concatenate([after[rising], falling])
    edge_of_rising, edge_of_falling, chosen, unpaired = _pair(_edge_key(tag, low, high), len(rising))
    low, high = low[chosen], high[chosen]
    flat_level = level.ravel()
    first, last = flat_level[low], flat_level[high]
    base = np.cumsum(last - first) - last  # node of (edge, plane) is base[edge] + plane
    owner, place = spread(last - first)
    plane = first[owner] + place
    xy = _interpolate(corner, low[owner], high[owner], planes[plane])
    bottom = level.min(axis=1)
    slot = np.cumsum(level.max(axis=1) - bottom) - level.max(
        axis=1
    )  # slot of (facet, plane) is slot[facet] + plane
    head = _nodes(rising, flat_level[rising], flat_level[after[rising]], slot, base[edge_of_rising])
    tail = _nodes(falling, flat_level[after[falling]], flat_level[falling], slot, base[edge_of_falling])
    return Crossings(xy, plane, tail, head, unpaired)


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


def balanced(tag: _UInt) -> bool:
    """Whether all edges are passed as often in one direction as in the other, from the keys of the corners (F, 3).

    A sum over all edges of their keys, with the sign of the direction: it is zero when that is so, and when it is not,
    with a chance of 2^-64.
    """
    total = 0
    for some in np.array_split(tag, len(tag) // _FACETS_AT_ONCE + 1):
        keys = some.T
        signed = np.where(keys < keys[[1, 2, 0]], 1, -1) * edge_keys(keys).view(np.int64)
        total += int(signed[keys != keys[[1, 2, 0]]].sum())
    return total % 2**64 == 0


def connected(triangles: Float) -> Int:
    """(F,) the body that each facet belongs to, from 0: facets that share corners, however far along, are one body."""
    corner, firsts = welded(corner_keys(triangles.reshape(-1, 3)))
    facet_corners = corner.reshape(-1, 3)
    return linked(facet_corners.T, len(firsts))[facet_corners[:, 0]]


def section_areas(triangles: Float, planes: Float) -> Float:
    """Area of the section at each of `planes` (P,) ascending, mm²; holes count negative.

    No contours are needed: the shoelace sum may run over the oriented segments in any order.
    """
    total = np.zeros(len(planes))
    triangles, level = _crossed(triangles, planes)
    pairs = np.cumsum(level.max(axis=1) - level.min(axis=1))
    n_chunks = int(pairs[-1]) // _PAIRS_AT_ONCE + 1 if len(pairs) else 0
    cuts = np.searchsorted(pairs, np.arange(1, n_chunks) * _PAIRS_AT_ONCE)
    for some, levels in zip(np.split(triangles, cuts), np.split(level, cuts), strict=True):
        tail, head, plane = _loose_segments(some, levels, planes)
        twice = tail[:, 0] * head[:, 1] - tail[:, 1] * head[:, 0]
        total += np.bincount(plane, weights=twice, minlength=len(planes)) / 2
    return total


def _crossed(triangles: Float, planes: Float) -> tuple[Float, Int]:
    """The facets that any plane crosses, and the levels (F', 3) of their corners."""
    level = np.searchsorted(planes, np.ascontiguousarray(triangles[:, :, 2]).ravel(), side="right").reshape(
        -1, 3
    )
    kept = (level[:, 0] != level[:, 1]) | (level[:, 1] != level[:, 2])
    return triangles[kept], level[kept]


def _loose_segments(triangles: Float, level: Int, planes: Float) -> tuple[Float, Float, Int]:
    """Tails (S, 2), heads (S, 2) and planes (S,) of all segments, each end computed per facet."""
    following = [1, 2, 0]
    corner, flat = triangles.reshape(-1, 3), level.ravel()
    after = np.arange(len(corner)).reshape(-1, 3)[:, following].ravel()
    slot = np.cumsum(level.max(axis=1) - level.min(axis=1)) - level.max(axis=1)
    n_segments = int((level.max(axis=1) - level.min(axis=1)).sum())
    ends = np.zeros((2, n_segments, 2))
    segment_plane = np.zeros(n_segments, np.int64)
    rising, falling = np.flatnonzero(flat < flat[after]), np.flatnonzero(flat > flat[after])
    for side, edge, low, high in ((0, falling, after[falling], falling), (1, rising, rising, after[rising])):
        owner, place = spread(flat[high] - flat[low])
        plane = flat[low][owner] + place
        where = slot[edge // 3][owner] + plane
        ends[side, where] = _interpolate(corner, low[owner], high[owner], planes[plane])
        segment_plane[where] = plane
    return ends[0], ends[1], segment_plane


def _interpolate(corner: Float, low: Int, high: Int, z: Float) -> Float:
    """(n, 2) where the edges from `low` to `high` corners reach height `z`; exact at both ends."""
    # Column by column: gathering from three contiguous arrays takes a third of the time of gathering rows of three.
    xs, ys, zs = np.ascontiguousarray(corner.T)
    bottom = zs[low]
    ratio = (z - bottom) / (zs[high] - bottom)
    # Rounding of the sum must not make a corner that lies on the plane differ from its own coordinates.
    on_plane = np.flatnonzero(ratio == 1)
    xy = np.zeros((len(z), 2))
    for axis, column in enumerate((xs, ys)):
        start, end = column[low], column[high]
        value = start + ratio * (end - start)
        value[on_plane] = end[on_plane]
        xy[:, axis] = value
    return xy


def _nodes(half_edge: Int, first: Int, last: Int, slot: Int, base: Int) -> Int:
    """(S,) the node that each facet-plane pair has on its rising (or falling) side."""
    owner, place = spread(last - first)
    plane = first[owner] + place
    nodes = np.zeros(len(owner), np.int64)
    nodes[slot[half_edge // 3][owner] + plane] = base[owner] + plane
    return nodes


def corner_keys(corner: Float) -> _UInt:
    """(n,) 64 bits from the coordinates (n, 3) of each corner; equal coordinates, equal bits."""
    mixed = np.zeros(len(corner), np.uint64)
    for at in range(0, len(corner), _CORNERS_AT_ONCE):
        some = slice(at, at + _CORNERS_AT_ONCE)
        bits = (corner[some] + 0.0).view(np.uint64)  # adding zero turns -0.0 into 0.0
        keys = bits[:, 0] * np.uint64(0x9E3779B97F4A7C15)
        keys ^= keys >> np.uint64(29)
        keys += bits[:, 1]
        keys *= np.uint64(0xBF58476D1CE4E5B9)
        keys ^= keys >> np.uint64(32)
        keys += bits[:, 2]
        keys *= np.uint64(0x94D049BB133111EB)
        mixed[some] = keys ^ (keys >> np.uint64(31))
    return mixed


def edge_keys(tag: _UInt) -> _UInt:
    """(3, F) 64 bits for the edge after each corner, from the keys of the corners; both directions have the same."""
    after = tag[[1, 2, 0]]
    return _mixed(np.minimum(tag, after), np.maximum(tag, after))


def _edge_key(tag: _UInt, low: Int, high: Int) -> _UInt:
    """One key per edge from the tags of its ends; which end is lower matters."""
    return _mixed(tag[low], tag[high])


def _mixed(low: _UInt, high: _UInt) -> _UInt:
    key = (low * np.uint64(0xD6E8FEB86659FD93)) ^ high
    key ^= key >> np.uint64(32)
    return np.asarray(key * np.uint64(0xD6E8FEB86659FD93))


def _pair(key: _UInt, n_rising: int) -> tuple[Int, Int, Int, int]:
    """Number the edges.

    Args:
        key: keys of all rising half-edges, then of all falling ones.
        n_rising: how many are rising.

    Returns:
        Edge of each rising half-edge, edge of each falling one, one half-edge (index into `key`) per edge, and how
        many half-edges have no partner.
    """
    n_falling = len(key) - n_rising
    by_rising = np.argsort(key[:n_rising], kind="stable")
    by_falling = np.argsort(key[n_rising:], kind="stable")
    rising_keys, falling_keys = key[:n_rising][by_rising], key[n_rising:][by_falling]
    edge_of_rising, edge_of_falling = np.zeros(n_rising, np.int64), np.zeros(n_falling, np.int64)
    if n_rising == n_falling and np.array_equal(rising_keys, falling_keys):
        edge_of_rising[by_rising] = np.arange(n_rising)
        edge_of_falling[by_falling] = np.arange(n_falling)
        return edge_of_rising, edge_of_falling, by_rising, 0
    # Copies of one key pair up by rank: the k-th rising with the k-th falling; the rest stays alone.
    rank_rising = np.arange(n_rising) - np.searchsorted(rising_keys, rising_keys)
    partner = np.searchsorted(falling_keys, rising_keys) + rank_rising
    inside = np.minimum(partner, max(n_falling - 1, 0))
    paired = (
        (partner < n_falling) & (falling_keys[inside] == rising_keys)
        if n_falling
        else np.zeros(n_rising, bool)
    )
    alone = np.ones(n_falling, bool)
    alone[partner[paired]] = False
    edge_of_rising[by_rising] = np.arange(n_rising)
    numbers = np.zeros(n_falling, np.int64)
    numbers[partner[paired]] = np.flatnonzero(paired)
    numbers[alone] = n_rising + np.arange(int(alone.sum()))
    edge_of_falling[by_falling] = numbers
    chosen = np.concatenate([by_rising, n_rising + by_falling[alone]])
    return edge_of_rising, edge_of_falling, chosen, int((~paired).sum() + alone.sum())
