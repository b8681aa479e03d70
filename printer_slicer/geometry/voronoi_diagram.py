"""Segment Voronoi diagrams of the outlines of many areas, as arrays.

They come from Boost.Polygon through pyvoronoi, on whole numbers of the grid that areas are rounded to, so that no point
of an outline moves. Every area has a diagram of its own: many small ones take less time than a large one.
"""

from __future__ import annotations

import gc
from array import array
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import chain
from operator import attrgetter
from typing import Any

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, next_in_ring, run_starts
from printer_slicer.geometry.polygons import STEPS_PER_MM

__all__ = ["Diagram", "diagram_of"]

# Steps from the origin to the middle of a diagram. The library asks for places to some parts in 10^14 of what they are,
# and reckons with more digits than a double has where that is not sure: near the origin it hardly ever is.
_AWAY = 10_000_000


@dataclass(frozen=True, slots=True, eq=False)
class Diagram:
    """Edges between the cells of sides and of their ends; the twin of edge `e`, which runs the other way, is `e ^ 1`.

    Attributes:
        vertex: (V, 2) mm.
        start: (E,) vertex at which each edge begins; -1 far away.
        end: (E,) vertex at which it ends.
        cell: (E,) the cell on its left.
        after: (E,) the edge that goes on around that cell.
        primary: (E,) false between a side and its own end.
        side: (C,) to which the cell belongs,
        place: (C,) to where it begins (1), where it ends (2) or to the side itself (3 and 4).
    """

    vertex: Float
    start: Int
    end: Int
    cell: Int
    after: Int
    primary: Bool
    side: Int
    place: Int


def diagram_of(ends: Float, area: Int) -> Diagram:
    """The diagrams of all areas, side by side in one set of arrays.

    Args:
        ends: (S, 2, 2) mm, where sides begin and end; sides of an area meet at their ends only.
        area: (S,) to which each belongs, ascending; at least one.
    """
    starts = np.flatnonzero(run_starts(area))
    low, high = (which.reduceat(which(ends[:, 0], ends[:, 1]), starts) for which in (np.minimum, np.maximum))
    middle = np.rint((low + high) / 2)  # whole mm, so that nothing is rounded anew
    n_sides = np.diff(np.append(starts, len(area)))
    steps = (
        np.rint((ends - np.repeat(middle, n_sides, axis=0)[:, None]) * STEPS_PER_MM).astype(np.int64) + _AWAY
    )
    found = _Found()
    with _no_collection():
        sizes = [
            found.take_in(_built(steps[first : first + count].tolist()))
            for first, count in zip(starts.tolist(), n_sides.tolist(), strict=True)
        ]
    n_edges, n_cells, n_vertices = np.array(sizes).T
    around = np.frombuffer(found.around, np.int64) + np.repeat(_before(n_edges), n_edges)
    count = np.frombuffer(found.counts, np.int64)
    begins = np.delete(np.frombuffer(found.begins, np.int64), np.cumsum(count + 1) - 1)
    begins = np.where(begins < 0, -1, begins + np.repeat(_before(n_vertices), n_edges))
    start, cell, after = np.zeros((3, len(around)), np.int64)
    start[around] = begins
    cell[around] = np.repeat(np.arange(len(count)), count)
    after[around] = around[next_in_ring(np.append(0, np.cumsum(count)))]
    sites = np.frombuffer(found.sites, np.int64).reshape(-1, 2)
    side, place = sites[:, 0] + np.repeat(starts, n_cells), sites[:, 1]
    vertex = (np.frombuffer(found.vertices).reshape(-1, 2) - _AWAY) / STEPS_PER_MM
    return Diagram(
        vertex + np.repeat(middle, n_vertices, axis=0),
        start,
        start.reshape(-1, 2)[:, ::-1].ravel(),
        cell,
        after,
        _primary(cell, steps, side, place),
        side,
        place,
    )


def _primary(cell: Int, steps: Int, side: Int, place: Int) -> Bool:
    """(E,) false between a side and its own end, or one that lies there too; `steps` (S, 2, 2) are the sides' ends."""
    where = steps[..., 0] << 32 | steps[..., 1]  # one number for each place
    one, other = cell[::2], cell[1::2]
    corner = place <= 2
    mixed = np.flatnonzero(corner[one] != corner[other])
    one, other = one[mixed], other[mixed]
    of_one = corner[one]
    point, along = np.where(of_one, one, other), side[np.where(of_one, other, one)]
    at = where[side[point], (place[point] == 2).astype(np.int64)]
    result = np.ones(len(cell) // 2, np.bool_)
    result[mixed] = (where[along, 0] != at) & (where[along, 1] != at)
    return np.repeat(result, 2)


def _before(size: Int) -> Int:
    """How many items all earlier parts have."""
    return np.asarray(np.cumsum(size) - size)


@contextmanager
def _no_collection() -> Iterator[None]:
    """No search for garbage meanwhile: many thousands of new objects would set it off again and again."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


def _built(sides: list[list[list[int]]]) -> Any:
    """The library's diagram of the sides of one area."""
    import pyvoronoi  # noqa: PLC0415 - only for parts with narrow places

    builder = pyvoronoi.Pyvoronoi(1)
    for side in sides:
        builder.AddSegment(side)
    builder.Construct()
    return builder


@dataclass(frozen=True, slots=True)
class _Found:
    """What the library says of one area after the other, in numbers of its own for each.

    All of it comes from the cells: they know their edges and where each of them begins, and twins stand side by side.

    Attributes:
        around: the edges of one cell after the other.
        begins: where each of them begins, -1 far away; once more for the first one behind the last one of each cell.
        counts: how many each cell has.
        sites: the side of each cell, and the place there.
        vertices: x and y of each.
    """

    around: array[int] = field(default_factory=lambda: array("q"))
    begins: array[int] = field(default_factory=lambda: array("q"))
    counts: array[int] = field(default_factory=lambda: array("q"))
    sites: array[int] = field(default_factory=lambda: array("q"))
    vertices: array[float] = field(default_factory=lambda: array("d"))

    def take_in(self, built: Any) -> tuple[int, int, int]:
        """Append the diagram of the next area, of so many edges, cells and vertices."""
        n_edges, cells, vertices = built.CountEdges(), built.GetCells(), built.GetVertices()
        around, begins = [cell.edges for cell in cells], [cell.vertices for cell in cells]
        if sum(map(len, begins)) != n_edges + len(cells):  # far away, it does not repeat itself
            begins = [[*(built.GetEdge(edge).start for edge in edges), -1] for edges in around]
        self.around.extend(chain.from_iterable(around))
        self.begins.extend(chain.from_iterable(begins))
        self.counts.extend(map(len, around))
        self.sites.extend(chain.from_iterable(map(attrgetter("site", "source_category"), cells)))
        self.vertices.extend(chain.from_iterable(map(attrgetter("X", "Y"), vertices)))
        return n_edges, len(cells), len(vertices)
