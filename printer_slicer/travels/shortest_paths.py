"""Shortest paths through many small graphs at once."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from printer_slicer.arrays import Float, Int, run_starts
from printer_slicer.values import Struct

__all__ = ["GraphEdges", "find_shortest_paths"]

_GAIN = 1e-9  # mm; smaller improvements are rounding and must not cause an endless loop


class GraphEdges(Struct, frozen=True, eq=False):
    """Directed edges between nodes.

    Attributes:
        tail: (E,) the node at which each edge starts.
        head: (E,) the node at which it ends.
        length: (E,) mm, greater than 0; inf for an edge that cannot be used.
    """

    tail: Int
    head: Int
    length: Float

    @classmethod
    def joined(cls, parts: Sequence[GraphEdges]) -> GraphEdges:
        """Concatenate several sets of edges, without edges of infinite length."""
        tail, head, length = (
            np.concatenate([getattr(part, name) for part in parts]) for name in ("tail", "head", "length")
        )
        some = np.flatnonzero(np.isfinite(length))
        return cls(tail[some], head[some], length[some])


def find_shortest_paths(links: GraphEdges, begin: Int, end: Int, n_nodes: int) -> tuple[Float, Int, Int]:
    """Find the shortest path in each of many graphs that have no nodes in common.

    Args:
        links: edges of all graphs.
        begin: (W,) start node of each path.
        end: (W,) end node of each path.
        n_nodes: number of nodes of all graphs.

    Returns:
        The lengths (W,), mm, inf where there is no path; the nodes between the ends, one path after the other; and the
        number of these nodes (W,).

    Source: Bellman, On a routing problem, 1958.
    """
    order = np.argsort(links.head, kind="stable")
    tail, head, length = links.tail[order], links.head[order], links.length[order]
    first = np.flatnonzero(run_starts(head))
    reached = head[first]
    size = np.diff(np.append(first, len(head)))
    distance = np.full(n_nodes, np.inf)
    distance[begin] = 0.0
    # No shortest path visits a node twice, so this ends. A path of n edges is found in n rounds.
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
    return distance[end], *_trace_back(came, begin, np.where(found, end, begin))


def _trace_back(came: Int, begin: Int, end: Int) -> tuple[Int, Int]:
    """Follow the predecessors `came` of nodes back from `end` to `begin` (W,).

    Returns:
        The nodes strictly between them in path order, one path after the other, and their number (W,).
    """
    paths, nodes, back = [], [], []
    path, node, step = np.flatnonzero(begin != end), came[end[begin != end]], 0
    while len(path):
        going = node != begin[path]
        path, node, step = path[going], node[going], step + 1
        paths.append(path)
        nodes.append(node)
        back.append(np.full(len(path), -step))
        node = came[node]
    none = np.zeros(0, np.int64)
    path, node, rank = (np.concatenate([none, *column]) for column in (paths, nodes, back))
    order = np.lexsort((rank, path))
    return node[order], np.bincount(path, minlength=len(begin)).astype(np.int64)
