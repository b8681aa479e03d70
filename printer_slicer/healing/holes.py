"""Fill holes in a surface with facets where the missing shape is clear."""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, next_in_ring
from printer_slicer.geometry.connectivity import find_cycles, label_components, weld_keys
from printer_slicer.geometry.facet_topology import expand_counts
from printer_slicer.geometry.vectors import dot, nearest_share
from printer_slicer.healing.facets import Facets
from printer_slicer.model import Repair
from printer_slicer.values import Struct

__all__ = ["CRACK", "fill_holes"]

CRACK = 1.0
"""mm; open edges closer than this are the two sides of a crack, which is closed in the sections."""
_FLATNESS = 0.002  # mm; corners this close to a plane lie in it
_MAX_DEPTH_RATIO = 0.25  # of the width of a hole: maximum distance of its corners from its plane
_MAX_FILLED_RATIO = 0.8  # of the area of a body: maximum area of its filled holes
_MAX_APEXES = 200
_MAX_PAIRS = 30_000_000  # corners times edges to compare in the search for cracks
_PAIRS_AT_ONCE = 1_000_000


class _Holes(Struct, frozen=True, eq=False):
    """The borders of holes: closed loops of open edges.

    Attributes:
        corner: (n,) point numbers along all borders.
        start: (H + 1,) border `i` is `corner[start[i]:start[i + 1]]`.
    """

    corner: Int
    start: Int

    @property
    def size(self) -> Int:
        """Number of corners of each hole (H,)."""
        return np.diff(self.start)

    @property
    def following(self) -> Int:
        """Index (n,) of the next corner around the hole, for each corner."""
        return next_in_ring(self.start)

    def select(self, keep: Bool) -> _Holes:
        """Return the holes for which `keep` (H,) is true."""
        owner, place = expand_counts(self.size[keep])
        return _Holes(
            self.corner[self.start[:-1][keep][owner] + place],
            np.concatenate([[0], np.cumsum(self.size[keep])]),
        )


def fill_holes(facets: Facets) -> tuple[Facets, list[Repair]]:
    """Fill holes with facets between their corners.

    A hole is a closed loop of edges that lack a facet. A hole with three corners gets the missing facet. A larger hole
    gets a fan under three conditions: its corners lie in a plane or nearly (within a quarter of its width), it is not
    one side of a crack (no open edge of another hole within 1 mm), and all fans of a body have at most four fifths of
    its area. An edge that is split on one side only is a hole without area.
    """
    holes = _find_holes(facets)
    if not len(holes.size):
        return facets, []
    holes = holes.select(~_is_isolated_facet(facets, holes))
    if not len(holes.size):
        return facets, []
    size, area, off = _measure_holes(facets.points, holes)
    width = 2 * area / np.maximum(size, 1e-300)
    good = (holes.size == 3) | (off <= np.maximum(_FLATNESS, _MAX_DEPTH_RATIO * width))
    large = (holes.size > 3) & (area > _FLATNESS * size)
    good &= ~large | ~_is_side_of_crack(facets.points, holes)
    good &= ~large | _is_small_for_body(facets, holes, np.where(large & good, area, 0.0))
    if not good.any():
        return facets, []
    kept = holes.select(good)
    new = np.concatenate([facets.corners, _make_fans(facets.points, kept)])
    middles = np.add.reduceat(facets.points[kept.corner], kept.start[:-1]) / kept.size[:, None]
    missing = area[good] > _FLATNESS * size[good]
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
    return Facets.from_indices(facets.points, new), done


def _find_holes(facets: Facets) -> _Holes:
    """Find the borders of all holes; skip holes with a corner that lies on several borders."""
    half = np.flatnonzero(facets.net[facets.edges.ravel()] == facets.turns.ravel())
    # Take one half-edge for each missing facet.
    half = half[np.unique(facets.edges.ravel()[half], return_index=True)[1]]
    half = half[np.abs(facets.net[facets.edges.ravel()[half]]) == 1]
    end, start = facets.corners.ravel()[half], facets.corners[:, [1, 2, 0]].ravel()[half]
    # The missing facet runs from `start` to `end`. The next edge is unique at a corner that only one border passes.
    alone = (np.bincount(start, minlength=len(facets.points)) == 1) & (
        np.bincount(end, minlength=len(facets.points)) == 1
    )
    at = np.full(len(facets.points), -1)
    at[start] = np.arange(len(start))
    # Skip borders with other corners.
    usable = alone[start] & alone[end]
    group = label_components(np.stack([start, end]), len(facets.points))
    usable &= np.bincount(group[start], ~usable, len(facets.points))[group[start]] == 0
    chosen = np.flatnonzero(usable)
    if not len(chosen):
        return _Holes(np.zeros(0, np.int64), np.zeros(1, np.int64))
    number = np.full(len(start), -1)
    number[chosen] = np.arange(len(chosen))
    walk, rank = find_cycles(number[at[end[chosen]]])
    order = np.lexsort((rank, walk))
    size = np.unique(walk, return_counts=True)[1]
    return _Holes(start[chosen][order], np.concatenate([[0], np.cumsum(size)]))


def _is_isolated_facet(facets: Facets, holes: _Holes) -> Bool:
    """Return whether each hole (H,) is the border of a single facet that is connected to no other facet."""
    triple = np.flatnonzero(holes.size == 3)
    corners = np.sort(holes.corner[holes.start[:-1][triple][:, None] + np.arange(3)], axis=1)
    a, b, c = np.concatenate([np.sort(facets.corners, axis=1), corners]).T
    n_points = np.int64(len(facets.points))
    pair = weld_keys((a * n_points + b).view(np.uint64))[0]
    number = weld_keys((pair * n_points + c).view(np.uint64))[0]
    result = np.zeros(len(holes.size), np.bool_)
    result[triple] = np.isin(number[len(facets.corners) :], number[: len(facets.corners)])
    return result


def _measure_holes(points: Float, holes: _Holes) -> tuple[Float, Float, Float]:
    """Return each hole's (H,) extent, mm, area, mm², and the largest distance of a corner from its plane, mm."""
    xyz, hole = points[holes.corner], np.repeat(np.arange(len(holes.size)), holes.size)
    start = holes.start[:-1]
    middle = np.add.reduceat(xyz, start) / holes.size[:, None]
    arm = xyz - middle[hole]
    normal = np.add.reduceat(np.cross(arm, arm[holes.following]), start) / 2
    area = np.linalg.norm(normal, axis=1)
    extent = 2 * np.maximum.reduceat(np.linalg.norm(arm, axis=1), start)
    direction = normal / np.maximum(area, 1e-300)[:, None]
    off = np.maximum.reduceat(np.abs((arm * direction[hole]).sum(axis=1)), start)
    # A hole without area has no plane; use the distance of its corners from its longest arm.
    longest = np.lexsort((np.linalg.norm(arm, axis=1), hole))[holes.start[1:] - 1]
    axis = arm[longest] / np.maximum(np.linalg.norm(arm[longest], axis=1), 1e-300)[:, None]
    aside = np.linalg.norm(np.cross(arm, axis[hole]), axis=1)
    thin = area <= _FLATNESS * extent
    return extent, area, np.where(thin, np.maximum.reduceat(aside, start), off)


def _is_side_of_crack(points: Float, holes: _Holes) -> Bool:
    """Return whether each hole (H,) has a corner near an edge of another hole; all True if there are too many."""
    hole = np.repeat(np.arange(len(holes.size)), holes.size)
    result = np.zeros(len(holes.size), np.bool_)
    several = np.flatnonzero((holes.size > 3)[hole])
    if len(holes.size) < 2 or not len(several):
        return result
    if len(several) * len(hole) > _MAX_PAIRS:
        return ~result
    start, end = points[holes.corner], points[holes.corner[holes.following]]
    along = end - start
    for some in np.array_split(several, len(several) * len(hole) // _PAIRS_AT_ONCE + 1):
        gap = start[some][:, None] - start[None]
        gap -= nearest_share(gap, along)[..., None] * along
        near = (dot(gap, gap) < CRACK**2) & (hole[some][:, None] != hole[None])
        result[hole[some][near.any(axis=1)]] = True
    return result


def _is_small_for_body(facets: Facets, holes: _Holes, area: Float) -> Bool:
    """Return for each hole (H,) whether all holes of its body together are small compared with the body's area."""
    body = label_components(facets.corners.T, len(facets.points))
    n_bodies = int(body.max()) + 1
    there = np.bincount(body[facets.corners[:, 0]], np.linalg.norm(facets.normals, axis=1) / 2, n_bodies)
    of_hole = body[holes.corner[holes.start[:-1]]]
    missing = np.bincount(of_hole, area, n_bodies)
    return np.asarray((missing <= _MAX_FILLED_RATIO * there)[of_hole])


def _make_fans(points: Float, holes: _Holes) -> Int:
    """Return the facets (n, 3) that fill the holes, as fans from one corner of each."""
    triple = holes.size == 3
    facets = [holes.corner[holes.start[:-1][triple][:, None] + np.arange(3)]]
    for k in np.flatnonzero(~triple).tolist():
        walk = holes.corner[holes.start[k] : holes.start[k + 1]]
        walk = np.roll(walk, -_find_apex(points[walk]))
        facets.append(np.stack([np.broadcast_to(walk[0], (len(walk) - 2,)), walk[1:-1], walk[2:]], axis=1))
    return np.concatenate(facets)


def _find_apex(walk: Float) -> int:
    """Return the index of the corner whose fan has the least area, so that its facets overlap as little as possible."""
    if len(walk) > _MAX_APEXES:
        return 0
    arm = walk[None] - walk[:, None]
    doubled = np.linalg.norm(np.cross(arm, np.roll(arm, -1, axis=1)), axis=2).sum(axis=1)
    return int(np.argmin(np.round(doubled, 9)))
