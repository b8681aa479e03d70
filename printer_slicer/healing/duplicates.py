"""Join corners that differ by rounding, and drop duplicate facets and sheets without thickness."""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Bool, Float, Int
from printer_slicer.geometry.connectivity import group_close_points, label_components
from printer_slicer.geometry.facet_topology import may_have_neighbours
from printer_slicer.healing.facets import Facets
from printer_slicer.healing.nesting import compute_winding_numbers
from printer_slicer.model import Repair

__all__ = ["drop_duplicates", "drop_sheets", "join_corners"]

_SAME_PLACE = 0.001  # mm
_SAME_PLACE_RATIO = 1e-4  # of the size of the part, if that is less
_NEAR_PLACE = 0.25  # mm
_NEAR_PLACE_RATIO = 0.1  # of the shortest edge
_MIN_DISTANCE = 1e-30  # mm; damaged files have numbers close to zero
_ROUNDING_RATIO = 4 * 2.0**-24  # of a coordinate: the error of a few roundings to 32 bits


def join_corners(facets: Facets) -> tuple[Facets, list[Repair]]:
    """Join corners of open edges that are close together; each group moves to its first corner by x, y, z.

    The first pass joins corners within 0.001 mm (less in a small part, more where 32-bit numbers are coarser). The
    second pass works on the edges that stay open. It joins corners within 0.25 mm and a tenth of the shortest edge of
    the facets there, so that no facet collapses.
    """
    size = float(np.ptp(facets.points, axis=0).max(initial=0.0))
    far = float(np.abs(facets.points).max(initial=0.0))
    reach = max(min(_SAME_PLACE, _SAME_PLACE_RATIO * size), _ROUNDING_RATIO * far, _MIN_DISTANCE)
    facets, done = _join_within(facets, reach)
    at_open = (facets.count[facets.edges] == 1).any(axis=1)
    if not at_open.any():
        return facets, done
    open_ones = facets.triangles[at_open]
    shortest = float(np.linalg.norm(open_ones - open_ones[:, [1, 2, 0]], axis=2).min())
    facets, more = _join_within(facets, min(_NEAR_PLACE, _NEAR_PLACE_RATIO * shortest))
    return facets, done + more


def _join_within(facets: Facets, reach: float) -> tuple[Facets, list[Repair]]:
    """Join corners at open edges that are within `reach` mm of each other along every axis."""
    at_open = facets.count[facets.edges] % 2 == 1
    is_loose = np.zeros(len(facets.points), np.bool_)
    is_loose[facets.corners[at_open]] = is_loose[facets.corners[:, [1, 2, 0]][at_open]] = True
    loose = np.flatnonzero(is_loose)
    for shift in (0.0, 0.5):  # a point at the border of a cell is in the middle of a shifted one
        # In a cluster, corners up to twice the reach apart may be joined.
        loose = loose[may_have_neighbours(facets.points[loose], 2 * reach, shift=shift)]
    loose = loose[np.lexsort(facets.points[loose].T[::-1])]
    if not len(loose):
        return facets, []
    group = group_close_points(facets.points[loose], reach)
    firsts = np.unique(group, return_index=True)[1]
    if len(firsts) == len(loose):
        return facets, []
    number = np.arange(len(facets.points))
    number[loose] = loose[firsts[group]]
    moved = np.flatnonzero(number != np.arange(len(number)))
    by = np.linalg.norm(facets.points[number[moved]] - facets.points[moved], axis=1)
    joined = Facets.from_indices(facets.points, number[facets.corners])
    return joined, [Repair("corners joined", facets.points[moved], widest=float(by.max()))]


def drop_duplicates(facets: Facets) -> tuple[Facets, list[Repair]]:
    """Drop duplicate facets, whichever way the copies face.

    Connected copies are treated together. One copy stays if the surrounding surface ends at them, or if they form a
    shell of their own. If the surrounding surface is closed without them, copies that face opposite ways are an
    internal wall or a sheet and are all dropped; copies that face the same way are a side shared by two solids and all
    stay. A shell that exists both inward and outward is dropped if it lies within the solid.
    """
    group, first = _group_equal_facets(facets)
    size = np.bincount(group)
    several = size > 1
    if not several.any():
        return facets, []
    hand = _find_handedness(facets.corners)
    facing = np.asarray(np.bincount(group, hand), np.float64)
    single = Facets.from_indices(facets.points, facets.corners[first[several]])
    wanted = np.full(len(size), -1)
    wanted[several] = _count_copies_to_keep(single, facets.select(~several[group]), facing[several])
    # Keep a copy that faces the same way as most of them.
    rank = np.lexsort((-hand * np.sign(facing)[group], group))
    best = rank[np.searchsorted(group[rank], np.arange(len(size)))]
    keep = wanted[group] < 0
    keep[best[wanted == 1]] = True
    if keep.all():
        return facets, []
    return facets.select(keep), [Repair("duplicate facets dropped", facets.centroids[~keep])]


def _group_equal_facets(facets: Facets) -> tuple[Int, Int]:
    """Return a group number for each facet (F,), equal for equal corners, and one facet of each group."""
    ordered = np.sort(facets.corners, axis=1)
    pair = np.unique(ordered[:, 0] * np.int64(len(facets.points)) + ordered[:, 1], return_inverse=True)[1]
    _, first, group = np.unique(
        pair * np.int64(len(facets.points)) + ordered[:, 2], return_index=True, return_inverse=True
    )
    return group, first


def _find_handedness(corners: Int) -> Int:
    """Return 1 for facets (F,) whose corner numbers, starting at the lowest, ascend around the facet; otherwise -1."""
    a, b, c = corners.T
    ascents = (a < b).astype(int) + (b < c) + (c < a)
    return np.where(ascents == 2, 1, -1)


def _count_copies_to_keep(single: Facets, rest: Facets, facing: Float) -> Int:
    """Return how many copies of each facet (n,) to keep: 0, 1, or -1 for all.

    Args:
        single: one copy of each duplicate facet.
        rest: the facets without duplicates.
        facing: (n,) copies that face one way minus those that face the other.
    """
    patch = single.label_patches()
    n_patches = int(patch.max(initial=-1)) + 1
    around = _count_facets_at(rest, single.key)[single.edges]
    border = single.count[single.edges] == 1
    ends = np.bincount(patch, (border & (around % 2 == 1)).sum(axis=1), n_patches)
    whole = np.bincount(patch, (border & (around > 0) & (around % 2 == 0)).sum(axis=1), n_patches)
    opposed = np.bincount(patch, facing == 0, n_patches) * 2 > np.bincount(patch, minlength=n_patches)
    is_shell = np.bincount(patch, border.sum(axis=1), n_patches) == 0
    asked = np.flatnonzero(is_shell & opposed)
    places = single.centroids[np.unique(patch, return_index=True)[1][asked]]
    hidden = np.zeros(n_patches, np.bool_)
    hidden[
        asked[compute_winding_numbers(rest.triangles, np.zeros(len(rest.corners), np.int64), places)[0]]
    ] = True
    alone = (ends + whole == 0) & ~opposed
    one = np.where(is_shell, ~(opposed & hidden), ((ends > 0) & (ends >= whole)) | alone)
    wanted = np.where(one, 1, np.where(opposed, 0, -1))
    return np.asarray(wanted[patch])


def _count_facets_at(facets: Facets, key: Int) -> Int:
    """Return the number of facets (n,) at the edges with these keys."""
    order = np.argsort(facets.key)
    place = np.minimum(np.searchsorted(facets.key[order], key), max(len(order) - 1, 0))
    if not len(order):
        return np.zeros(len(key), np.int64)
    return np.where(facets.key[order][place] == key, facets.count[order][place], 0)


def drop_sheets(facets: Facets) -> tuple[Facets, list[Repair]]:
    """Drop sheets: patches without thickness in or beside a surface that is closed even without the patches.

    A patch ends at open edges or at edges with more than two facets. It is dropped if it has neighbours at its border
    and each of them has a partner without it. The smallest patches are dropped first.
    """
    dropped: list[Float] = []
    while True:
        patch = facets.label_patches()
        n_patches = int(patch.max(initial=-1)) + 1
        if n_patches < 2:
            break
        chosen = _find_sheets(facets, patch, n_patches)
        if not chosen.any():
            break
        dropped.append(facets.centroids[chosen])
        facets = facets.select(~chosen)
    return facets, [Repair("sheets without thickness dropped", np.concatenate(dropped))] if dropped else []


def _find_sheets(facets: Facets, patch: Int, n_patches: int) -> Bool:
    """Return which facets (F,) belong to sheets, see `drop_sheets`; no two of the chosen sheets share an edge."""
    edge, owner = facets.edges.ravel(), np.repeat(patch, 3)
    # The patch's own facets at each of its edges.
    pair, own = np.unique(owner * np.int64(len(facets.count)) + edge, return_counts=True)
    pair_patch, pair_edge = pair // len(facets.count), pair % len(facets.count)
    others = facets.count[pair_edge] - own
    border = own % 2 == 1
    beside = np.bincount(pair_patch[border & (others > 0)], minlength=n_patches)
    broken = np.bincount(pair_patch[border & (others % 2 == 1)], minlength=n_patches)
    candidate = (beside > 0) & (broken == 0)
    if not candidate.any():
        return np.zeros(len(patch), np.bool_)
    area = np.bincount(patch, np.linalg.norm(facets.normals, axis=1), n_patches)
    # Patches that share an edge exclude each other: drop only the smallest of connected ones.
    at_crowded = border & (others > 0) & candidate[pair_patch]
    order = np.argsort(pair_edge[at_crowded], kind="stable")
    e, p = pair_edge[at_crowded][order], pair_patch[at_crowded][order]
    together = label_components(np.stack([p[1:], p[:-1]])[:, e[1:] == e[:-1]], n_patches)
    ranked = np.lexsort((np.arange(n_patches), area, ~candidate, together))
    smallest = ranked[np.unique(together[ranked], return_index=True)[1]]
    go = np.zeros(n_patches, np.bool_)
    go[smallest] = candidate[smallest]
    return np.asarray(go[patch])
