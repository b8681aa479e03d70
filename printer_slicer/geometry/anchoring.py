"""Join the ends of infill lines along the outlines that they end on.

This makes fewer, longer lines. Ends that stay free get a hook, so that they hold on to a wall.
"""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import (
    Bool,
    Float,
    Int,
    consecutive,
    distinct,
    next_in_ring,
    previous_in_ring,
    run_starts,
)
from printer_slicer.geometry.areas import Areas
from printer_slicer.geometry.connectivity import count_chain_steps
from printer_slicer.geometry.corner_cutting import cut_sharp_corners, reach_of_corner
from printer_slicer.geometry.polylines import Polylines
from printer_slicer.values import Struct

__all__ = ["anchor"]

_SHORTEST_HOOK = 0.01  # mm
_OBLIQUE = 0.05  # cosine of the angle between line and outline; below this the line counts as perpendicular


def anchor(areas: Areas, lines: Polylines, *, longest: float, hook: float, apart: float = 0.0) -> Polylines:
    """Join the ends of lines along the outlines on which they lie.

    Each end may be joined to one of its two neighbours on the outline, if the connection is at most `longest`. As many
    ends as possible are joined, with the least total length. (On outlines with an odd number of ends, the longest
    connection is excluded first.) An end that stays free gets a hook along the outline, toward the side with more
    room, at most halfway to its neighbour. No line is joined to itself. Lines that would form a loop stay open at the
    start of the loop.

    Where a line meets the outline at a sharp angle, a connection on that side would first run on top of the line, so
    the corner is cut off. A connection that lies entirely within such corners is not used, and that part of a hook does
    not count toward its length.

    Args:
        areas: the areas that the lines were clipped to; `lines.edge` says on which of their edges the lines end.
        lines: open lines.
        longest: mm, the longest connection from end to end; 0 joins none.
        hook: mm, the length of a hook; 0 makes none.
        apart: mm between lines that lie side by side; 0 keeps sharp corners.

    Returns:
        The joined lines with their hooks.
    """
    ends = np.flatnonzero(lines.edge.ravel() >= 0)
    if not len(ends):
        return lines
    outline = _JoinedOutlines.of(areas)
    connections = _find_connections(lines, outline, ends, apart)
    mate = np.full(2 * lines.n_lines, -1)
    chosen = np.flatnonzero(_choose_connections(connections, longest))
    mate[connections.end[chosen]], mate[connections.next_end[chosen]] = (
        connections.next_end[chosen],
        connections.end[chosen],
    )
    joints = _OutlineParts(connections.end[chosen], connections.place[chosen], connections.next_place[chosen])
    hooks = _make_hooks(connections, mate, hook)
    mate, hooks = _open_loops(mate, joints, hooks)
    joined, corner = _concatenate_lines(lines, outline, mate, joints, hooks)
    return cut_sharp_corners(joined, corner, areas, apart) if apart else joined


class _JoinedOutlines(Struct, frozen=True, eq=False):
    """All outlines joined end to end, so that one number gives a position on an outline.

    Attributes:
        areas: the areas with these outlines.
        place: (N + 1,) mm, position of each point, and of the end of the last ring.
        ring_place: (R + 1,) mm, position where each ring starts, and where the last one ends.
        ring: (N,) ring of each point.
    """

    areas: Areas
    place: Float
    ring_place: Float
    ring: Int

    @classmethod
    def of(cls, areas: Areas) -> _JoinedOutlines:
        """Join all rings of the areas end to end."""
        step = np.hypot(*(areas.xy[areas.following] - areas.xy).T)
        place = np.append(0.0, np.cumsum(step))
        ring = areas.point_ring
        return cls(areas, place, place[areas.ring_start], ring)

    def edge_at(self, place: Float, ring: Int) -> Int:
        """Return the edge (n,) on which each position lies, given the ring of each."""
        edge = np.searchsorted(self.place, place, side="right") - 1
        return np.clip(edge, self.areas.ring_start[ring], self.areas.ring_start[ring + 1] - 1)

    def points_at(self, place: Float, edge: Int) -> Float:
        """Return the points (n, 2) at positions on the given edges, mm."""
        begin, end = self.areas.xy[edge], self.areas.xy[self.areas.following[edge]]
        long = np.maximum(self.place[edge + 1] - self.place[edge], 1e-12)
        return begin + ((place - self.place[edge]) / long)[:, None] * (end - begin)


class _Connections(Struct, frozen=True, eq=False):
    """Possible connections: from each line end to the next one on its ring, in order around the rings.

    Attributes:
        end: (E,) the line end: 2 i for the first and 2 i + 1 for the last point of line i.
        next_end: (E,) the next line end; the same one where a ring has no other.
        ring: (E,) ascending.
        first: (R,) the first connection of each ring that has any.
        count: (R,) number of connections of that ring.
        place: (E,) position of the end on the outline.
        next_place: (E,) position of the next end; beyond the end of the ring if the connection passes its first point.
        cut: (E, 2) mm that a sharp corner takes off a connection at this end, forward and backward.
    """

    end: Int
    next_end: Int
    ring: Int
    first: Int
    count: Int
    place: Float
    next_place: Float
    cut: Float

    @property
    def length(self) -> Float:
        """Length (E,) of each connection, mm."""
        return self.next_place - self.place

    @property
    def previous(self) -> Int:
        """Index (E,) of the previous connection around the ring."""
        return previous_in_ring(np.append(self.first, len(self.end)))

    @property
    def following(self) -> Int:
        """Index (E,) of the next connection around the ring."""
        return next_in_ring(np.append(self.first, len(self.end)))


def _find_connections(lines: Polylines, outline: _JoinedOutlines, ends: Int, apart: float) -> _Connections:
    """Sort the line ends by position on the outlines and connect each to the next one on its ring."""
    edge = lines.edge.ravel()[ends]
    point = np.stack([lines.start[:-1], lines.start[1:] - 1], axis=1).ravel()[ends]
    into = np.hypot(*(lines.xy[point] - outline.areas.xy[edge]).T)
    place = np.minimum(outline.place[edge] + into, outline.place[edge + 1])
    order = np.lexsort((place, edge))
    end, place, ring = ends[order], place[order], outline.ring[edge[order]]
    first = np.flatnonzero(run_starts(ring))
    count = np.diff(np.append(first, len(ring)))
    last = first + count - 1
    next_end, next_place = np.roll(end, -1), np.roll(place, -1)
    next_end[last] = end[first]
    around = outline.ring_place[ring[first] + 1] - outline.ring_place[ring[first]]
    next_place[last] = place[first] + around
    cut = _measure_sharp_corners(lines, outline.areas, end, edge[order], apart)
    return _Connections(end, next_end, ring, first, count, place, np.maximum(next_place, place), cut)


def _measure_sharp_corners(lines: Polylines, areas: Areas, end: Int, edge: Int, apart: float) -> Float:
    """Return how far the outline runs, forward and backward, (E, 2) mm, before it is `apart` mm from the line."""
    last = end % 2 == 1
    point = np.where(last, lines.start[end // 2 + 1] - 1, lines.start[end // 2])
    back = lines.xy[np.where(last, point - 1, point + 1)] - lines.xy[point]
    along = areas.xy[areas.following[edge]] - areas.xy[edge]
    cosine = (back * along).sum(axis=1) / np.maximum(np.hypot(*back.T) * np.hypot(*along.T), 1e-12)
    both = np.stack([cosine, -cosine], axis=1)
    return np.where(both > _OBLIQUE, reach_of_corner(both, apart), 0.0)


def _choose_connections(connections: _Connections, longest: float) -> Bool:
    """Return a mask (E,) of connections to use: no two neighbours, as many as possible, with the least total length.

    Allowed connections form runs, separated by those that are not allowed. In a run of odd length every other one is
    used, starting with the first. In a run of even length one end stays free: the alternation shifts by one at the
    position that gives the least sum. On a ring where all are allowed, every other one is used if their number is even.
    If it is odd, the longest one is excluded first, and one end stays free.
    """
    allowed = (connections.length <= longest) & (connections.end // 2 != connections.next_end // 2)
    cut, next_cut = connections.cut[:, 0], connections.cut[connections.following, 1]
    # If the lines at both ends lean toward each other, they cross: the connection would make a small loop there.
    allowed &= connections.length >= cut + next_cut + 2 * np.minimum(cut, next_cut)
    place, number = np.arange(len(allowed)), np.repeat(np.arange(len(connections.first)), connections.count)
    first, count = connections.first[number], connections.count[number]
    full = np.logical_and.reduceat(allowed, connections.first)
    odd = connections.count % 2 == 1
    allowed[_find_greatest_index(connections.length, connections.first, number)[full & odd]] = False
    # Rotate each ring so that it starts after a connection that is not allowed: no run wraps around its end.
    breaks = np.maximum.reduceat(np.where(allowed, -1, place), connections.first)
    begin = np.where(full & ~odd, connections.first, breaks + 1)
    turned = first + (begin[number] - 2 * first + place) % count
    allowed = allowed[turned]
    begins = allowed & ~np.append(False, allowed[:-1] & (number[1:] == number[:-1]))
    run, inside = np.cumsum(begins) - 1, np.flatnonzero(allowed)
    taken = np.zeros(len(allowed), np.bool_)
    if len(inside):
        ring = number[inside]
        chosen = _choose_alternating(run[inside], connections.length[turned[inside]], (full & ~odd)[ring])
        taken[turned[inside]] = chosen
    return taken


def _find_greatest_index(values: Float, first: Int, number: Int) -> Int:
    """Return the index (R,) of the greatest value of each group."""
    greatest = np.maximum.reduceat(values, first)
    candidates = np.flatnonzero(values == greatest[number])
    index = np.zeros(len(first), np.int64)
    index[number[candidates[::-1]]] = candidates[::-1]
    return index


def _choose_alternating(run: Int, length: Float, is_ring: Bool) -> Bool:
    """Choose every other connection of each run, so that the total length is least.

    Args:
        run: (n,) run of each connection, ascending.
        length: (n,) mm.
        is_ring: (n,) whether the run is a whole ring with an even number of connections.

    Returns:
        A mask (n,).
    """
    begin = np.flatnonzero(run_starts(run))
    size = np.diff(np.append(begin, len(run)))
    owner = np.repeat(np.arange(len(begin)), size)
    step = np.arange(len(run)) - begin[owner]
    odd, closed = step % 2 == 1, is_ring[begin]
    signed = np.where(odd, -length, length)
    before = np.cumsum(signed) - signed
    before -= before[begin[owner]]  # sum of the even connections so far minus the odd ones
    total = np.add.reduceat(signed, begin)
    # Shift the alternation before the even connection where that saves most. Runs of odd length need no shift.
    even_run = (size % 2 == 0) & ~closed
    choice = np.where(odd, np.inf, before)
    least = np.minimum(np.minimum.reduceat(choice, begin), total)
    change = np.full(len(begin), len(run))
    hit = np.flatnonzero(choice == least[owner])
    change[owner[hit[::-1]]] = step[hit[::-1]]
    change = np.where(even_run, np.where(least == total, size, change), size)
    change = np.where(closed & (total > 0), 0, change)
    return np.asarray(np.where(step < change[owner], ~odd, odd))


class _OutlineParts(Struct, frozen=True, eq=False):
    """Parts of outlines, from `place` forward to `to_place`, or backward if `to_place` is less.

    Attributes:
        end: (J,) the line end at which each part starts.
        place: (J,) mm, position of that end.
        to_place: (J,) mm; may lie beyond the end of the ring, or before its start.
    """

    end: Int
    place: Float
    to_place: Float

    def append(self, end: Int, place: Float, to_place: Float) -> _OutlineParts:
        """Return these parts followed by new parts with the given attributes."""
        return _OutlineParts(
            np.concatenate([self.end, end]),
            np.concatenate([self.place, place]),
            np.concatenate([self.to_place, to_place]),
        )


def _make_hooks(connections: _Connections, mate: Int, hook: float) -> _OutlineParts:
    """Make hooks for the line ends without a connection."""
    length = connections.length
    free = np.flatnonzero(mate[connections.end] < 0)
    room = np.stack([length[free], length[connections.previous[free]]], axis=1) / 2
    # Of two equally long hooks, the one with more room is better.
    good = np.minimum(room, hook) - connections.cut[free]
    forward = np.where(np.isclose(*good.T), room[:, 0] >= room[:, 1], good[:, 0] > good[:, 1])
    reach = np.minimum(np.where(forward, *room.T), hook)
    long = (reach > _SHORTEST_HOOK) & (good.max(axis=1, initial=-np.inf) > 0)
    free, reach = free[long], np.where(forward, reach, -reach)[long]
    return _OutlineParts(connections.end[free], connections.place[free], connections.place[free] + reach)


def _open_loops(mate: Int, joints: _OutlineParts, hooks: _OutlineParts) -> tuple[Int, _OutlineParts]:
    """Replace the joint that closes a loop by a hook that reaches to the start of the loop."""
    following = _find_next_entries(mate)
    lowest, done = np.arange(len(mate)) // 2, following < 0
    jump = np.where(done, np.arange(len(mate)), following)
    ended = done
    for _ in range(max(len(mate), 2).bit_length()):
        lowest, ended, jump = np.minimum(lowest, lowest[jump]), ended | ended[jump], jump[jump]
    begin = 2 * distinct(lowest[~ended])
    if not len(begin):
        return mate, hooks
    joined, closing = mate, mate[begin]
    mate = mate.copy()
    mate[begin] = mate[closing] = -1
    # A joint is stored for one of its two ends. The hook runs from the end of the loop to its start.
    turned = np.isin(joints.end, begin)
    those = turned | np.isin(joints.end, closing)
    end = np.where(turned, joined[joints.end], joints.end)
    place = np.where(turned, joints.to_place, joints.place)
    to_place = np.where(turned, joints.place, joints.to_place)
    return mate, hooks.append(end[those], place[those], to_place[those])


def _find_next_entries(mate: Int) -> Int:
    """Return for each line end (2 S,) where a path that enters there enters its next line, or -1."""
    return np.asarray(mate[np.arange(len(mate)) ^ 1])


def _concatenate_lines(
    lines: Polylines, outline: _JoinedOutlines, mate: Int, joints: _OutlineParts, hooks: _OutlineParts
) -> tuple[Polylines, Int]:
    """Concatenate the lines with their joints and hooks.

    Returns:
        The joined lines, and the indices of the points that may be cut off as sharp corners.
    """
    entry, path = _order_paths(mate)
    # Joints lie at the end where the path leaves a line. Hooks lie before the first and after the last line.
    joint_of, hook_of = np.full(len(mate), -1), np.full(len(mate), -1)
    joint_of[joints.end] = np.arange(len(joints.end))
    joint_of[mate < 0] = -1  # a joint that closed a loop has become a hook
    other = np.flatnonzero((joint_of < 0) & (mate >= 0))
    joint_back = np.full(len(mate), -1)
    joint_back[other] = joint_of[mate[other]]
    hook_of[hooks.end] = np.arange(len(hooks.end))

    vertices = _VertexPool(lines, outline, hooks)
    first = run_starts(path)
    leave = entry ^ 1
    chunks = [
        vertices.part_vertices(hooks, np.where(first, hook_of[entry], -1), backward=True),
        vertices.line_vertices(entry),
        vertices.part_vertices(joints, joint_of[leave], backward=False),
        vertices.part_vertices(joints, joint_back[leave], backward=True),
        vertices.part_vertices(hooks, np.where(mate[leave] < 0, hook_of[leave], -1), backward=False),
    ]
    return vertices.build(chunks, path, entry)


def _order_paths(mate: Int) -> tuple[Int, Int]:
    """Return the end at which the path enters each line, in path order, and the path of each line."""
    n = len(mate)
    following = _find_next_entries(mate)
    last, rank = count_chain_steps(np.where(following < 0, np.arange(n), following))
    heads = np.flatnonzero(mate < 0)
    head_of = np.full(n, -1)
    head_of[last[heads]] = heads
    head, tail = head_of[last], last ^ 1
    kept = np.flatnonzero(head <= tail)  # each path is found in both directions
    order = kept[np.lexsort((-rank[kept], head[kept]))]
    return order, head[order]


class _VertexPool:
    """All points that the joined lines may use: points of the lines and outlines, and the tips of hooks."""

    def __init__(self, lines: Polylines, outline: _JoinedOutlines, hooks: _OutlineParts) -> None:
        self.lines, self.outline = lines, outline
        ring = self._find_rings(hooks)
        low, high = outline.ring_place[ring], outline.ring_place[ring + 1]
        tip = low + (hooks.to_place - low) % (high - low)
        tips = outline.points_at(tip, outline.edge_at(tip, ring))
        self.xy = np.concatenate([lines.xy, outline.areas.xy, tips])
        self._tip = len(lines.xy) + len(outline.areas.xy)
        self._is_corner = self._find_corners(len(tips))
        self._hooks = hooks

    def _find_rings(self, parts: _OutlineParts) -> Int:
        """Return the ring on which each outline part lies."""
        return self.outline.ring[self.lines.edge.ravel()[parts.end]]

    def line_vertices(self, entry: Int) -> tuple[Int, Int]:
        """Return the vertices of each line in the direction of the path, and the number of vertices per line."""
        line, turned = entry // 2, entry % 2
        first, size = self.lines.start[line], self.lines.size[line]
        return self._number_sequence(first + turned * (size - 1), size, 1 - 2 * turned), size

    def part_vertices(self, parts: _OutlineParts, which: Int, *, backward: bool) -> tuple[Int, Int]:
        """Return the vertices of the outline parts `which` (-1: none), with hook tips, and how many each part has."""
        some = np.flatnonzero(which >= 0)
        item = which[some]
        areas, is_hook = self.outline.areas, parts is self._hooks
        ring = self._find_rings(parts)[item]
        start, n = areas.ring_start[ring], np.diff(areas.ring_start)[ring]
        low, high = self.outline.ring_place[ring], self.outline.ring_place[ring + 1]
        begin, end = parts.place[item], parts.to_place[item]
        ahead = end >= begin
        one, another = np.minimum(begin, end), np.maximum(begin, end)
        # Vertices strictly in between; the count continues around the ring.
        first = self._count_points_up_to(one, ring, start, low, high) + 1
        between = np.maximum(self._count_points_up_to(another, ring, start, low, high) - first + 1, 0)
        forward = ahead != backward
        step = np.where(forward, 1, -1)
        place = self._number_sequence(np.where(forward, first, first + between - 1), between, step)
        owner = np.repeat(np.arange(len(some)), between)
        index = len(self.lines.xy) + start[owner] + place % n[owner]
        count = np.zeros(len(which), np.int64)
        count[some] = between
        if not is_hook:
            return index, count
        # The tip comes first if the path starts with the hook, otherwise last.
        at = np.cumsum(between) - between if backward else np.cumsum(between)
        count[some] += 1
        return np.insert(index, at, self._tip + item), count

    def _count_points_up_to(self, place: Float, ring: Int, start: Int, low: Float, high: Float) -> Int:
        """Count the points of the ring between its first point and a position, which may be more than one turn away."""
        turns = np.floor((place - low) / (high - low)).astype(np.int64)
        here = place - turns * (high - low)
        return turns * np.diff(self.outline.areas.ring_start)[ring] + self.outline.edge_at(here, ring) - start

    def _number_sequence(self, first: Int, count: Int, step: Int) -> Int:
        """Return the concatenated sequences of `count[i]` numbers `first[i], first[i] + step[i], ...` for all i."""
        return np.asarray(
            np.repeat(first, count) + consecutive(np.zeros_like(count), count) * np.repeat(step, count)
        )

    def build(self, chunks: list[tuple[Int, Int]], path: Int, entry: Int) -> tuple[Polylines, Int]:
        """Concatenate the chunks of the lines into one polyline per path.

        Returns:
            The polylines, and the indices of their points that are corners on the outline with the area inside.
        """
        counts = np.stack([count for _, count in chunks], axis=1)
        begins = np.cumsum([0, *(len(index) for index, _ in chunks)])[:-1]
        first = np.stack([at + np.cumsum(c) - c for at, (_, c) in zip(begins, chunks, strict=True)], axis=1)
        pool = np.concatenate([index for index, _ in chunks])
        index = pool[consecutive(first.ravel(), counts.ravel())]
        heads = run_starts(path)
        size = np.bincount(np.cumsum(heads) - 1, weights=counts.sum(axis=1)).astype(np.int64)
        layer = self.lines.layer[entry[heads] // 2]
        made, kept = Polylines.of(self.xy[index], size, layer).without_repeats()
        return made, np.flatnonzero(self._is_corner[index[kept]])

    def _find_corners(self, n_tips: int) -> Bool:
        """Return a mask (V,) of vertices that are line ends on an outline or convex corners of an outline."""
        lines, areas = self.lines, self.outline.areas
        of_lines = np.zeros(len(lines.xy), np.bool_)
        of_lines[lines.start[:-1]] |= lines.edge[:, 0] >= 0
        of_lines[lines.start[1:] - 1] |= lines.edge[:, 1] >= 0
        after = areas.xy[areas.following] - areas.xy
        before = after[previous_in_ring(areas.ring_start)]
        convex = before[:, 0] * after[:, 1] > before[:, 1] * after[:, 0]
        return np.concatenate([of_lines, convex, np.zeros(n_tips, np.bool_)])
