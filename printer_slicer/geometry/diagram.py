"""Segment Voronoi diagrams of the outlines of many areas, as arrays.

They come from Boost.Polygon through pyvoronoi, on whole numbers of the grid that areas are rounded to, so that no point
of an outline moves. Every area has a diagram of its own: many small ones take less time than a large one.
"""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import chain
from operator import attrgetter
from typing import Any

import numpy as np

from printer_slicer.geometry.areas import Bool, Float, Int, run_begins
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
    starts = np.flatnonzero(run_begins(area))
    low, high = (which.reduceat(which(ends[:, 0], ends[:, 1]), starts) for which in (np.minimum, np.maximum))
    middle = np.rint((low + high) / 2)  # whole mm, so that nothing is rounded anew
    size = np.diff(np.append(starts, len(area)))
    steps = np.rint((ends - np.repeat(middle, size, axis=0)[:, None]) * STEPS_PER_MM).astype(np.int64) + _AWAY
    with _no_collection():
        parts = [
            _one(steps[first : first + count].tolist()) for first, count in zip(starts, size, strict=True)
        ]
    vertex, edge, cell, after, site = zip(*parts, strict=True)
    n_vertices, n_cells = _before(vertex), _before(site)
    n_edges = _before(cell)
    edges = np.concatenate([np.where(own < 0, -1, own + n) for own, n in zip(edge, n_vertices, strict=True)])
    primary = np.concatenate([own[:, 2] == 1 for own in edge])
    forth, back = edges[:, :2], edges[:, 1::-1]
    ways = np.stack([forth, back], axis=1).reshape(-1, 2)
    return Diagram(
        (np.concatenate(vertex) - _AWAY) / STEPS_PER_MM
        + np.repeat(middle, [len(own) for own in vertex], axis=0),
        ways[:, 0],
        ways[:, 1],
        np.concatenate([own + n for own, n in zip(cell, n_cells, strict=True)]),
        np.concatenate([own + n for own, n in zip(after, n_edges, strict=True)]),
        np.repeat(primary, 2),
        np.concatenate([own[:, 0] + n for own, n in zip(site, starts, strict=True)]),
        np.concatenate([own[:, 1] for own in site]),
    )


def _before(parts: tuple[Any, ...]) -> Int:
    """How many items all earlier parts have."""
    size = np.array([len(part) for part in parts])
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


def _one(sides: list[list[list[int]]]) -> tuple[Float, Int, Int, Int, Int]:
    """Vertices (v, 2) in steps, every second edge (e / 2, 3), cells (e,) and followers (e,) of all, sites (c, 2)."""
    import pyvoronoi  # noqa: PLC0415 - only for parts with narrow places

    builder = pyvoronoi.Pyvoronoi(1)
    for side in sides:
        builder.AddSegment(side)
    builder.Construct()
    n_edges = builder.CountEdges()
    edges = _columns(list(map(builder.GetEdge, range(0, n_edges, 2))), "start", "end", "is_primary")
    cells = builder.GetCells()
    around = [cell.edges for cell in cells]
    size = np.fromiter(map(len, around), np.int64, len(around))
    edge = np.fromiter(chain.from_iterable(around), np.int64, n_edges)
    first = np.cumsum(size) - size
    onward = np.arange(n_edges) + 1
    onward[(first + size - 1)[size > 0]] = first[size > 0]
    cell, after = np.zeros((2, n_edges), np.int64)
    cell[edge], after[edge] = np.repeat(np.arange(len(size)), size), edge[onward]
    vertices = builder.GetVertices()
    vertex = np.fromiter(
        chain.from_iterable(map(attrgetter("X", "Y"), vertices)), np.float64, 2 * len(vertices)
    )
    return vertex.reshape(-1, 2), edges, cell, after, _columns(cells, "site", "source_category")


def _columns(objects: list[Any], *names: str) -> Int:
    """(n, k) attributes of the library's objects."""
    flat = chain.from_iterable(map(attrgetter(*names), objects))
    return np.fromiter(flat, np.int64, len(objects) * len(names)).reshape(-1, len(names))
