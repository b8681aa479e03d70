"""Trace loops around the medial axis, and join them to the fixed-width loops of wide places.

A loop walks around all pieces on which its level is active. At a mouth, where a wide place begins, it continues along
the fixed-width loop to the next mouth.
"""

from __future__ import annotations

from functools import reduce

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, consecutive, distinct, run_starts
from printer_slicer.geometry import Areas
from printer_slicer.geometry.boxes import Boxes
from printer_slicer.geometry.connectivity import find_cycles
from printer_slicer.geometry.vectors import cross, nearest_on_segments, norm
from printer_slicer.perimeters.layout import BeadLayout
from printer_slicer.values import Struct

__all__ = ["BeadRings", "TracedBeads", "join_loops", "trace_beads"]

_ROUNDING = 1e-6  # mm
_MAX_MOUTH_DISTANCE = 0.02  # mm, largest distance between a mouth and its fixed-width loop


class TracedBeads(Struct, frozen=True, eq=False):
    """Steps of loops along half-pieces, with the outline on the left.

    Attributes:
        level: (A,) depth of the loop.
        layer: (A,).
        xy: (A, 2, 2) mm, begin and end of the step.
        width: (A, 2) mm.
        following: (A,) next step; -1 at the mouth to a wide place, -2 where the axis is not known.
    """

    level: Int
    layer: Int
    xy: Float
    width: Float
    following: Int


class BeadRings(Struct, frozen=True, eq=False):
    """Closed loops with their widths; outer loops are counter-clockwise.

    Attributes:
        xy: (N, 2) mm.
        width: (N,) mm.
        size: (R,) points of each.
        level: (R,).
        layer: (R,).
    """

    xy: Float
    width: Float
    size: Int
    level: Int
    layer: Int

    def take(self, is_selected: Bool) -> BeadRings:
        """Return the loops for which `is_selected` is true."""
        points = np.repeat(is_selected, self.size)
        return BeadRings(
            self.xy.compress(points, axis=0),
            self.width[points],
            self.size[is_selected],
            self.level[is_selected],
            self.layer[is_selected],
        )

    def merge(self, other: BeadRings) -> BeadRings:
        """Return these loops followed by the other ones."""
        return BeadRings(
            np.concatenate([self.xy, other.xy]),
            np.concatenate([self.width, other.width]),
            np.concatenate([self.size, other.size]),
            np.concatenate([self.level, other.level]),
            np.concatenate([self.layer, other.layer]),
        )


def trace_beads(layout: BeadLayout, active: Bool, inset: Float, width: Float) -> TracedBeads:
    """Trace the steps of loops around the active pieces.

    Args:
        layout: the medial axis.
        active: (k, E) active pieces of each of k levels.
        inset: (k, P) mm from the outline.
        width: (k, P) mm.
    """
    graph = layout.graph
    n_halves = len(graph.start)
    level, half = np.nonzero(np.repeat(active, 2, axis=1))
    number = np.full(active.shape[0] * n_halves, -1)
    number[level * n_halves + half] = np.arange(len(half))
    following = _find_next_steps(layout, number, level, half)
    # Half-piece 2e begins at the first end of piece e, half-piece 2e + 1 at its second end.
    ports = layout.port.take(half >> 1, axis=0)
    ports = np.where((half & 1)[:, None] == 1, ports[:, ::-1], ports)
    points = graph.ends.take(half >> 1, axis=0)
    points = np.where((half & 1)[:, None] == 1, points[:, ::-1], points)
    radius = graph.radius[points]
    share = np.minimum(inset[level[:, None], ports] / np.maximum(radius, 1e-12), 1.0)
    foot = graph.foot.take(half, axis=0)
    xy = foot + (graph.xy.take(points, axis=0) - foot) * share[..., None]
    return TracedBeads(level, graph.layer[points[:, 0]], xy, width[level[:, None], ports], following)


def _find_next_steps(layout: BeadLayout, number: Int, level: Int, half: Int) -> Int:
    """Return the next step (A,) of each step: the first active half-piece around its end point."""
    graph, n_halves = layout.graph, len(layout.graph.start)
    following = np.full(len(half), -2)
    left = np.arange(len(half))
    ahead = graph.following[half]
    while len(left):
        known = ahead >= 0
        left, ahead = left[known], ahead[known]
        step = number[level[left] * n_halves + ahead]
        mouth = layout.wide[ahead >> 1]
        following[left] = np.where(mouth, -1, step)
        around = (step < 0) & ~mouth
        left, ahead = left[around], graph.following[ahead[around] ^ 1]
    return following


def join_loops(
    walk: TracedBeads, ordinary: list[Areas], layout: BeadLayout, width: Float
) -> tuple[BeadRings, Int]:
    """Join steps, and the parts of fixed-width loops between mouths of narrow places, to closed loops.

    Args:
        walk: the steps.
        ordinary: the fixed-width loops of each level.
        layout: the medial axis; fixed-width loops beside its pieces are left out.
        width: (L,) mm, width of the fixed-width loops.

    Returns:
        The loops, and the layers on which they could not be joined; these layers have no loops.
    """
    # Items of loops are the steps, with two points each, and the points of the fixed-width loops.
    loops = [_FixedLoops.of(areas, level, walk, layout) for level, areas in enumerate(ordinary)]
    after, bad = [walk.following.copy()], [walk.layer[walk.following == -2]]
    for loop in loops:
        links, lost = loop.link_points(sum(map(len, after)), after[0])
        after.append(links)
        bad.append(lost)
    following, broken = np.concatenate(after), distinct(np.concatenate(bad))
    level = np.concatenate([walk.level, *(np.full(len(loop.layer), loop.level) for loop in loops)])
    layer = np.concatenate([walk.layer, *(loop.layer for loop in loops)])
    xy = np.concatenate([walk.xy.reshape(-1, 2), *(loop.xy for loop in loops)])
    widths = np.concatenate([walk.width.ravel(), *(width[loop.layer] for loop in loops)])
    chosen = np.flatnonzero(~np.isin(layer, broken) & (following >= 0))
    number = np.full(len(following), -1)
    number[chosen] = np.arange(len(chosen))
    size = np.where(np.arange(len(following)) < len(walk.level), 2, 1)
    first = np.cumsum(size) - size
    labels = level[chosen], layer[chosen]
    return _gather_rings(number[following[chosen]], first[chosen], size[chosen], (xy, widths), labels), broken


def _gather_rings(
    following: Int, first: Int, count: Int, points: tuple[Float, Float], labels: tuple[Int, Int]
) -> BeadRings:
    """Return the cycles of items as rings, in reverse direction and without repeated points."""
    lowest, place = find_cycles(following)
    length = np.bincount(lowest, minlength=len(lowest))
    order = np.zeros(len(lowest), np.int64)
    order[np.cumsum(length)[lowest] - 1 - place] = np.arange(len(lowest))
    counts = count[order]
    index = consecutive(-(first[order] + counts - 1), counts)  # each item's points backward too
    xy, width = (column.take(-index, axis=0) for column in points)
    owner = np.repeat(lowest[order], counts)
    begins = run_starts(owner)
    ring = np.cumsum(begins) - 1
    starts = np.flatnonzero(begins)
    before = np.arange(len(owner)) - 1
    before[starts] = np.append(starts[1:], len(owner))[: len(starts)] - 1
    step = np.abs(xy - xy.take(before, axis=0))
    apart = (step[:, 0] > _ROUNDING) | (step[:, 1] > _ROUNDING)
    size = np.bincount(ring[apart], minlength=len(starts))
    whole = size >= 3
    apart &= whole[ring]
    level, layer = (label[owner[starts[whole]]] for label in labels)
    return BeadRings(xy.compress(apart, axis=0), width[apart], size[whole], level, layer)


class _FixedLoops(Struct, frozen=True, eq=False):
    """The fixed-width loops of one level, reversed like the steps, and the mouths of narrow places on these loops.

    Attributes:
        level: of all loops.
        xy: (n, 2) mm, points and mouths in the order of the rings.
        layer: (n,).
        ring: (n,).
        leaves: (n,) step that continues from a mouth into the narrow place; -1 for other points.
        joins: (n,) step that arrives at a mouth; -1 for other points.
        lost: layers with mouths that lie on no ring.
    """

    level: int
    xy: Float
    layer: Int
    ring: Int
    leaves: Int
    joins: Int
    lost: Int

    @classmethod
    def of(cls, areas: Areas, level: int, walk: TracedBeads, layout: BeadLayout) -> _FixedLoops:
        """Find the mouths on the loops of a level; drop loops inside narrow places that have no mouth."""
        entered = np.zeros(len(walk.level), np.bool_)
        entered[walk.following[walk.following >= 0]] = True
        own = walk.level == level
        leaves, joins = np.flatnonzero(own & ~entered), np.flatnonzero(own & (walk.following == -1))
        mouth = np.concatenate([walk.xy[leaves, 0], walk.xy[joins, 1]])
        layer = walk.layer[np.concatenate([leaves, joins])]
        side, share, gap = _find_nearest_sides(areas, mouth, layer)
        found, ring_of_point = gap <= _MAX_MOUTH_DISTANCE, areas.point_ring
        touched = np.zeros(areas.n_rings, np.bool_)
        touched[ring_of_point[side[found]]] = True
        touched[~touched] = ~_are_beside_pieces(areas.select(~touched), layout)
        points = np.flatnonzero(touched[ring_of_point])
        at = np.concatenate([points.astype(np.float64), (side + np.clip(share, 1e-9, 1 - 1e-9))[found]])
        ring = ring_of_point[np.concatenate([points, side[found]])]
        order = np.lexsort((-at, ring))
        none = np.full(len(points), -1)
        is_leave = np.arange(len(mouth)) < len(leaves)
        step = np.concatenate([leaves, joins])
        return cls(
            level,
            np.concatenate([areas.xy[points], mouth[found]])[order],
            areas.ring_layer[ring[order]],
            ring[order],
            np.concatenate([none, np.where(is_leave, step, -1)[found]])[order],
            np.concatenate([none, np.where(is_leave, -1, step)[found]])[order],
            layer[~found],
        )

    def link_points(self, first: int, following: Int) -> tuple[Int, Int]:
        """Link points and steps; return the item (n,) after each point, and the layers where mouths do not alternate.

        Items are numbered from `first`. Points between an arrival and the next departure are kept; other points are
        followed by -1.
        """
        n = len(self.ring)
        if not n:
            return np.zeros(0, np.int64), self.lost
        starts = np.flatnonzero(run_starts(self.ring))
        ends = np.append(starts[1:], n) - 1
        of_ring = np.repeat(np.arange(len(starts)), ends - starts + 1)
        after, before = np.arange(n) + 1, np.arange(n) - 1
        after[ends], before[starts] = starts, ends
        # The mouth at or before each item, going back around its ring.
        is_mouth = (self.leaves >= 0) | (self.joins >= 0)
        mouth = np.flatnonzero(is_mouth)
        latest = np.maximum.accumulate(np.where(is_mouth, np.arange(n), -1))
        last_of_ring = latest[ends]
        latest = np.where(latest < starts[of_ring], last_of_ring[of_ring], latest)
        alone = latest < starts[of_ring]
        kept = alone | (self.joins[latest] >= 0)
        wrong = (self.joins[latest[before[mouth]]] >= 0) == (self.joins[mouth] >= 0)
        lost = np.concatenate([self.lost, self.layer[mouth[wrong]]])
        links = np.where(kept, first + after, -1)
        goes_in = np.flatnonzero(self.leaves >= 0)
        links[goes_in] = self.leaves[goes_in]
        comes_out = np.flatnonzero(self.joins >= 0)
        following[self.joins[comes_out]] = first + comes_out
        return links, lost


def _are_beside_pieces(rings: Areas, layout: BeadLayout) -> Bool:
    """Return which rings (R,) lie between the outline and a used piece of the medial axis.

    Two points are tested, a corner and the middle of the longest side, because a ring in a wide area may touch the
    entry of a narrow place with one of them.
    """
    corner = rings.xy.take(rings.ring_start[:-1], axis=0)
    beside = np.zeros(rings.n_rings, np.bool_)
    beside[_find_rings_beside(np.arange(rings.n_rings), corner, rings, layout)] = True
    left = np.flatnonzero(beside)
    beside[:] = False
    beside[_find_rings_beside(left, _longest_side_middles(rings)[left], rings, layout)] = True
    return beside


def _find_rings_beside(ring: Int, point: Float, rings: Areas, layout: BeadLayout) -> Int:
    """Return the rings whose `point` (n, 2) lies between the outline and a used piece; a ring may occur repeatedly."""
    graph, layer = layout.graph, np.zeros(rings.n_layers, np.bool_)
    layer[rings.ring_layer[ring]] = True
    half = np.flatnonzero(np.repeat(layout.used & layer[graph.piece_layer], 2))
    start = graph.start[half]
    foot = graph.foot.take(half, axis=0)
    ends = (graph.xy.take(index, axis=0) for index in (start, graph.start[half ^ 1]))
    corners = [*ends, foot[:, 1], foot[:, 0]]
    low, high = reduce(np.minimum, corners), reduce(np.maximum, corners)
    found, piece = Boxes(point, point, rings.ring_layer[ring]).find_overlapping(
        Boxes(low, high, graph.layer[start]).expand(_ROUNDING)
    )
    # The outline lies on the left: counter-clockwise, what is inside lies to the left of all four sides.
    corner, place = np.stack([some.take(piece, axis=0) for some in corners], axis=1), point[found]
    sides = np.roll(corner, -1, axis=1) - corner
    inside = (cross(sides, place[:, None] - corner) >= -_ROUNDING * norm(sides)).all(axis=1)
    return ring[found[inside]]


def _longest_side_middles(rings: Areas) -> Float:
    """Return the middle (R, 2) of the longest side of each ring, mm."""
    way = rings.xy.take(rings.following, axis=0) - rings.xy
    order = np.lexsort((norm(way), rings.point_ring))
    longest = order[rings.ring_start[1:] - 1]
    return np.asarray(rings.xy.take(longest, axis=0) + way.take(longest, axis=0) / 2)


def _find_nearest_sides(areas: Areas, points: Float, layer: Int) -> tuple[Int, Float, Float]:
    """Return for each point (n,) the nearest side of a ring on its layer, the nearest position there, and the distance.

    Points that lie on no ring get side 0 at an infinite distance.
    """
    point, side = Boxes(points, points, layer).find_overlapping(
        Boxes.of_sides(areas).expand(_MAX_MOUTH_DISTANCE)
    )
    begin, end = (areas.xy.take(one, axis=0) for one in (side, areas.following[side]))
    place = points.take(point, axis=0)
    foot, share = nearest_on_segments(place, begin, end)
    gap = norm(place - foot)
    best = np.full(len(points), -1)
    order = np.argsort(-gap, kind="stable")
    best[point[order]] = order  # the nearest is written last
    found = np.flatnonzero(best >= 0)
    nearest, where, far = np.zeros(len(points), np.int64), np.zeros(len(points)), np.full(len(points), np.inf)
    nearest[found], where[found], far[found] = side[best[found]], share[best[found]], gap[best[found]]
    return nearest, where, far
