"""Cluster perimeters: an external loop with the inner loops behind it.

Inner loops start near the seam of their external loop, to avoid travels across the part. If an inner loop lies directly
between two external loops, in a thin wall, all of them form one cluster, so that no external perimeter is printed
before the inner ones that support it.
"""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Bool, Float, Int
from printer_slicer.geometry.boxes import Boxes
from printer_slicer.geometry.segment_index import distance_to_segments
from printer_slicer.model import Toolpaths
from printer_slicer.ordering.loops import Loops, start_loops_at
from printer_slicer.ordering.seams import find_external_loops
from printer_slicer.profile import Profile
from printer_slicer.values import Struct

__all__ = ["WallClusters", "cluster_walls"]

_N_SAMPLES = 6  # points on an inner loop from which external loops are searched
_MAX_GAP_WIDTHS = 1.7  # maximum distance of loops that touch, in extrusion widths
_SEAM_STAGGER = 1.5  # mm along the loop between the seams of an inner and its external loop


class WallClusters(Struct, frozen=True, eq=False):
    """Clusters of loops that are printed together.

    Attributes:
        path: (R,) indices of the loops.
        cluster: (R,) index of an external loop of the cluster, the same for all its loops.
        turn: (R,) printing order within the cluster.
    """

    path: Int
    cluster: Int
    turn: Int


def cluster_walls(
    paths: Toolpaths, inner: Int, profile: Profile, is_contoured: Bool
) -> tuple[Toolpaths, WallClusters]:
    """Assign inner loops `inner` (I,) to external loops, and start each near the seam of its external loop.

    Clusters with a path of the mask `is_contoured` (M,) are printed from the outside in.
    """
    outer = Loops.of(paths, find_external_loops(paths))
    loops = Loops.of(paths, inner)
    owner, gap, touching = _assign_owners(loops, outer, profile)
    label = _label_connected(outer.n_loops, touching)
    some = np.flatnonzero(owner >= 0)
    along, _ = loops.nearest_positions(some, paths.xy[paths.start[outer.path[owner[some]]]])
    if profile.quality.staggered_inner_seams:
        along = along + np.where(loops.layer[some] % 2, _SEAM_STAGGER, -_SEAM_STAGGER)
    begun = start_loops_at(paths, Loops.of(paths, inner[some]), along)
    path = np.concatenate([inner[some], outer.path])
    is_outer = np.arange(len(path)) >= len(some)
    of = np.concatenate([owner[some], np.arange(outer.n_loops)])
    far = np.concatenate([gap[some], np.zeros(outer.n_loops)])
    outside_in = np.full(outer.n_loops, profile.quality.external_perimeter_first)
    outside_in[label[of][is_contoured[path]]] = True
    turn = _order_loops(label[of], of, far, is_outer, outside_in[label[of]])
    return begun, WallClusters(path, outer.path[label[of]], turn)


def _order_loops(cluster: Int, owner: Int, distance: Float, is_outer: Bool, outside_in: Bool) -> Int:
    """Return the printing order (R,) of loops: inner loops (or external ones) by owner, then the other kind in reverse.

    External loops without inner loops come in between. Clusters in the mask `outside_in` (R,) begin with external ones.
    """
    late = is_outer ^ outside_in
    lone = ~np.isin(owner, owner[~is_outer])
    direction = np.where(late, -owner, owner) + np.where(lone, len(owner) * np.where(late, 1, -1), 0)
    order = np.lexsort((np.where(outside_in, distance, -distance), direction, late, cluster))
    turn = np.zeros(len(order), np.int64)
    turn[order] = np.arange(len(order))
    return turn


def _assign_owners(loops: Loops, outer: Loops, profile: Profile) -> tuple[Int, Float, tuple[Int, Int]]:
    """Return the nearest external loop (I,) of each inner loop, or -1, its distance, and pairs of external loops.

    An inner loop touches both external loops of a pair.
    """
    owner, gap = np.full(loops.n_loops, -1, np.int64), np.zeros(loops.n_loops)
    none = np.zeros(0, np.int64), np.zeros(0, np.int64)
    if not loops.n_loops or not outer.n_loops:
        return owner, gap, none
    widest = profile.bead_widths[1]
    inner, other, distance = _measure_distances(loops, outer, widest * (profile.quality.perimeters + 0.5))
    order = np.lexsort((other, distance, inner))
    inner, other, distance = inner[order], other[order], distance[order]
    first = np.diff(inner, prepend=-1) > 0
    owner[inner[first]], gap[inner[first]] = other[first], distance[first]
    beside = ~first & (distance < _MAX_GAP_WIDTHS * profile.extrusion_width)
    return owner, gap, (owner[inner[beside]], other[beside])


def _measure_distances(loops: Loops, outer: Loops, reach: float) -> tuple[Int, Int, Float]:
    """Return pairs of inner and external loops within reach, and their distance, mm, measured at sample points."""
    loop = np.repeat(np.arange(loops.n_loops), _N_SAMPLES)
    share = (np.arange(len(loop)) % _N_SAMPLES) / _N_SAMPLES
    place = loops.points_at(loop, share * loops.length[loop])
    of = np.repeat(np.arange(outer.n_loops), np.diff(outer.start))
    start, end = outer.xy, outer.xy[outer.following]
    sides = Boxes(np.minimum(start, end), np.maximum(start, end), outer.layer[of])
    sample, side = Boxes(place, place, loops.layer[loop]).expand(reach).find_overlapping(sides)
    distance = distance_to_segments(place[sample], start[side], end[side])
    key = loop[sample] * outer.n_loops + of[side]
    order = np.lexsort((distance, key))
    first = np.diff(key[order], prepend=-1) > 0
    kept = order[first]
    return loop[sample[kept]], of[side[kept]], distance[kept]


def _label_connected(n: int, pairs: tuple[Int, Int]) -> Int:
    """Return for each item (n,) the lowest index in its connected component."""
    label = np.arange(n)
    one, other = pairs
    while True:
        lowest = np.minimum(label[one], label[other])
        before = label.copy()
        np.minimum.at(label, one, lowest)
        np.minimum.at(label, other, lowest)
        label = label[label]
        if (label == before).all():
            return label
