"""Holes in a surface: closed walks along open edges, filled with facets where it is plain what is missing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, next_in_ring
from printer_slicer.geometry.connectivity import cycles, label_components, weld_keys
from printer_slicer.geometry.facet_topology import spread
from printer_slicer.geometry.vectors import dot, nearest_share
from printer_slicer.healing.facets import Facets
from printer_slicer.model import Repair

__all__ = ["CRACK", "fill_holes"]

CRACK = 1.0
"""mm; open edges of two surfaces that are nearer than this are the two sides of a crack, which sections close."""
_FLAT = 0.002  # mm; corners this near to a plane lie in it
_SHALLOW = 0.25  # of the width of a hole: how far its corners may be off the plane through it
_MOST = 0.8  # of the area of a body: how much of it may be filled in
_MOST_APEXES = 200
_MOST_PAIRS = 30_000_000  # of corners and edges compared to find cracks
_PAIRS_AT_ONCE = 1_000_000


@dataclass(frozen=True, slots=True, eq=False)
class _Holes:
    """Closed walks in which the missing facets run along open edges.

    Attributes:
        corner: (n,) points along all walks.
        start: (H + 1,) walk `i` is `corner[start[i]:start[i + 1]]`.
    """

    corner: Int
    start: Int

    @property
    def size(self) -> Int:
        """(H,) corners of each."""
        return np.diff(self.start)

    @property
    def following(self) -> Int:
        """(n,) place of the next corner around the hole."""
        return next_in_ring(self.start)

    def kept(self, keep: Bool) -> _Holes:
        """Only the walks for which `keep` (H,) is true."""
        owner, place = spread(self.size[keep])
        return _Holes(
            self.corner[self.start[:-1][keep][owner] + place],
            np.concatenate([[0], np.cumsum(self.size[keep])]),
        )


def fill_holes(facets: Facets) -> tuple[Facets, list[Repair]]:
    """Fill holes with facets between their corners.

    A hole is a closed walk along edges that lack a facet. One of three corners gets the facet that is missing; one with
    more gets a fan, where its corners lie in a plane or nearly (a quarter of its width), where it is no side of a
    crack (no open edge of another hole within 1 mm), and where all fans of a body together have no more than
    four fifths of its area. An edge that is split on one side only leaves a hole without area, and its fan has none.
    """
    holes = _holes(facets)
    if not len(holes.size):
        return facets, []
    holes = holes.kept(~_are_facets(facets, holes))
    if not len(holes.size):
        return facets, []
    size, area, off = _shapes(facets.points, holes)
    width = 2 * area / np.maximum(size, 1e-300)
    good = (holes.size == 3) | (off <= np.maximum(_FLAT, _SHALLOW * width))
    large = (holes.size > 3) & (area > _FLAT * size)
    good &= ~large | ~_cracks(facets.points, holes)
    good &= ~large | _within_share(facets, holes, np.where(large & good, area, 0.0))
    if not good.any():
        return facets, []
    kept = holes.kept(good)
    new = np.concatenate([facets.corners, _fans(facets.points, kept)])
    middles = np.add.reduceat(facets.points[kept.corner], kept.start[:-1]) / kept.size[:, None]
    missing = area[good] > _FLAT * size[good]
    done = []
    if missing.any():
        done.append(
            Repair(
                "holes filled",
                middles[missing],
                float(size[good][missing].max()),
                float(area[good][missing].sum()),
            )
        )
    if not missing.all():
        done.append(
            Repair("cracks closed along edges", middles[~missing], float(width[good][~missing].max()))
        )
    return Facets.of(facets.points, new), done


def _holes(facets: Facets) -> _Holes:
    """The walks around holes; where several begin and end at one corner, each goes on as its facets do."""
    half = np.flatnonzero(facets.net[facets.edges.ravel()] == facets.turns.ravel())
    # One half-edge for each facet that is missing on the other side of it.
    half = half[np.unique(facets.edges.ravel()[half], return_index=True)[1]]
    half = half[np.abs(facets.net[facets.edges.ravel()[half]]) == 1]
    end, begin = facets.corners.ravel()[half], facets.corners[:, [1, 2, 0]].ravel()[half]
    # The missing facet goes from `begin` to `end`; a corner where only one walk passes is enough to go on.
    alone = (np.bincount(begin, minlength=len(facets.points)) == 1) & (
        np.bincount(end, minlength=len(facets.points)) == 1
    )
    at = np.full(len(facets.points), -1)
    at[begin] = np.arange(len(begin))
    # Walks that come to a corner where this is not so are left out.
    usable = alone[begin] & alone[end]
    group = label_components(np.stack([begin, end]), len(facets.points))
    usable &= np.bincount(group[begin], ~usable, len(facets.points))[group[begin]] == 0
    chosen = np.flatnonzero(usable)
    if not len(chosen):
        return _Holes(np.zeros(0, np.int64), np.zeros(1, np.int64))
    number = np.full(len(begin), -1)
    number[chosen] = np.arange(len(chosen))
    walk, rank = cycles(number[at[end[chosen]]])
    order = np.lexsort((rank, walk))
    size = np.unique(walk, return_counts=True)[1]
    return _Holes(begin[chosen][order], np.concatenate([[0], np.cumsum(size)]))


def _are_facets(facets: Facets, holes: _Holes) -> Bool:
    """(H,) whether a hole is nothing but the border of one facet, which stands alone."""
    triple = np.flatnonzero(holes.size == 3)
    corners = np.sort(holes.corner[holes.start[:-1][triple][:, None] + np.arange(3)], axis=1)
    a, b, c = np.concatenate([np.sort(facets.corners, axis=1), corners]).T
    n_points = np.int64(len(facets.points))
    pair = weld_keys((a * n_points + b).view(np.uint64))[0]
    number = weld_keys((pair * n_points + c).view(np.uint64))[0]
    result = np.zeros(len(holes.size), np.bool_)
    result[triple] = np.isin(number[len(facets.corners) :], number[: len(facets.corners)])
    return result


def _shapes(points: Float, holes: _Holes) -> tuple[Float, Float, Float]:
    """(H,) the extent of each hole, mm, its area, mm², and how far its corners are from a plane, mm."""
    xyz, hole = points[holes.corner], np.repeat(np.arange(len(holes.size)), holes.size)
    start = holes.start[:-1]
    middle = np.add.reduceat(xyz, start) / holes.size[:, None]
    arm = xyz - middle[hole]
    normal = np.add.reduceat(np.cross(arm, arm[holes.following]), start) / 2
    area = np.linalg.norm(normal, axis=1)
    extent = 2 * np.maximum.reduceat(np.linalg.norm(arm, axis=1), start)
    direction = normal / np.maximum(area, 1e-300)[:, None]
    off = np.maximum.reduceat(np.abs((arm * direction[hole]).sum(axis=1)), start)
    # A hole without area has no plane; it is as far off as its corners are from its longest arm.
    longest = np.lexsort((np.linalg.norm(arm, axis=1), hole))[holes.start[1:] - 1]
    axis = arm[longest] / np.maximum(np.linalg.norm(arm[longest], axis=1), 1e-300)[:, None]
    aside = np.linalg.norm(np.cross(arm, axis[hole]), axis=1)
    thin = area <= _FLAT * extent
    return extent, area, np.where(thin, np.maximum.reduceat(aside, start), off)


def _cracks(points: Float, holes: _Holes) -> Bool:
    """(H,) whether a corner of the hole lies near an edge of another; all do where there are too many to compare."""
    hole = np.repeat(np.arange(len(holes.size)), holes.size)
    result = np.zeros(len(holes.size), np.bool_)
    several = np.flatnonzero((holes.size > 3)[hole])
    if len(holes.size) < 2 or not len(several):
        return result
    if len(several) * len(hole) > _MOST_PAIRS:
        return ~result
    begin, end = points[holes.corner], points[holes.corner[holes.following]]
    along = end - begin
    for some in np.array_split(several, len(several) * len(hole) // _PAIRS_AT_ONCE + 1):
        gap = begin[some][:, None] - begin[None]
        gap -= nearest_share(gap, along)[..., None] * along
        near = (dot(gap, gap) < CRACK**2) & (hole[some][:, None] != hole[None])
        result[hole[some][near.any(axis=1)]] = True
    return result


def _within_share(facets: Facets, holes: _Holes, area: Float) -> Bool:
    """(H,) whether the holes of a body are small beside what there is of it."""
    body = label_components(facets.corners.T, len(facets.points))
    n_bodies = int(body.max()) + 1
    there = np.bincount(body[facets.corners[:, 0]], np.linalg.norm(facets.normals, axis=1) / 2, n_bodies)
    of_hole = body[holes.corner[holes.start[:-1]]]
    missing = np.bincount(of_hole, area, n_bodies)
    return np.asarray((missing <= _MOST * there)[of_hole])


def _fans(points: Float, holes: _Holes) -> Int:
    """(n, 3) corners of the facets that fill the holes, each from one corner of the hole to all of its sides."""
    triple = holes.size == 3
    facets = [holes.corner[holes.start[:-1][triple][:, None] + np.arange(3)]]
    for k in np.flatnonzero(~triple).tolist():
        walk = holes.corner[holes.start[k] : holes.start[k + 1]]
        walk = np.roll(walk, -_apex(points[walk]))
        facets.append(np.stack([np.broadcast_to(walk[0], (len(walk) - 2,)), walk[1:-1], walk[2:]], axis=1))
    return np.concatenate(facets)


def _apex(walk: Float) -> int:
    """The corner whose fan has the least area: none of its facets overlap if the hole can be seen from there."""
    if len(walk) > _MOST_APEXES:
        return 0
    arm = walk[None] - walk[:, None]
    doubled = np.linalg.norm(np.cross(arm, np.roll(arm, -1, axis=1)), axis=2).sum(axis=1)
    return int(np.argmin(np.round(doubled, 9)))
