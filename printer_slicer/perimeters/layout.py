"""Where beads lie along the medial axis: how far from the outline, and how wide.

Values belong to ports. A port is a point seen from the pieces of one count: where the count changes a point has two.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, unique_inverse
from printer_slicer.geometry.joints import chain_ends
from printer_slicer.perimeters.beading import Beading
from printer_slicer.perimeters.counts import Counted
from printer_slicer.perimeters.graph import AxisGraph, crossings, low_and_high

__all__ = ["BeadLayout", "laid_out"]

_TRANSITION = 0.2  # mm on either side of a change of the count within which beads move to their new places


@dataclass(frozen=True, slots=True, eq=False)
class BeadLayout:
    """Beads of a graph; level i is the loop of depth i, the last level the border of what is left inside.

    Attributes:
        graph: the medial axis, divided wherever something begins or ends.
        port: (E, 2) of both ends of each piece.
        point: (P,) of the graph that each port belongs to.
        leader: (P,) the point whose thickness decides.
        count: (P,) beads across.
        inset: (loops + 1, P) mm from the outline to the middle of each loop's bead, and to the inside.
        width: (loops + 1, P) mm of each loop's bead, and of the bead in the middle.
        active: (loops + 1, E) whether the loops of each level go along the piece.
        middle: (E,) whether a bead goes along the piece itself.
        used: (E,).
        wide: (E,).
    """

    graph: AxisGraph
    port: Int
    point: Int
    leader: Int
    count: Int
    inset: Float
    width: Float
    active: Bool
    middle: Bool
    used: Bool
    wide: Bool


def laid_out(given: Counted, beading: Beading) -> BeadLayout:
    """The beads of a graph whose pieces know their counts."""
    # Where beads have come to their new places, and where loops of levels that end turn around.
    ports, half = _Ports.of(given, beading), beading.spacing[given.graph.piece_layer] / 2
    given = _divided(given, [ports.passing(far) for far in (np.full(len(half), _TRANSITION), half)])
    # Where the room for a level ends.
    ports, room = _Ports.of(given, beading), given.graph.radius.take(given.graph.ends)
    inset, _ = ports.beads(beading)
    given = _divided(
        given, [crossings(room - level.take(ports.port), np.zeros(len(room))) for level in inset]
    )
    return _Ports.of(given, beading).layout(beading)


def _divided(given: Counted, cuts: list[tuple[Int, Float]]) -> Counted:
    """With new points where pieces (n,) are cut, at a share (n,) of the way along each."""
    relabelled = replace(given.graph, origin=np.arange(len(given.used)))
    piece, share = (np.concatenate(column) for column in zip(*cuts, strict=True))
    parts = relabelled.divided(piece, share)
    part = parts.origin
    return Counted(
        parts,
        given.used[part],
        given.central[part],
        given.corner[part],
        given.wide[part],
        given.count[part],
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Ports:
    """Ports of a graph; see `BeadLayout`.

    Attributes:
        given: the graph and its counts.
        port: (E, 2).
        point: (P,).
        leader: (P,) the point whose thickness decides.
        count: (P,).
        change: (P,) the port at the nearest change of the count, -1 where none is near.
        distance: (P,) mm to there along the axis.
        open: (P,) mm along the axis to the nearest wide piece.
        spacing: (loops + 1, P) as the room at the port has it, nothing moved.
        moved: (loops + 1, P) what is added at the change.
        fewest: (P,) least number of loops on any side of the port's point.
    """

    given: Counted
    port: Int
    point: Int
    leader: Int
    count: Int
    change: Int
    distance: Float
    open: Float
    spacing: Float
    moved: Float
    fewest: Int

    @classmethod
    def of(cls, given: Counted, beading: Beading) -> _Ports:
        """Ports of a graph whose pieces know their counts."""
        graph, base, n = given.graph, beading.full + 1, len(given.graph.xy)
        leader, count = _leaders(given, beading)
        keys, number = unique_inverse(((graph.ends * n + leader) * base + count).ravel())
        port, point, leader, count = number.reshape(-1, 2), keys // base // n, keys // base % n, keys % base
        layer = graph.layer[point]
        spacing = beading.spacings(beading.room(graph.radius[leader], layer), count, layer)
        own = np.zeros(len(keys), np.bool_)
        own[port[given.used]] = True
        pairs = np.minimum(count // 2, beading.loops)
        moved, fewest, changing = _moved(point, own, pairs, spacing)
        # All of a corner moves as the point does from which it leads down.
        lengths = np.where(given.corner, 0.0, np.where(given.used, graph.length, np.inf))
        reach = 2 * _TRANSITION + float(beading.spacing.max(initial=0))
        change, distance = _nearest_change(port, lengths, changing, reach)
        mouth = np.zeros(len(graph.xy), np.bool_)
        mouth[graph.ends[given.wide]] = True
        beyond = _nearest_change(port, lengths, mouth[point], reach)[1]
        return cls(given, port, point, leader, count, change, distance, beyond, spacing, moved, fewest)

    def passing(self, distance: Float) -> tuple[Int, Float]:
        """Where pieces are `distance` (E,) along the axis from a change: piece and share."""
        length = np.maximum(self.given.graph.length, 1e-12)
        ends = self.distance.take(self.port)
        found = []
        for end in (0, 1):
            share = (distance - ends[:, end]) / length
            there = np.flatnonzero(
                self.given.used
                & ~self.given.corner
                & (share > 1e-3)
                & (share < 1 - 1e-3)
                & (self.change[self.port[:, end]] >= 0)
            )
            found.append((there, share[there] if end == 0 else 1 - share[there]))
        return np.concatenate([piece for piece, _ in found]), np.concatenate([share for _, share in found])

    def beads(self, beading: Beading) -> tuple[Float, Float]:
        """(loops + 1, P) insets and widths."""
        layer = self.given.graph.layer[self.point]
        near = self.change >= 0
        # In front of a wide place the beads must have come to where the ordinary ones lie.
        within = np.maximum(np.minimum(self.distance + self.open, _TRANSITION), 1e-9)
        ease = np.where(near & (self.open > 0), np.maximum(1 - self.distance / within, 0.0), 0.0)
        spacing = self.spacing + np.where(near, self.moved[:, np.maximum(self.change, 0)], 0.0) * ease
        pairs, rounding = np.minimum(self.count // 2, beading.loops), beading.rounding[layer]
        outside = np.concatenate([np.zeros((1, len(layer))), np.cumsum(spacing[:-1], axis=0)])
        inset = beading.margin[layer] + outside
        inset[:-1] += spacing[:-1] / 2
        room = beading.room(self.given.graph.radius[self.leader], layer)
        left = room - 2 * np.take_along_axis(outside, pairs[None], axis=0)[0]
        width = spacing + rounding
        width[-1] = np.where(pairs > 0, left, spacing[-1]) + rounding
        return inset, width

    def layout(self, beading: Beading) -> BeadLayout:
        """All together, with what is active where."""
        given, graph = self.given, self.given.graph
        inset, width = self.beads(beading)
        count = self.count[self.port[:, 0]]
        pairs = np.minimum(count // 2, beading.loops)
        rest = _sums(graph.radius.take(graph.ends)) - _sums(inset.take(self.port, axis=1))
        level = np.arange(beading.loops + 1)[:, None]
        there = np.where(level < beading.loops, pairs > level, count == beading.full)
        # Where a level ends its loop turns around within the count it belongs to, not over the bead beyond.
        nearest = np.argmin(self.distance[self.port], axis=1)
        end = np.take_along_axis(self.port, nearest[:, None], axis=1)[:, 0]
        change = self.change[end]
        half = beading.spacing[graph.piece_layer] / 2
        # In front of a wide place there may be no room to turn; there it turns where it ends.
        middle = self.distance[end] + graph.length / 2
        close = (middle < half) & ((self.distance + self.open)[end] > half)
        ending = (change >= 0) & close & (self.fewest[change] <= level) & (level < beading.loops)
        active = there & (rest > 0) & ~ending & given.used
        middle = given.central & (count % 2 == 1) & (count < beading.full)
        return BeadLayout(
            graph,
            self.port,
            self.point,
            self.leader,
            self.count,
            inset,
            width,
            active,
            middle,
            given.used,
            given.wide,
        )


def _sums(ends: Float) -> Float:
    """(..., n) of values at both ends (..., n, 2)."""
    return np.asarray(ends[..., 0] + ends[..., 1])


def _leaders(given: Counted, beading: Beading) -> tuple[Int, Int]:
    """(E, 2) the point whose thickness decides at both ends of each piece, and the count there.

    Central pieces decide for themselves; the other used ones are led by the point from which they lead down.
    """
    graph = given.graph
    ends, radius = graph.ends, graph.radius
    top = np.full(len(radius), -1)
    np.maximum.at(top, ends[given.central].ravel(), np.repeat(given.count[given.central], 2))
    np.maximum.at(top, ends[given.wide].ravel(), beading.full)
    others = np.flatnonzero(given.used & ~given.central)
    low, high = low_and_high(ends.take(others, axis=0), radius)
    above = np.arange(len(radius))
    rises = (radius[high] > radius[low]) & (top[low] < 0)
    order = np.argsort(radius[high[rises]])
    above[low[rises][order]] = high[rises][order]
    above = chain_ends(above)
    alone = top < 0  # a place of its own that is hardly wider than long
    for limit in beading.thresholds():
        top[alone] = np.maximum(top[alone], 0) + (radius[alone] > limit[graph.layer[alone]])
    leader = ends.copy()
    leader[others] = above[high][:, None]
    count = top[leader]
    count[given.central] = given.count[given.central][:, None]
    count[given.wide] = beading.full
    return leader, count


def _moved(point: Int, own: Bool, pairs: Int, spacing: Float) -> tuple[Float, Int, Bool]:
    """At changes of the count: what brings both sides together half-way, fewest loops of any side, and where."""
    # Ports of a point stand behind each other.
    total = np.zeros((len(spacing), int(point.max(initial=0)) + 1))
    sides = np.zeros_like(total, np.int64)
    fewest = np.full(total.shape[1], np.iinfo(np.int64).max)
    chosen = np.flatnonzero(own)
    np.minimum.at(fewest, point[chosen], pairs[chosen])
    changing = np.bincount(point[chosen], minlength=total.shape[1])[point] > 1
    for level in range(len(spacing) - 1):
        there = chosen[pairs[chosen] > level]
        total[level] = np.bincount(point[there], spacing[level, there], total.shape[1])
        sides[level] = np.bincount(point[there], minlength=total.shape[1])
    moved = np.where(sides > 1, total / np.maximum(sides, 1), 0.0)[:, point]
    moved = np.where((sides[:, point] > 1) & own & changing, moved - spacing, 0.0)
    return moved, fewest[point], changing & own


def _nearest_change(port: Int, length: Float, changing: Bool, reach: float) -> tuple[Int, Float]:
    """(P,) the nearest port at a change that is reached along the axis, -1 where none is, and how far it is."""
    distance = np.where(changing, 0.0, np.inf)
    change = np.where(changing, np.arange(len(changing)), -1)
    a, b = np.concatenate([port, port[:, ::-1]]).T
    step = np.tile(length, 2)
    near = np.flatnonzero(step <= reach)
    a, b, step = a[near], b[near], step[near]
    new = changing
    while True:
        ask = np.flatnonzero(new[a])
        farther = distance[a[ask]] + step[ask]
        shorter = (farther < distance[b[ask]] - 1e-9) & (farther <= reach)
        better, farther = ask[shorter], farther[shorter]
        if not len(better):
            return change, distance
        order = np.argsort(-farther, kind="stable")  # the nearest is written last
        better, farther = better[order], farther[order]
        distance[b[better]], change[b[better]] = farther, change[a[better]]
        new = np.zeros(len(changing), np.bool_)
        new[b[better]] = True
