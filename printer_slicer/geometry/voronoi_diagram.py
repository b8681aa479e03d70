"""Segment Voronoi diagrams of the outlines of many areas, as arrays.

Boost.Polygon computes them on the integer grid that areas are rounded to, so that no point of an outline moves. Each
area has its own diagram: many small diagrams take less time than a large one. The compiled kernel computes all of them
in one call; without it, pyvoronoi computes one after the other, with the same result.
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
from printer_slicer.kernel import Kernel, load_kernel
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
    kernel = load_kernel()
    raw = _read_library(steps, n_sides) if kernel is None else _read_kernel(kernel, steps, n_sides)
    n_edges, n_cells, n_vertices = raw.sizes.T
    around = raw.around + np.repeat(_sum_earlier(n_edges), n_edges)
    begins = np.where(raw.begins < 0, -1, raw.begins + np.repeat(_sum_earlier(n_vertices), n_edges))
    start, cell, after = np.zeros((3, len(around)), np.int64)
    start[around] = begins
    cell[around] = np.repeat(np.arange(len(raw.counts)), raw.counts)
    after[around] = around[next_in_ring(np.append(0, np.cumsum(raw.counts)))]
    side, place = raw.sites[:, 0] + np.repeat(starts, n_cells), raw.sites[:, 1]
    vertex = (raw.vertices - _CENTER_OFFSET) / STEPS_PER_MM
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


class _RawDiagrams(Struct, frozen=True, eq=False):
    """Diagrams of Boost, with separate numbering for each area.

    All data comes from the cells: each knows its edges and their start vertices. Twin edges have consecutive numbers.

    Attributes:
        around: (E,) the edges of each cell, one cell after the other.
        begins: (E,) start vertex of each of these edges, -1 at infinity.
        counts: (C,) number of edges of each cell.
        sites: (C, 2) side and place of each cell; see `Diagram`.
        vertices: (V, 2) grid steps.
        sizes: (A, 3) number of edges, cells and vertices of each area.
    """

    around: Int
    begins: Int
    counts: Int
    sites: Int
    vertices: Float
    sizes: Int


def _read_kernel(kernel: Kernel, steps: Int, n_sides: Int) -> _RawDiagrams:
    """Compute diagrams with the compiled kernel.

    Args:
        kernel: the compiled kernel.
        steps: (S, 2, 2) ends of the sides.
        n_sides: (A,) number of sides of each area.
    """
    around, begins, counts, sites, vertices, sizes = kernel.voronoi_diagrams(
        np.ascontiguousarray(steps).data, np.ascontiguousarray(n_sides).data
    )
    return _RawDiagrams(
        np.frombuffer(around, np.int64),
        np.frombuffer(begins, np.int64),
        np.frombuffer(counts, np.int64),
        np.frombuffer(sites, np.int64).reshape(-1, 2),
        np.frombuffer(vertices).reshape(-1, 2),
        np.frombuffer(sizes, np.int64).reshape(-1, 3),
    )


def _read_library(steps: Int, n_sides: Int) -> _RawDiagrams:
    """Compute diagrams with pyvoronoi; arguments as for `_read_kernel`."""
    collected = _CollectedDiagrams()
    with _without_garbage_collection():
        sizes = [
            collected.append(_build_diagram(sides.tolist()))
            for sides in np.split(steps, np.cumsum(n_sides[:-1]))
        ]
    counts = np.frombuffer(collected.counts, np.int64)
    return _RawDiagrams(
        np.frombuffer(collected.around, np.int64),
        np.delete(np.frombuffer(collected.begins, np.int64), np.cumsum(counts + 1) - 1),
        counts,
        np.frombuffer(collected.sites, np.int64).reshape(-1, 2),
        np.frombuffer(collected.vertices).reshape(-1, 2),
        np.array(sizes),
    )


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


class _CollectedDiagrams(Struct, frozen=True):
    """Collected diagrams of the library, as numbers one after the other; see `_RawDiagrams`.

    After the last edge of each cell, `begins` holds the start vertex of its first edge again.
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
