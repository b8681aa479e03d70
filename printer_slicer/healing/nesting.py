"""Find the surfaces that enclose each of many points: winding numbers and solid angles."""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Float, Int
from printer_slicer.geometry.facet_topology import expand_counts

__all__ = ["compute_winding_numbers", "measure_coverage"]

_FACETS_AT_ONCE = 1 << 16  # facets whose bounding boxes are looked up at a time
_PAIRS_AT_ONCE = 1 << 19  # points times facets
_MAX_PAIRS = 20_000_000
_PairValues = tuple[Int, Int, Float]


def compute_winding_numbers(triangles: Float, owner: Int, places: Float) -> _PairValues:
    """Return winding numbers: facets above a point that face up minus facets above it that face down.

    Args:
        triangles: (F, 3, 3) mm.
        owner: (F,) the surface of each facet.
        places: (n, 3) points, mm, on no surface.

    Returns:
        Index of the point, surface and winding number (m,) of each pair where that is not 0; by point, then surface.
    """
    from printer_slicer.geometry.planar import SegmentTree  # noqa: PLC0415 - shapely only when it is needed

    if not len(places) or not len(triangles):
        return _sum_equal_pairs([], int(owner.max(initial=0)) + 1)
    tree = SegmentTree(np.stack([places[:, :2], places[:, :2]], axis=1))
    low, high = places.min(axis=0), places.max(axis=0)
    found: list[_PairValues] = []
    for at in range(0, len(triangles), _FACETS_AT_ONCE):
        block = triangles[at : at + _FACETS_AT_ONCE]
        bottom, top = block.min(axis=1), block.max(axis=1)
        beside = (bottom[:, :2] > high[:2]).any(axis=1) | (top[:, :2] < low[:2]).any(axis=1)
        near = np.flatnonzero(~beside & (top[:, 2] > low[2]))
        facet, place = tree.query_boxes(bottom[near, :2], top[near, :2])
        facet = near[facet]
        over = top[facet, 2] > places[place, 2]
        facet, place = facet[over], place[over]
        for some in np.array_split(np.arange(len(facet)), len(facet) // _PAIRS_AT_ONCE + 1):
            x, y, z = places.take(place[some], axis=0).T
            these = block.take(facet[some], axis=0)
            turns = np.where(_interpolate_heights(these, x, y) > z, _find_turning_directions(these, x, y), 0)
            counts = np.flatnonzero(turns)
            found.append((place[some][counts], owner[at + facet[some][counts]], turns[counts].astype(float)))
    return _sum_equal_pairs(found, int(owner.max()) + 1)


def measure_coverage(triangles: Float, owner: Int, places: Float) -> _PairValues:
    """Measure the fraction of the full solid angle that open surfaces cover around points, seen from behind.

    Around a point inside, a closed surface covers all of it (1); an open surface covers less, but deep inside more
    than half.
    Only points in the bounding box of a surface are considered. If there are too many pairs, the winding numbers are
    returned instead.

    Args:
        triangles: (F, 3, 3) mm.
        owner: (F,) the surface of each facet.
        places: (n, 3) points, mm, on no surface.

    Returns:
        Index of the point, surface and fraction (m,); by point, then surface.

    Source: van Oosterom & Strackee, The solid angle of a plane triangle, 1983.
    """
    order = np.argsort(owner, kind="stable")
    surface, first = np.unique(owner[order], return_index=True)
    size = np.diff(np.append(first, len(order)))
    ordered = triangles.take(order, axis=0)
    pairs: list[tuple[Int, Int]] = []
    for k, (start, count) in enumerate(zip(first.tolist(), size.tolist(), strict=True)):
        corners = ordered[start : start + count]
        within = (places >= corners.min(axis=(0, 1))) & (places <= corners.max(axis=(0, 1)))
        place = np.flatnonzero(within.all(axis=1))
        pairs.append((place, np.full(len(place), k)))
    place, number = (np.concatenate([np.zeros(0, np.int64), *column]) for column in zip(*pairs, strict=True))
    if int(size[number].sum()) > _MAX_PAIRS:
        return compute_winding_numbers(triangles, owner, places)
    found: list[_PairValues] = []
    total = np.cumsum(size[number])
    for some in np.split(
        np.arange(len(place)),
        np.searchsorted(total, np.arange(_PAIRS_AT_ONCE, int(size[number].sum()), _PAIRS_AT_ONCE)),
    ):
        pair, step = expand_counts(size[number[some]])
        share = _compute_solid_angles(
            ordered.take(first[number[some]][pair] + step, axis=0),
            places.take(place[some][pair], axis=0),
        )
        sums = np.asarray(np.bincount(pair, share, len(some)), np.float64)
        found.append((place[some], surface[number[some]], sums))
    return _sum_equal_pairs(found, int(owner.max(initial=0)) + 1)


def _sum_equal_pairs(found: list[_PairValues], n_owners: int) -> _PairValues:
    """Add up the values that have the same point and the same surface."""
    nothing = np.zeros(0, np.int64)
    place, owner = (np.concatenate([nothing, *(some[i] for some in found)]) for i in (0, 1))
    value = np.concatenate([np.zeros(0), *(some[2] for some in found)])
    key, number = np.unique(place * np.int64(n_owners) + owner, return_inverse=True)
    total = np.bincount(number.ravel(), value, len(key))
    kept = np.flatnonzero(np.abs(total) > 1e-12)
    return key[kept] // n_owners, key[kept] % n_owners, np.asarray(total[kept], np.float64)


def _compute_solid_angles(triangles: Float, places: Float) -> Float:
    """Return the solid angle (n,) of each facet, seen from its point, as a fraction of the full sphere."""
    a, b, c = (triangles - places[:, None]).transpose(1, 0, 2)
    la, lb, lc = (np.linalg.norm(side, axis=1) for side in (a, b, c))
    box = np.einsum("ij,ij->i", a, np.cross(b, c))
    dots = [
        np.einsum("ij,ij->i", one, other) * length
        for one, other, length in ((a, b, lc), (b, c, la), (c, a, lb))
    ]
    return np.asarray(np.arctan2(box, la * lb * lc + sum(dots)) / (2 * np.pi))


def _find_turning_directions(triangles: Float, x: Float, y: Float) -> Int:
    """Return how each facet (n,) runs around its point, seen from above: 1 counter-clockwise, -1 clockwise, 0 not."""
    start, end = triangles, triangles[:, [1, 2, 0]]
    x, y = x[:, None], y[:, None]
    up = (start[:, :, 1] <= y) & (end[:, :, 1] > y)
    down = (start[:, :, 1] > y) & (end[:, :, 1] <= y)
    # Compute from the lower end to the upper one, so that both facets of an edge give the same number.
    low, high = np.where(down[:, :, None], end, start), np.where(down[:, :, None], start, end)
    rise = np.where(up | down, high[:, :, 1] - low[:, :, 1], 1.0)
    where = low[:, :, 0] + (y - low[:, :, 1]) / rise * (high[:, :, 0] - low[:, :, 0])
    right = where > x
    return np.asarray((up & right).sum(axis=1) - (down & right).sum(axis=1))


def _interpolate_heights(triangles: Float, x: Float, y: Float) -> Float:
    """Return the height (n,) of the plane of each facet at its point (x, y); for vertical facets, that of their top."""
    a, b, c = triangles.transpose(1, 0, 2)
    normal = np.cross(b - a, c - a)
    flat = normal[:, 2] != 0
    slope = normal[:, 0] * (x - a[:, 0]) + normal[:, 1] * (y - a[:, 1])
    top = triangles[:, :, 2].max(axis=1)
    return np.asarray(np.where(flat, a[:, 2] - slope / np.where(flat, normal[:, 2], 1.0), top))
