"""Segment Voronoi diagrams of the outlines of many areas, as arrays.

Boost.Polygon computes them through pyvoronoi, on the integer grid that areas are rounded to, so that no point of an
outline moves. Each area has its own diagram: many small diagrams take less time than a large one.
"""

from __future__ import annotations

import gc
from array import array
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import chain
from operator import attrgetter
from typing import Any

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, next_in_ring, run_starts
from printer_slicer.geometry.polygons import STEPS_PER_MM
from printer_slicer.values import Struct, field

__all__ = ["Diagram", "compute_diagrams"]

# Grid steps from the origin to the middle of a diagram. The library needs vertices with a relative error of some
# 10^-14, and computes with more digits than a double has if it is not sure of that. Near the origin it rarely is sure.
_CENTER_OFFSET = 10_000_000


class Diagram(Struct, frozen=True, eq=False):
    """Voronoi edges between the cells of sides and of their ends; edge `e` has the reversed twin `e ^ 1`.

    Attributes:
        vertex: (V, 2) mm.
        start: (E,) vertex at which each edge starts; -1 at infinity.
        end: (E,) vertex at which it ends; -1 at infinity.
        cell: (E,) the cell on its left.
        after: (E,) the next edge around that cell.
        primary: (E,) false between a side and its own end.
        side: (C,) the side to which the cell belongs.
        place: (C,) whether it is the cell of the side's start (1), of its end (2) or of the side itself (3 and 4).
    """

    vertex: Float
    start: Int
    end: Int
    cell: Int
    after: Int
    primary: Bool
    side: Int
    place: Int


def compute_diagrams(ends: Float, area: Int) -> Diagram:
    """Compute the Voronoi diagrams of all areas, in one set of arrays.

    Args:
        ends: (S, 2, 2) mm, start and end of each side; sides of an area meet only at their ends.
        area: (S,) area of each side, ascending; at least one side.
    """
    starts = np.flatnonzero(run_starts(area))
    low, high = (which.reduceat(which(ends[:, 0], ends[:, 1]), starts) for which in (np.minimum, np.maximum))
    middle = np.rint((low + high) / 2)  # whole mm, so that no point is rounded again
    n_sides = np.diff(np.append(starts, len(area)))
    steps = (
        np.rint((ends - np.repeat(middle, n_sides, axis=0)[:, None]) * STEPS_PER_MM).astype(np.int64)
        + _CENTER_OFFSET
    )
    raw = _RawDiagrams()
    with _without_garbage_collection():
        sizes = [
            raw.append(_build_diagram(steps[first : first + count].tolist()))
            for first, count in zip(starts.tolist(), n_sides.tolist(), strict=True)
        ]
    n_edges, n_cells, n_vertices = np.array(sizes).T
    around = np.frombuffer(raw.around, np.int64) + np.repeat(_sum_earlier(n_edges), n_edges)
    count = np.frombuffer(raw.counts, np.int64)
    begins = np.delete(np.frombuffer(raw.begins, np.int64), np.cumsum(count + 1) - 1)
    begins = np.where(begins < 0, -1, begins + np.repeat(_sum_earlier(n_vertices), n_edges))
    start, cell, after = np.zeros((3, len(around)), np.int64)
    start[around] = begins
    cell[around] = np.repeat(np.arange(len(count)), count)
    after[around] = around[next_in_ring(np.append(0, np.cumsum(count)))]
    sites = np.frombuffer(raw.sites, np.int64).reshape(-1, 2)
    side, place = sites[:, 0] + np.repeat(starts, n_cells), sites[:, 1]
    vertex = (np.frombuffer(raw.vertices).reshape(-1, 2) - _CENTER_OFFSET) / STEPS_PER_MM
    return Diagram(
        vertex + np.repeat(middle, n_vertices, axis=0),
        start,
        start.reshape(-1, 2)[:, ::-1].ravel(),
        cell,
        after,
        _is_primary(cell, steps, side, place),
        side,
        place,
    )


def _is_primary(cell: Int, steps: Int, side: Int, place: Int) -> Bool:
    """Return a mask (E,) of edges, except those between the cells of a side and of a point at one of its ends.

    `steps` (S, 2, 2) are the ends of the sides.
    """
    where = steps[..., 0] << 32 | steps[..., 1]  # one number for each position
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


def _sum_earlier(size: Int) -> Int:
    """Return for each part the total size of all earlier parts."""
    return np.asarray(np.cumsum(size) - size)


@contextmanager
def _without_garbage_collection() -> Iterator[None]:
    """Disable the garbage collector, which many thousands of new objects would start again and again."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


def _build_diagram(sides: list[list[list[int]]]) -> Any:
    """Build the library's diagram of the sides of one area."""
    import pyvoronoi  # noqa: PLC0415 - needed only for narrow areas

    builder = pyvoronoi.Pyvoronoi(1)
    for side in sides:
        builder.AddSegment(side)
    builder.Construct()
    return builder


class _RawDiagrams(Struct, frozen=True):
    """Collected diagrams of the library, with separate numbering for each area.

    All data comes from the cells: each knows its edges and their start vertices. Twin edges have consecutive numbers.

    Attributes:
        around: the edges of each cell, one cell after the other.
        begins: start vertex of each of these edges, -1 at infinity; after the last edge of each cell, that of its first
            edge again.
        counts: number of edges of each cell.
        sites: side and place of each cell; see `Diagram`.
        vertices: x and y of each vertex.
    """

    around: array[int] = field(default_factory=lambda: array("q"))
    begins: array[int] = field(default_factory=lambda: array("q"))
    counts: array[int] = field(default_factory=lambda: array("q"))
    sites: array[int] = field(default_factory=lambda: array("q"))
    vertices: array[float] = field(default_factory=lambda: array("d"))

    def append(self, built: Any) -> tuple[int, int, int]:
        """Append the diagram of the next area; return its number of edges, cells and vertices."""
        n_edges, cells, vertices = built.CountEdges(), built.GetCells(), built.GetVertices()
        around, begins = [cell.edges for cell in cells], [cell.vertices for cell in cells]
        if sum(map(len, begins)) != n_edges + len(cells):  # cells at infinity do not repeat the first vertex
            begins = [[*(built.GetEdge(edge).start for edge in edges), -1] for edges in around]
        self.around.extend(chain.from_iterable(around))
        self.begins.extend(chain.from_iterable(begins))
        self.counts.extend(map(len, around))
        self.sites.extend(chain.from_iterable(map(attrgetter("site", "source_category"), cells)))
        self.vertices.extend(chain.from_iterable(map(attrgetter("X", "Y"), vertices)))
        return n_edges, len(cells), len(vertices)
