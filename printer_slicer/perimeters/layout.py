"""Compute the width of beads along the medial axis, and their distance from the outline.

Values belong to ports. A port is a point together with one bead count; where the count changes, a point has several.
"""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, unique_inverse
from printer_slicer.geometry.connectivity import find_chain_ends
from printer_slicer.kernel import load_kernel
from printer_slicer.perimeters.bead_counts import CountedGraph
from printer_slicer.perimeters.beading import Beading
from printer_slicer.perimeters.graph import AxisGraph, find_crossings, thin_and_thick_ends
from printer_slicer.values import Struct, replace

__all__ = ["BeadLayout", "lay_out_beads"]

# Length, mm, on either side of a change of the count, within which beads move to their new positions.
_TRANSITION_LENGTH = 0.2


class BeadLayout(Struct, frozen=True, eq=False):
    """Beads along a medial axis. Level i is the loop of depth i; the last level is the border of the remaining area.

    Attributes:
        graph: the medial axis, divided where beads begin or end.
        port: (E, 2) ports at both ends of each piece.
        point: (P,) point of each port.
        leader: (P,) point whose thickness determines the beads.
        count: (P,) number of beads across.
        inset: (loops + 1, P) mm from the outline to the centre line of each loop, and to the remaining area.
        width: (loops + 1, P) mm of each loop, and of the middle bead.
        active: (loops + 1, E) whether the loops of each level run along the piece.
        middle: (E,) whether a middle bead follows the piece.
        used: (E,) see `CountedGraph`.
        wide: (E,) see `CountedGraph`.
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


def lay_out_beads(counted: CountedGraph, beading: Beading) -> BeadLayout:
    """Compute the widths and positions of the beads of a graph whose bead counts are known."""
    # Divide where beads have reached their new positions, and where ending loops turn around.
    ports, half = _Ports.of(counted, beading), beading.spacing[counted.graph.piece_layer] / 2
    counted = _divide_pieces(
        counted, [ports.find_distant_positions(far) for far in (np.full(len(half), _TRANSITION_LENGTH), half)]
    )
    # Divide where the room for a level ends.
    ends, room = _PieceEnds.of(counted, beading), counted.graph.radius.take(counted.graph.ends)
    inset, _ = ends.compute_beads(beading)
    counted = _divide_pieces(
        counted, [find_crossings(room - level.take(ends.ports.port), np.zeros(len(room))) for level in inset]
    )
    return _PieceEnds.of(counted, beading).make_layout(beading)


def _divide_pieces(counted: CountedGraph, cuts: list[tuple[Int, Float]]) -> CountedGraph:
    """Divide pieces (n,) at positions (n,) along them, 0 to 1."""
    relabelled = replace(counted.graph, origin=np.arange(len(counted.used)))
    piece, share = (np.concatenate(column) for column in zip(*cuts, strict=True))
    parts = relabelled.divide_pieces(piece, share)
    part = parts.origin
    return CountedGraph(
        parts,
        counted.used[part],
        counted.central[part],
        counted.corner[part],
        counted.wide[part],
        counted.count[part],
    )


class _Ports(Struct, frozen=True, eq=False):
    """Ports (ends of pieces) of a graph, with the bead counts and the changes of count near them; see `BeadLayout`.

    Attributes:
        counted: the graph and its counts.
        port: (E, 2).
        point: (P,).
        leader: (P,) point whose thickness determines the beads.
        count: (P,).
        length: (E,) mm along each piece; 0 into a corner, which moves together with the point where it begins.
        changing: (P,) whether the count changes at the port's point.
        change: (P,) port at the nearest change of the count, -1 if none is near.
        distance: (P,) mm along the axis to `change`.
    """

    counted: CountedGraph
    port: Int
    point: Int
    leader: Int
    count: Int
    length: Float
    changing: Bool
    change: Int
    distance: Float

    @classmethod
    def of(cls, counted: CountedGraph, beading: Beading) -> _Ports:
        """Find the ports of a graph whose bead counts are known."""
        graph, base, n = counted.graph, beading.full_count + 1, len(counted.graph.xy)
        leader, count = _find_leaders(counted, beading)
        keys, number = unique_inverse(((graph.ends * n + leader) * base + count).ravel())
        port, point, leader, count = number.reshape(-1, 2), keys // base // n, keys // base % n, keys % base
        changing = np.zeros(len(keys), np.bool_)
        changing[port[counted.used]] = True
        changing &= np.bincount(point[changing], minlength=n)[point] > 1
        length = np.where(counted.corner, 0.0, np.where(counted.used, graph.length, np.inf))
        change, distance = _find_nearest_changes(port, length, changing, _reach_of_changes(beading))
        return cls(counted, port, point, leader, count, length, changing, change, distance)

    def find_distant_positions(self, distance: Float) -> tuple[Int, Float]:
        """Find positions on pieces that are `distance` (E,) mm from a change of the count; return pieces, positions."""
        length = np.maximum(self.counted.graph.length, 1e-12)
        ends = self.distance.take(self.port)
        found = []
        for end in (0, 1):
            share = (distance - ends[:, end]) / length
            there = np.flatnonzero(
                self.counted.used
                & ~self.counted.corner
                & (share > 1e-3)
                & (share < 1 - 1e-3)
                & (self.change[self.port[:, end]] >= 0)
            )
            found.append((there, share[there] if end == 0 else 1 - share[there]))
        return np.concatenate([piece for piece, _ in found]), np.concatenate([share for _, share in found])


class _PieceEnds(Struct, frozen=True, eq=False):
    """Ports of a graph, with the positions of beads on both sides of changes of the count.

    Attributes:
        ports: the ports.
        to_wide: (P,) mm along the axis to the nearest wide piece.
        spacing: (loops + 1, P) from the room at the port, before the transition.
        moved: (loops + 1, P) added at the change.
        fewest: (P,) fewest loops on any side of the port's point.
    """

    ports: _Ports
    to_wide: Float
    spacing: Float
    moved: Float
    fewest: Int

    @classmethod
    def of(cls, counted: CountedGraph, beading: Beading) -> _PieceEnds:
        """Find the ports of a graph whose bead counts are known, and the positions of beads there."""
        ports, graph = _Ports.of(counted, beading), counted.graph
        layer = graph.layer[ports.point]
        spacing = beading.spacings(beading.room(graph.radius[ports.leader], layer), ports.count, layer)
        own = np.zeros(len(ports.point), np.bool_)
        own[ports.port[counted.used]] = True
        pairs = np.minimum(ports.count // 2, beading.loops)
        moved, fewest = _compute_shifts(ports.point, own, ports.changing, pairs, spacing)
        mouth = np.zeros(len(graph.xy), np.bool_)
        mouth[graph.ends[counted.wide]] = True
        reach = _reach_of_changes(beading)
        to_wide = _find_nearest_changes(ports.port, ports.length, mouth[ports.point], reach)[1]
        return cls(ports, to_wide, spacing, moved, fewest)

    def compute_beads(self, beading: Beading) -> tuple[Float, Float]:
        """Return the insets and widths (loops + 1, P) of beads at each port, mm."""
        ports, graph = self.ports, self.ports.counted.graph
        layer = graph.layer[ports.point]
        near = ports.change >= 0
        # In front of a wide place the beads must have reached the positions of the fixed-width loops.
        within = np.maximum(np.minimum(ports.distance + self.to_wide, _TRANSITION_LENGTH), 1e-9)
        ease = np.where(near & (self.to_wide > 0), np.maximum(1 - ports.distance / within, 0.0), 0.0)
        spacing = self.spacing + np.where(near, self.moved[:, np.maximum(ports.change, 0)], 0.0) * ease
        pairs, rounding = np.minimum(ports.count // 2, beading.loops), beading.rounding[layer]
        outside = np.concatenate([np.zeros((1, len(layer))), np.cumsum(spacing[:-1], axis=0)])
        inset = beading.margin[layer] + outside
        inset[:-1] += spacing[:-1] / 2
        room = beading.room(graph.radius[ports.leader], layer)
        left = room - 2 * np.take_along_axis(outside, pairs[None], axis=0)[0]
        width = spacing + rounding
        width[-1] = np.where(pairs > 0, left, spacing[-1]) + rounding
        return inset, width

    def make_layout(self, beading: Beading) -> BeadLayout:
        """Build the layout from the ports."""
        ports, counted, graph = self.ports, self.ports.counted, self.ports.counted.graph
        inset, width = self.compute_beads(beading)
        count = ports.count[ports.port[:, 0]]
        pairs = np.minimum(count // 2, beading.loops)
        rest = _sum_ends(graph.radius.take(graph.ends)) - _sum_ends(inset.take(ports.port, axis=1))
        level = np.arange(beading.loops + 1)[:, None]
        there = np.where(level < beading.loops, pairs > level, count == beading.full_count)
        # The loop of an ending level turns around on its own side of the change, not over the bead beyond.
        nearest = np.argmin(ports.distance[ports.port], axis=1)
        end = np.take_along_axis(ports.port, nearest[:, None], axis=1)[:, 0]
        change = ports.change[end]
        half = beading.spacing[graph.piece_layer] / 2
        # In front of a wide place there may be no room to turn; the loop turns where it ends.
        middle = ports.distance[end] + graph.length / 2
        close = (middle < half) & ((ports.distance + self.to_wide)[end] > half)
        ending = (change >= 0) & close & (self.fewest[change] <= level) & (level < beading.loops)
        active = there & (rest > 0) & ~ending & counted.used
        middle = counted.central & (count % 2 == 1) & (count < beading.full_count)
        return BeadLayout(
            graph,
            ports.port,
            ports.point,
            ports.leader,
            ports.count,
            inset,
            width,
            active,
            middle,
            counted.used,
            counted.wide,
        )


def _sum_ends(ends: Float) -> Float:
    """Return the sums (..., n) of values at both ends (..., n, 2)."""
    return np.asarray(ends[..., 0] + ends[..., 1])


def _find_leaders(counted: CountedGraph, beading: Beading) -> tuple[Int, Int]:
    """Return the points (E, 2) whose thickness determines the beads at both ends of each piece, and their counts.

    For central pieces these are their own ends; for other used pieces, the point from which they descend.
    """
    graph = counted.graph
    ends, radius = graph.ends, graph.radius
    top = np.full(len(radius), -1)
    np.maximum.at(top, ends[counted.central].ravel(), np.repeat(counted.count[counted.central], 2))
    np.maximum.at(top, ends[counted.wide].ravel(), beading.full_count)
    others = np.flatnonzero(counted.used & ~counted.central)
    low, high = thin_and_thick_ends(ends.take(others, axis=0), radius)
    above = np.arange(len(radius))
    rises = (radius[high] > radius[low]) & (top[low] < 0)
    order = np.argsort(radius[high[rises]])
    above[low[rises][order]] = high[rises][order]
    above = find_chain_ends(above)
    alone = top < 0  # an isolated place that is about as wide as long
    for limit in beading.thresholds():
        top[alone] = np.maximum(top[alone], 0) + (radius[alone] > limit[graph.layer[alone]])
    leader = ends.copy()
    leader[others] = above[high][:, None]
    count = top[leader]
    count[counted.central] = counted.count[counted.central][:, None]
    count[counted.wide] = beading.full_count
    return leader, count


def _compute_shifts(
    point: Int, is_used: Bool, changing: Bool, pairs: Int, spacing: Float
) -> tuple[Float, Int]:
    """Return the shift of beads (loops + 1, P) and the fewest loops (P,) at each port.

    The shift moves the beads of all sides of a change to their mean position.
    """
    # Ports of a point follow each other.
    total = np.zeros((len(spacing), int(point.max(initial=0)) + 1))
    sides = np.zeros_like(total, np.int64)
    fewest = np.full(total.shape[1], np.iinfo(np.int64).max)
    chosen = np.flatnonzero(is_used)
    np.minimum.at(fewest, point[chosen], pairs[chosen])
    for level in range(len(spacing) - 1):
        there = chosen[pairs[chosen] > level]
        total[level] = np.bincount(point[there], spacing[level, there], total.shape[1])
        sides[level] = np.bincount(point[there], minlength=total.shape[1])
    moved = np.where(sides > 1, total / np.maximum(sides, 1), 0.0)[:, point]
    moved = np.where((sides[:, point] > 1) & changing, moved - spacing, 0.0)
    return moved, fewest[point]


def _reach_of_changes(beading: Beading) -> float:
    """Return the distance along the axis, mm, within which changes of the count are searched."""
    return 2 * _TRANSITION_LENGTH + float(beading.spacing.max(initial=0))


def _find_nearest_changes(port: Int, length: Float, changing: Bool, reach: float) -> tuple[Int, Float]:
    """Return for each port (P,) the port at the nearest change along the axis, or -1, and its distance, mm."""
    kernel = load_kernel()
    if kernel:
        found = kernel.nearest_marked(port.data, length.data, changing.astype(np.int64).data, reach)
        return np.frombuffer(found[0], np.int64), np.frombuffer(found[1])
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
