"""Shortest paths through many small graphs at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from printer_slicer.arrays import Float, Int, run_starts

__all__ = ["GraphEdges", "find_shortest_paths"]

_GAIN = 1e-9  # mm by which a way must be shorter to be another one: rounding must not turn in circles


@dataclass(frozen=True, slots=True, eq=False)
class GraphEdges:
    """Straight legs between nodes, each for one direction.

    Attributes:
        tail: (E,) the node at which each begins.
        head: (E,) the node at which each ends.
        length: (E,) mm, over 0; inf for those that lead nowhere.
    """

    tail: Int
    head: Int
    length: Float

    @classmethod
    def joined(cls, parts: Sequence[GraphEdges]) -> GraphEdges:
        """Those of several parts that go anywhere, one after the other."""
        tail, head, length = (
            np.concatenate([getattr(part, name) for part in parts]) for name in ("tail", "head", "length")
        )
        some = np.flatnonzero(np.isfinite(length))
        return cls(tail[some], head[some], length[some])


def find_shortest_paths(links: GraphEdges, begin: Int, end: Int, n_nodes: int) -> tuple[Float, Int, Int]:
    """The shortest ways from `begin` to `end` (W,) nodes of graphs that have no node in common.

    Args:
        links: of all graphs.
        begin: of each way.
        end: of each way.
        n_nodes: of all graphs.

    Returns:
        (W,) the lengths, mm, inf where there is no way; the nodes between the ends of all ways one after the other, and
        how many (W,) there are in each.

    Source: Bellman, On a routing problem, 1958.
    """
    order = np.argsort(links.head, kind="stable")
    tail, head, length = links.tail[order], links.head[order], links.length[order]
    first = np.flatnonzero(run_starts(head))
    reached = head[first]
    size = np.diff(np.append(first, len(head)))
    distance = np.full(n_nodes, np.inf)
    distance[begin] = 0.0
    # No shortest way visits a node twice, so this ends; a way of n legs is found in n rounds.
    while len(first):
        best = np.minimum.reduceat(distance[tail] + length, first)
        nearer = best < distance[reached] - _GAIN
        if not nearer.any():
            break
        distance[reached[nearer]] = best[nearer]
    came = np.full(n_nodes, -1)
    if len(first):
        via = distance[tail] + length
        on_best = np.flatnonzero(via <= np.repeat(np.minimum.reduceat(via, first), size))
        came[head[on_best]] = tail[on_best]
    found = np.isfinite(distance[end])
    return distance[end], *_traced(came, begin, np.where(found, end, begin))


def _traced(came: Int, begin: Int, end: Int) -> tuple[Int, Int]:
    """The nodes strictly between `begin` and `end` (W,), from one to the one before it in `came`; and how many."""
    ways, nodes, back = [], [], []
    way, node, step = np.flatnonzero(begin != end), came[end[begin != end]], 0
    while len(way):
        going = node != begin[way]
        way, node, step = way[going], node[going], step + 1
        ways.append(way)
        nodes.append(node)
        back.append(np.full(len(way), -step))
        node = came[node]
    none = np.zeros(0, np.int64)
    way, node, rank = (np.concatenate([none, *column]) for column in (ways, nodes, back))
    order = np.lexsort((rank, way))
    return node[order], np.bincount(way, minlength=len(begin)).astype(np.int64)
