"""Toolpaths -> Toolpaths: what is printed when, from which end, and where loops begin.

Skirt, brim and the loops of a raft first; then island by island, the nearest first; within an island perimeters before
infill, role by role, always on to the nearest path. Inner perimeters that fill several layers come after all others.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import groupby

import numpy as np

from printer_slicer.geometry import rings_around
from printer_slicer.geometry.planes import spread
from printer_slicer.model import Areas, Float, Int, Role, Sections, Toolpaths
from printer_slicer.profile import Profile

__all__ = ["order"]

_ALIGNED_WITHIN = 4.0  # mm; a seam farther from the one below starts a new line of seams
_DEEPER = 1e-3  # mm
_SMALL_CHOICE = 20_000  # paths; beyond, trying every path at every step takes minutes
_INFILL = (
    Role.BRIDGE,
    Role.BOTTOM_SKIN,
    Role.SPARSE,
    Role.INTERNAL_BRIDGE,
    Role.SOLID,
    Role.TOP_SKIN,
    Role.IRONING,
)


def order(paths: Toolpaths, sections: Sections, profile: Profile) -> Toolpaths:
    """The same paths in printing order; open ones may be turned around, loops begin at their seam."""
    if paths.n_paths == 0:
        return paths
    island = _islands(paths, sections.solid)
    seams = _seams(paths, profile.quality.seam)
    perimeters = (Role.INNER_PERIMETER, Role.OUTER_PERIMETER)
    outside_in = profile.quality.outer_perimeter_first
    roles = (Role.RAFT, *(perimeters[::-1] if outside_in else perimeters), *_INFILL)
    route = _Route(paths, seams)
    rank = np.full(len(Role), len(roles))
    rank[list(roles)] = np.arange(len(roles))
    around = (paths.role == Role.SKIRT) | (paths.role == Role.BRIM) | (paths.role == Role.RAFT) & paths.closed
    # What reaches down through several layers is laid into the gap that they leave: between beads that hold it.
    deep = (paths.role == Role.INNER_PERIMETER) & (paths.height > paths.plan.height[paths.layer] + _DEEPER)
    turn = np.where(deep, rank[list(perimeters)].max() + 0.5, rank[paths.role])
    step = np.where(around, 0, 4 * turn + ~paths.closed).astype(np.int64)
    # Sorted by layer, island and role, every group that is printed together is one stretch.
    sequence = np.lexsort((np.arange(paths.n_paths), step, np.where(around, -1, island), paths.layer))
    key = np.stack([paths.layer, np.where(around, -1, island), step])[:, sequence]
    starts = np.flatnonzero(np.concatenate([[True], (np.diff(key, axis=1) != 0).any(axis=0)]))
    groups = [
        (layer, place, group)
        for layer, place, group in zip(
            key[0, starts].tolist(), key[1, starts].tolist(), np.split(sequence, starts[1:]), strict=True
        )
    ]
    for _, same_layer in groupby(groups, key=lambda entry: entry[0]):
        islands: dict[int, list[Int]] = {}
        for _, place, group in same_layer:
            islands.setdefault(place, []).append(group)
        route.follow([path for group in islands.pop(-1, []) for path in group.tolist()])
        for place in _nearest_islands(route, islands):
            for group in islands[place]:
                route.visit(group)
    return route.toolpaths()


def _nearest_islands(route: _Route, islands: dict[int, list[Int]]) -> Iterator[int]:
    """The islands of one layer, each time the one that begins nearest to where the nozzle then is."""
    if len(islands) < 2:
        yield from islands
        return
    places = list(islands)
    sizes = np.array([sum(map(len, groups)) for groups in islands.values()])
    begin = route.begin[np.concatenate([group for groups in islands.values() for group in groups])]
    owner, first = np.repeat(np.arange(len(places)), sizes), np.cumsum(sizes) - sizes
    for _ in places:
        gap = begin - route.position
        nearest = int(owner[np.argmin(gap[:, 0] * gap[:, 0] + gap[:, 1] * gap[:, 1])])
        begin[first[nearest] : first[nearest] + sizes[nearest]] = np.inf
        yield places[nearest]


class _Route:
    """The order found so far, and where the nozzle is."""

    def __init__(self, paths: Toolpaths, seams: Int) -> None:
        self.paths = paths
        self.position = np.zeros(2)
        self._seam = seams
        self._taken: list[int] = []
        self._turn: list[int] = []  # first point for loops; 0 or 1 (turned around) for open paths
        self.begin = paths.xy[paths.start[:-1] + np.where(paths.closed, np.maximum(seams, 0), 0)]
        self._end = paths.xy[paths.start[1:] - 1]

    def visit(self, group: Int) -> None:
        """Take all paths of a group (n,), always the nearest next."""
        if len(group) == 0:
            return
        if len(group) > _SMALL_CHOICE:
            self.follow(group.tolist())
        elif bool(self.paths.closed[group[0]]):
            self._visit_loops(group)
        else:
            self._visit_lines(group)

    def follow(self, group: list[int]) -> None:
        """Take the paths as they stand, open ones that are in no sweep from their nearer end."""
        for path in group:
            if self.paths.closed[path]:
                self._take_loop(path)
            else:
                self._take_line(path)

    def _visit_loops(self, group: Int) -> None:
        left = group.tolist()
        while left:
            gap = self.begin.take(left, axis=0) - self.position
            gap *= gap
            self._take_loop(left.pop(int((gap[:, 0] + gap[:, 1]).argmin())))

    def _visit_lines(self, group: Int) -> None:
        group, start = self._sweeps(group)
        first, last = group[start[:-1]], group[start[1:] - 1]
        x, y = np.ascontiguousarray(np.concatenate([self.begin[first], self._end[last]]).T)
        paths, starts, n = group.tolist(), start.tolist(), len(first)
        here_x, here_y = self.position.tolist()
        for _ in range(n):
            gap, gap_y = x - here_x, y - here_y
            gap *= gap
            gap_y *= gap_y
            gap += gap_y
            nearest = int(gap.argmin())
            chosen, turned = nearest % n, nearest >= n
            sweep = paths[starts[chosen] : starts[chosen + 1]]
            self._taken += sweep[::-1] if turned else sweep
            self._turn += [int(turned)] * len(sweep)
            end = chosen if turned else chosen + n
            here_x, here_y = x.item(end), y.item(end)
            x[chosen] = x[chosen + n] = np.inf
        self.position = np.array([here_x, here_y])

    def _sweeps(self, group: Int) -> tuple[Int, Int]:
        """The paths of a group (n,) with those of one sweep behind each other, and where each sweep begins and ends."""
        sweep = self.paths.sweep[group]
        if (sweep < 0).all():
            return group, np.arange(len(group) + 1)
        order = np.argsort(sweep, kind="stable")
        group, sweep = group[order], sweep[order]
        begins = np.append(True, (np.diff(sweep) != 0) | (sweep[1:] < 0))
        return group, np.append(np.flatnonzero(begins), len(group))

    def _take_loop(self, path: int) -> None:
        seam = int(self._seam[path])
        if seam < 0:  # free to begin anywhere: at the point nearest to the nozzle
            gap = self.paths.path(path) - self.position
            gap *= gap
            seam = int((gap[:, 0] + gap[:, 1]).argmin())
        self._taken.append(path)
        self._turn.append(seam)
        self.position = self.paths.xy[self.paths.start[path] + seam]

    def _take_line(self, path: int) -> None:
        begin, end = self.begin[path], self._end[path]
        free = self.paths.sweep[path] < 0
        turned = bool(free and ((end - self.position) ** 2).sum() < ((begin - self.position) ** 2).sum())
        self._taken.append(path)
        self._turn.append(int(turned))
        self.position = begin if turned else end

    def toolpaths(self) -> Toolpaths:
        """The paths as taken."""
        paths, taken, turn = self.paths, np.array(self._taken, np.int64), np.array(self._turn, np.int64)
        size = np.diff(paths.start)[taken]
        start = np.concatenate([[0], np.cumsum(size)])
        owner, step = spread(size)
        closed = paths.closed[taken]
        turned_around = (~closed & (turn == 1))[owner]
        rotated = np.where(closed[owner], (step + turn[owner]) % np.maximum(size[owner], 1), step)
        within = np.where(turned_around, size[owner] - 1 - step, rotated)
        point = paths.start[taken][owner] + within
        return Toolpaths(
            paths.plan,
            paths.xy.take(point, axis=0),
            paths.width.take(point),
            start,
            paths.layer[taken],
            paths.role[taken],
            paths.height[taken],
            closed,
            # What holds from a point to the next holds from the next to it in a path that is turned around.
            paths.carried.take(
                np.where(turned_around, np.maximum(point - 1, paths.start[taken][owner]), point)
            ),
            paths.sweep[taken],
        )


def _islands(paths: Toolpaths, solid: Areas) -> Int:
    """(M,) for each path the outer ring of its layer that it lies in; paths outside all of them share one island."""
    island = np.zeros(paths.n_paths, np.int64)
    outlines = solid.select(solid.ring_area() > 0)
    many = np.flatnonzero(np.diff(outlines.layer_start) > 1)
    member = np.isin(paths.layer, many)
    if member.any():
        found = rings_around(outlines, paths.xy[paths.start[:-1]][member], paths.layer[member])
        island[member] = np.where(found < 0, outlines.n_rings, found)
    return island


def _seams(paths: Toolpaths, rule: str) -> Int:
    """(M,) the point at which each loop begins; -1 where any point will do."""
    seam = np.full(paths.n_paths, -1, np.int64)
    if rule == "nearest":
        return seam
    outer = np.flatnonzero(paths.closed & (paths.role == Role.OUTER_PERIMETER))
    below, below_layer = np.zeros((0, 2)), -1
    current: list[Float] = []
    for path in outer.tolist():
        layer, ring = int(paths.layer[path]), paths.path(path)
        if layer != below_layer:
            below = np.array(current) if current and layer == below_layer + 1 else np.zeros((0, 2))
            current, below_layer = [], layer
        seam[path] = _rear(ring) if rule == "rear" else _aligned(ring, below)
        current.append(ring[seam[path]])
    return seam


def _rear(ring: Float) -> int:
    """The point farthest back; of several the rightmost."""
    return int(np.lexsort((ring[:, 0], np.round(ring[:, 1], 3)))[-1])


def _aligned(ring: Float, below: Float) -> int:
    """The point nearest to a seam of the layer below, or the rear one where none is near."""
    if len(below) == 0:
        return _rear(ring)
    gap = ((ring[:, None] - below[None]) ** 2).sum(axis=2).min(axis=1)
    nearest = int(np.argmin(gap))
    return nearest if gap[nearest] <= _ALIGNED_WITHIN**2 else _rear(ring)
