"""Lines that end on outlines, joined along them: fewer, longer lines, and ends that hold on to a wall."""

from __future__ import annotations

from dataclasses import dataclass

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
from printer_slicer.geometry.connectivity import chain_steps
from printer_slicer.geometry.corner_cutting import cut_sharp_corners, reach_of_corner
from printer_slicer.geometry.polylines import Polylines

__all__ = ["anchor"]

_SHORTEST_HOOK = 0.01  # mm
_LEANS = 0.05  # cosine of the angle between line and outline: under that it stands upright


def anchor(areas: Areas, lines: Polylines, *, longest: float, hook: float, apart: float = 0.0) -> Polylines:
    """Join the ends of lines along the outlines on which they lie.

    Each end is joined to one of its two neighbours on the outline where the way to it is no longer than `longest`: as
    many as can be, and of the ways to join as many the one that takes the least length (on outlines with an odd number
    of ends, of those that do without its longest way). An end left over gets a hook
    along the outline, toward the side with more room, at most to the middle between it and its neighbour. No line is
    joined to itself; lines that together come out as a loop end where they begin.

    Where a line meets the outline at a sharp angle, what runs along it on that side would lie on the line at first:
    the corner is cut off. Ways that consist of nothing else are not taken, and that much of a hook does not count.

    Args:
        areas: what the lines were cut by; their `edge` says where they end.
        lines: open lines.
        longest: mm, of a way from end to end; 0 joins none.
        hook: mm, of a hook; 0 makes none.
        apart: mm from line to line, where they lie side by side; 0 keeps sharp corners.
    """
    ends = np.flatnonzero(lines.edge.ravel() >= 0)
    if not len(ends):
        return lines
    outline = _Outline.of(areas)
    ways = _ways(lines, outline, ends, apart)
    mate = np.full(2 * lines.n_lines, -1)
    chosen = np.flatnonzero(_chosen(ways, longest))
    mate[ways.end[chosen]], mate[ways.next_end[chosen]] = ways.next_end[chosen], ways.end[chosen]
    joints = _Stretches(ways.end[chosen], ways.place[chosen], ways.next_place[chosen])
    hooks = _hooks(ways, mate, hook)
    mate, hooks = _loops_opened(mate, joints, hooks)
    joined, corner = _assembled(lines, outline, mate, joints, hooks)
    return cut_sharp_corners(joined, corner, areas, apart) if apart else joined


@dataclass(frozen=True, slots=True, eq=False)
class _Outline:
    """The outlines as one long line.

    Attributes:
        areas: whose outlines they are.
        place: (N + 1,) mm, of each point and of the end of the last ring.
        ring_place: (R + 1,) mm, where each ring begins, and where the last one ends.
        ring: (N,) of each point.
    """

    areas: Areas
    place: Float
    ring_place: Float
    ring: Int

    @classmethod
    def of(cls, areas: Areas) -> _Outline:
        """All rings of the areas one after the other."""
        step = np.hypot(*(areas.xy[areas.following] - areas.xy).T)
        place = np.append(0.0, np.cumsum(step))
        ring = areas.point_ring
        return cls(areas, place, place[areas.ring_start], ring)

    def edge_at(self, place: Float, ring: Int) -> Int:
        """(n,) the edge on which a place of a ring lies."""
        edge = np.searchsorted(self.place, place, side="right") - 1
        return np.clip(edge, self.areas.ring_start[ring], self.areas.ring_start[ring + 1] - 1)

    def xy(self, place: Float, edge: Int) -> Float:
        """(n, 2) the points at these places."""
        begin, end = self.areas.xy[edge], self.areas.xy[self.areas.following[edge]]
        long = np.maximum(self.place[edge + 1] - self.place[edge], 1e-12)
        return begin + ((place - self.place[edge]) / long)[:, None] * (end - begin)


@dataclass(frozen=True, slots=True, eq=False)
class _Ways:
    """The way along the outline from each end to the next one of its ring, in their order around the rings.

    Attributes:
        end: (E,) the end: 2 i + 0 or 1 for the first or last point of line i.
        next_end: (E,) the one it leads to; itself where a ring has no other.
        ring: (E,) ascending.
        first: (R,) the first way of each ring that has any.
        count: (R,) how many that ring has.
        place: (E,) of the end.
        next_place: (E,) of the next; behind the end of the ring where the way passes its first point.
        cut: (E, 2) mm that are cut off of what runs along the outline from the end, forward and backward.
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
        """(E,) mm."""
        return self.next_place - self.place

    @property
    def previous(self) -> Int:
        """(E,) the way before it around the ring."""
        return previous_in_ring(np.append(self.first, len(self.end)))

    @property
    def following(self) -> Int:
        """(E,) the way after it around the ring."""
        return next_in_ring(np.append(self.first, len(self.end)))


def _ways(lines: Polylines, outline: _Outline, ends: Int, apart: float) -> _Ways:
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
    cut = _cut(lines, outline.areas, end, edge[order], apart)
    return _Ways(end, next_end, ring, first, count, place, np.maximum(next_place, place), cut)


def _cut(lines: Polylines, areas: Areas, end: Int, edge: Int, apart: float) -> Float:
    """(E, 2) mm from each end to where the line and what runs along the outline, both ways, are `apart`."""
    last = end % 2 == 1
    point = np.where(last, lines.start[end // 2 + 1] - 1, lines.start[end // 2])
    back = lines.xy[np.where(last, point - 1, point + 1)] - lines.xy[point]
    along = areas.xy[areas.following[edge]] - areas.xy[edge]
    cosine = (back * along).sum(axis=1) / np.maximum(np.hypot(*back.T) * np.hypot(*along.T), 1e-12)
    both = np.stack([cosine, -cosine], axis=1)
    return np.where(both > _LEANS, reach_of_corner(both, apart), 0.0)


def _chosen(ways: _Ways, longest: float) -> Bool:
    """(E,) which ways are taken: no two neighbours, as many as possible, and of those the shortest.

    Ways that may be taken lie in runs between those that may not. In a run of an odd number every other one from the
    first on is taken; in one of an even number one end is left over, and the run changes step there, where the sum is
    least. On a ring without any that may not, every other one is taken if their number is even; else one end is left
    over, and the longest way is one of the two beside it.
    """
    may = (ways.length <= longest) & (ways.end // 2 != ways.next_end // 2)
    here, there = ways.cut[:, 0], ways.cut[ways.following, 1]
    # Lines that lean over the way from both sides cross before it: a small loop would lie on the crossing.
    may &= ways.length >= here + there + 2 * np.minimum(here, there)
    place, number = np.arange(len(may)), np.repeat(np.arange(len(ways.first)), ways.count)
    first, count = ways.first[number], ways.count[number]
    full = np.logical_and.reduceat(may, ways.first)
    odd = ways.count % 2 == 1
    may[_place_of_greatest(ways.length, ways.first, number)[full & odd]] = False
    # Each ring turned so that it begins after a way that may not be taken: no run passes its end.
    breaks = np.maximum.reduceat(np.where(may, -1, place), ways.first)
    begin = np.where(full & ~odd, ways.first, breaks + 1)
    turned = first + (begin[number] - 2 * first + place) % count
    may = may[turned]
    begins = may & ~np.append(False, may[:-1] & (number[1:] == number[:-1]))
    run, inside = np.cumsum(begins) - 1, np.flatnonzero(may)
    taken = np.zeros(len(may), np.bool_)
    if len(inside):
        ring = number[inside]
        chosen = _alternate(run[inside], ways.length[turned[inside]], (full & ~odd)[ring])
        taken[turned[inside]] = chosen
    return taken


def _place_of_greatest(values: Float, first: Int, number: Int) -> Int:
    """(R,) where each group's greatest value stands."""
    greatest = np.maximum.reduceat(values, first)
    there = np.flatnonzero(values == greatest[number])
    place = np.zeros(len(first), np.int64)
    place[number[there[::-1]]] = there[::-1]
    return place


def _alternate(run: Int, length: Float, around: Bool) -> Bool:
    """(n,) which members of each run are taken; `around` for members of rings of an even number, all of one run."""
    begin = np.flatnonzero(run_starts(run))
    size = np.diff(np.append(begin, len(run)))
    owner = np.repeat(np.arange(len(begin)), size)
    step = np.arange(len(run)) - begin[owner]
    odd = step % 2 == 1
    signed = np.where(odd, -length, length)
    before = np.cumsum(signed) - signed
    before -= before[begin[owner]]  # even ones so far less odd ones so far
    total = np.add.reduceat(signed, begin)
    closed = around[begin]
    # Change of step before the even member where what is gained is most; with an odd number there is none.
    even_run = (size % 2 == 0) & ~closed
    choice = np.where(odd, np.inf, before)
    least = np.minimum(np.minimum.reduceat(choice, begin), total)
    change = np.full(len(begin), len(run))
    hit = np.flatnonzero(choice == least[owner])
    change[owner[hit[::-1]]] = step[hit[::-1]]
    change = np.where(even_run, np.where(least == total, size, change), size)
    change = np.where(closed & (total > 0), 0, change)
    return np.asarray(np.where(step < change[owner], ~odd, odd))


@dataclass(frozen=True, slots=True, eq=False)
class _Stretches:
    """Stretches of outline, walked forward from `place` to `to_place` or, if `to_place` is less, backward.

    `end` (J,) is the end of a line that each begins at; `to_place` may lie behind the end of the ring, or before its
    begin.
    """

    end: Int
    place: Float
    to_place: Float

    def and_more(self, end: Int, place: Float, to_place: Float) -> _Stretches:
        """These and others."""
        return _Stretches(
            np.concatenate([self.end, end]),
            np.concatenate([self.place, place]),
            np.concatenate([self.to_place, to_place]),
        )


def _hooks(ways: _Ways, mate: Int, hook: float) -> _Stretches:
    """The hooks of the ends that are left over."""
    length = ways.length
    free = np.flatnonzero(mate[ways.end] < 0)
    room = np.stack([length[free], length[ways.previous[free]]], axis=1) / 2
    # Hooks as long are equally good, and then more room is.
    good = np.minimum(room, hook) - ways.cut[free]
    forward = np.where(np.isclose(*good.T), room[:, 0] >= room[:, 1], good[:, 0] > good[:, 1])
    reach = np.minimum(np.where(forward, *room.T), hook)
    long = (reach > _SHORTEST_HOOK) & (good.max(axis=1, initial=-np.inf) > 0)
    free, reach = free[long], np.where(forward, reach, -reach)[long]
    return _Stretches(ways.end[free], ways.place[free], ways.place[free] + reach)


def _loops_opened(mate: Int, joints: _Stretches, hooks: _Stretches) -> tuple[Int, _Stretches]:
    """Joints that close a loop become a hook that reaches to where the loop begins."""
    following = _following(mate)
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
    # The stretch belongs to one of its two ends; it is walked from the end of the loop to where the loop begins.
    turned = np.isin(joints.end, begin)
    those = turned | np.isin(joints.end, closing)
    end = np.where(turned, joined[joints.end], joints.end)
    place = np.where(turned, joints.to_place, joints.place)
    to_place = np.where(turned, joints.place, joints.to_place)
    return mate, hooks.and_more(end[those], place[those], to_place[those])


def _following(mate: Int) -> Int:
    """(2 S,) entering a line at an end, where the next line is entered; -1 at the last."""
    return np.asarray(mate[np.arange(len(mate)) ^ 1])


def _assembled(
    lines: Polylines, outline: _Outline, mate: Int, joints: _Stretches, hooks: _Stretches
) -> tuple[Polylines, Int]:
    """The lines one after the other, with the stretches between and at the ends; and which points may be cut off."""
    entry, path = _walks(mate)
    # Between lines: the joint at the end each line is left by. Before the first and after the last: hooks.
    joint_of, hook_of = np.full(len(mate), -1), np.full(len(mate), -1)
    joint_of[joints.end] = np.arange(len(joints.end))
    joint_of[mate < 0] = -1  # one that closed a loop is a hook now
    other = np.flatnonzero((joint_of < 0) & (mate >= 0))
    joint_back = np.full(len(mate), -1)
    joint_back[other] = joint_of[mate[other]]
    hook_of[hooks.end] = np.arange(len(hooks.end))

    vertices = _Vertices(lines, outline, hooks)
    first = run_starts(path)
    leave = entry ^ 1
    chunks = [
        vertices.stretch(hooks, np.where(first, hook_of[entry], -1), backward=True),
        vertices.line(entry),
        vertices.stretch(joints, joint_of[leave], backward=False),
        vertices.stretch(joints, joint_back[leave], backward=True),
        vertices.stretch(hooks, np.where(mate[leave] < 0, hook_of[leave], -1), backward=False),
    ]
    return vertices.gathered(chunks, path, entry)


def _walks(mate: Int) -> tuple[Int, Int]:
    """The end by which each line is entered, in the order of walking, and the walk each belongs to."""
    n = len(mate)
    following = _following(mate)
    last, rank = chain_steps(np.where(following < 0, np.arange(n), following))
    heads = np.flatnonzero(mate < 0)
    head_of = np.full(n, -1)
    head_of[last[heads]] = heads
    head, tail = head_of[last], last ^ 1
    kept = np.flatnonzero(head <= tail)  # each walk exists both ways
    order = kept[np.lexsort((-rank[kept], head[kept]))]
    return order, head[order]


class _Vertices:
    """All points there are, and ragged lists of which of them make up the result."""

    def __init__(self, lines: Polylines, outline: _Outline, hooks: _Stretches) -> None:
        self.lines, self.outline = lines, outline
        ring = self._ring_of(hooks)
        low, high = outline.ring_place[ring], outline.ring_place[ring + 1]
        tip = low + (hooks.to_place - low) % (high - low)
        tips = outline.xy(tip, outline.edge_at(tip, ring))
        self.xy = np.concatenate([lines.xy, outline.areas.xy, tips])
        self._tip = len(lines.xy) + len(outline.areas.xy)
        self._corner = self._corners(len(tips))
        self._hooks = hooks

    def _ring_of(self, stretches: _Stretches) -> Int:
        return self.outline.ring[self.lines.edge.ravel()[stretches.end]]

    def line(self, entry: Int) -> tuple[Int, Int]:
        """Vertices and their number for each line, as it is walked."""
        line, turned = entry // 2, entry % 2
        first, size = self.lines.start[line], self.lines.size[line]
        return self._run(first + turned * (size - 1), size, 1 - 2 * turned), size

    def stretch(self, of: _Stretches, which: Int, *, backward: bool) -> tuple[Int, Int]:
        """Vertices of some of the stretches (-1: of none), the tips of hooks included."""
        some = np.flatnonzero(which >= 0)
        item = which[some]
        areas, is_hook = self.outline.areas, of is self._hooks
        ring = self._ring_of(of)[item]
        start, n = areas.ring_start[ring], np.diff(areas.ring_start)[ring]
        low, high = self.outline.ring_place[ring], self.outline.ring_place[ring + 1]
        begin, end = of.place[item], of.to_place[item]
        ahead = end >= begin
        one, another = np.minimum(begin, end), np.maximum(begin, end)
        # Vertices strictly between, counted on around the ring.
        first = self._count_to(one, ring, start, low, high) + 1
        between = np.maximum(self._count_to(another, ring, start, low, high) - first + 1, 0)
        forward = ahead != backward
        step = np.where(forward, 1, -1)
        place = self._run(np.where(forward, first, first + between - 1), between, step)
        owner = np.repeat(np.arange(len(some)), between)
        index = len(self.lines.xy) + start[owner] + place % n[owner]
        count = np.zeros(len(which), np.int64)
        count[some] = between
        if not is_hook:
            return index, count
        # The tip comes first where a path begins with its hook, else last.
        at = np.cumsum(between) - between if backward else np.cumsum(between)
        count[some] += 1
        return np.insert(index, at, self._tip + item), count

    def _count_to(self, place: Float, ring: Int, start: Int, low: Float, high: Float) -> Int:
        """How many points of the ring after its first lie at or before a place, going on around it."""
        turns = np.floor((place - low) / (high - low)).astype(np.int64)
        here = place - turns * (high - low)
        return turns * np.diff(self.outline.areas.ring_start)[ring] + self.outline.edge_at(here, ring) - start

    def _run(self, first: Int, count: Int, step: Int) -> Int:
        """`first[i], first[i] + step[i], ...` for every i."""
        return np.asarray(
            np.repeat(first, count) + consecutive(np.zeros_like(count), count) * np.repeat(step, count)
        )

    def gathered(self, chunks: list[tuple[Int, Int]], path: Int, entry: Int) -> tuple[Polylines, Int]:
        """The chunks of every line one after the other, as many polylines as there are paths; and the corners.

        Those are points on the outline with the area on the inner side of the angle.
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
        return made, np.flatnonzero(self._corner[index[kept]])

    def _corners(self, n_tips: int) -> Bool:
        """(V,) whether a vertex is the end of a line on an outline, or a place of the outline that sticks out."""
        lines, areas = self.lines, self.outline.areas
        of_lines = np.zeros(len(lines.xy), np.bool_)
        of_lines[lines.start[:-1]] |= lines.edge[:, 0] >= 0
        of_lines[lines.start[1:] - 1] |= lines.edge[:, 1] >= 0
        after = areas.xy[areas.following] - areas.xy
        before = after[previous_in_ring(areas.ring_start)]
        convex = before[:, 0] * after[:, 1] > before[:, 1] * after[:, 0]
        return np.concatenate([of_lines, convex, np.zeros(n_tips, np.bool_)])
