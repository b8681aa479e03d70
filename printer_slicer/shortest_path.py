"""Shortest paths through candidate layers, from the bed to the top of the part.

Nodes 0 to n are heights; an arc is a layer from one node to another and has a cost. Every arc has a minimum length, so
that many neighbouring nodes do not depend on each other and are computed at once.

Sources: shortest path in an acyclic graph (Bellman's recursion). For a budget: the Lagrangian dual of the constrained
shortest path. Its best price is found by intersecting the two nearest plans, and its gap limits the arcs that a better
plan can use (Handler and Zang, "A dual algorithm for the constrained shortest path problem", 1980).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Final

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, frozen_array
from printer_slicer.kernel import load_kernel
from printer_slicer.values import Struct, force_setattr

__all__ = [
    "ArcGraph",
    "NeighbourLimits",
    "Search",
    "cheapest_path",
    "cheapest_with_max_layers",
    "cheapest_with_neighbours",
    "cheapest_within_budget",
    "optimal_arcs",
]

Search = Callable[[Float], Int | None]
"""Function: cost of every arc -> the arcs of the cheapest plan, from the bed up; None if none reaches the top."""

_MAX_PRICES: Final = 60  # maximum number of prices to try; a dozen is usual
_EQUAL: Final = 1e-9  # relative difference of totals below which plans are equal at a priority
_ROUNDING: Final = 1e-12  # relative rounding error of sums in another order


class ArcGraph(Struct, frozen=True, eq=False):
    """Arcs, sorted by the node at which they end.

    Attributes:
        begin: (n + 2,) arcs begin[k] to begin[k + 1] end at node k.
        start: (A,) the node at which each arc starts.
    """

    begin: Int
    start: Int

    def __post_init__(self) -> None:
        force_setattr(self, "begin", frozen_array(self.begin, np.int64, (-1,)))
        force_setattr(self, "start", frozen_array(self.start, np.int64, (int(self.begin[-1]),)))

    @property
    def n(self) -> int:
        """Return the top node."""
        return len(self.begin) - 2

    @property
    def end(self) -> Int:
        """Return the node at which each arc ends (A,)."""
        return np.repeat(np.arange(self.n + 1), np.diff(self.begin))

    def with_arcs(self, kept: Int) -> ArcGraph:
        """Return the graph that has only the arcs `kept` (K,), ascending."""
        return ArcGraph(np.searchsorted(kept, self.begin), self.start[kept])

    @property
    def height(self) -> Int:
        """Return the length of each arc (A,)."""
        return self.end - self.start


def cheapest_path(graph: ArcGraph, cost: Float) -> Int | None:
    """Find the arcs of the cheapest plan, from the bed up; None if no plan reaches the top.

    Args:
        graph: the candidate layers.
        cost: (A,) cost of each; those of infinite cost are not used.
    """
    best = _costs_from_bed(graph, cost)
    if not np.isfinite(best[-1]):
        return None
    chain, k = [], graph.n
    while k > 0:
        chain.append(_find_last_arc(graph, k, best, cost))
        k = int(graph.start[chain[-1]])
    return np.array(chain[::-1], np.int64)


def _find_last_arc(graph: ArcGraph, node: int, best: Float, cost: Float) -> int:
    """Return the last arc of the cheapest path to a node, given the costs `best` (n + 1,) of the nodes below."""
    a, b = graph.begin[node : node + 2].tolist()
    return int(a + (best[graph.start[a:b]] + cost[a:b]).argmin())


def _costs_through(graph: ArcGraph, cost: Float) -> tuple[Float, float]:
    """Return the cost of the cheapest plan through each arc (A,), and the cost of the cheapest plan."""
    up, down = _costs_from_bed(graph, cost), _costs_from_bed(*_reverse_graph(graph, cost))[::-1]
    return up[graph.start] + cost + down[graph.end], float(up[-1])


def _costs_from_bed(graph: ArcGraph, cost: Float) -> Float:
    """Return the cost of the cheapest path from the bed to each node (n + 1,); infinite if there is none."""
    best = np.full(graph.n + 1, np.inf)
    best[0] = 0.0
    if len(graph.start) == 0:
        return best
    reached = np.flatnonzero(np.diff(graph.begin))
    first, block = graph.begin[reached], int(graph.height.min())
    borders = np.searchsorted(reached, np.arange(1, graph.n + 1 + block, block))
    for i, j in pairwise(borders.tolist()):
        if i < j:
            a, b = int(first[i]), int(graph.begin[reached[j - 1] + 1])
            total = best[graph.start[a:b]] + cost[a:b]
            best[reached[i:j]] = np.minimum.reduceat(total, first[i:j] - a)
    return best


def optimal_arcs(graph: ArcGraph, costs: Sequence[Float]) -> Int:
    """Find the arcs of the plans that are cheapest by the first cost; among equal plans, the second cost decides, etc.

    Args:
        graph: the candidate layers.
        costs: (A,) each, the cost of an arc at each priority, at least 0.

    Returns:
        (K,) arcs, ascending; none if no plan reaches the top. Every path through them to the top is optimal.
    """
    kept = np.arange(len(graph.start))
    free = np.flatnonzero(~np.any([priority_cost > 0 for priority_cost in costs], axis=0)) if costs else kept
    if np.isfinite(_costs_from_bed(graph.with_arcs(free), np.zeros(len(free)))[-1]):
        return free
    for priority_cost in costs:
        through, least = _costs_through(graph.with_arcs(kept), priority_cost[kept])
        if not np.isfinite(least):
            return np.zeros(0, np.int64)
        kept = kept[through <= least * (1 + _EQUAL)]
    return kept if costs else np.zeros(0, np.int64)


class NeighbourLimits(Struct, frozen=True, eq=False):
    """Limits for the heights of neighbouring layers.

    Attributes:
        least, most: (H + 1,) for each height in units, the smallest and the largest allowed neighbour, in units.
        spared: (n + 1,) nodes next to which a forbidden pair has a reduced penalty: the two layers meet at the node, or
            one of them starts or ends there.
    """

    least: Int
    most: Int
    spared: Bool

    def __post_init__(self) -> None:
        for name, kind in (("least", np.int64), ("most", np.int64), ("spared", np.bool_)):
            force_setattr(self, name, frozen_array(getattr(self, name), kind, (-1,)))

    def allows_all_between(self, lowest: int, highest: int) -> bool:
        """Return whether any two heights from `lowest` to `highest` may be neighbours."""
        return bool(self.least[highest] <= lowest and self.most[lowest] >= highest)

    @classmethod
    def by_step(cls, change: int, highest: int, n: int) -> NeighbourLimits:
        """Allow steps of up to `change` units everywhere, for heights of up to `highest` units."""
        height = np.arange(highest + 1)
        return cls(height - change, height + change, np.zeros(n + 1, np.bool_))


def cheapest_with_neighbours(
    graph: ArcGraph, cost: Float, limits: NeighbourLimits, penalty: float, reduced: float = 0.0
) -> Int | None:
    """Find the cheapest path; each pair of neighbouring layers that is not allowed costs a penalty.

    Args:
        graph: the candidate layers.
        cost: (A,) cost of each.
        limits: allowed neighbours.
        penalty: cost per pair of layers that is not allowed.
        reduced: cost per such pair at a spared node.
    """
    n, height = graph.n, graph.height
    if len(height) == 0:
        return None
    reach, anyhow = _compute_neighbour_costs(graph, cost, limits, penalty, reduced)
    if not np.isfinite(anyhow[n]):
        return None
    return _trace_path(graph, cost, limits, (penalty, reduced), (reach, anyhow))


def _compute_neighbour_costs(
    graph: ArcGraph, cost: Float, limits: NeighbourLimits, penalty: float, reduced: float
) -> tuple[Float, Float]:
    """Return the costs of the cheapest paths to each node; arguments as for `cheapest_with_neighbours`.

    The first result (n + 1, R) is for paths on which a layer of `low` + r units may follow, where `low` is the smallest
    height, the second one (n + 1,) for any path. The bed allows any layer.
    """
    n, height = graph.n, graph.height
    low, rows = int(height.min()), int(np.ptp(height)) + 1
    first, last = limits.least[low : low + rows] - low, limits.most[low : low + rows] - low
    kernel = load_kernel()
    if kernel is not None:
        columns = graph.begin.data, graph.start.data, np.ascontiguousarray(cost, np.float64).data
        rows_after = first.data, last.data, limits.spared.astype(np.int64).data
        found = kernel.neighbour_paths(columns, rows_after, low, penalty, reduced)
        return np.frombuffer(found[0]).reshape(n + 1, rows), np.frombuffer(found[1])
    windows = _WindowMinimum(first, last)
    reach, anyhow = np.full((n + 1, rows), np.inf), np.full(n + 1, np.inf)
    reach[0] = anyhow[0] = 0.0
    row, end, start = height - low, graph.end, graph.start
    to_spared, from_spared = limits.spared[end], limits.spared[start]
    for k in range(1, n + 1, low):
        nodes = slice(k, min(k + low, n + 1))
        arcs = slice(int(graph.begin[nodes.start]), int(graph.begin[nodes.stop]))
        before = reach[start[arcs], row[arcs]]
        up = np.flatnonzero(to_spared[arcs])
        if len(up):
            before[up] = np.minimum(before[up], anyhow[start[arcs][up]] + reduced)
        total = np.full((nodes.stop - k, rows), np.inf)
        total[end[arcs] - k, row[arcs]] = value = before + cost[arcs]
        anyhow[nodes] = total.min(axis=1)
        best = anyhow[nodes] + np.where(limits.spared[nodes], reduced, penalty)
        down = np.flatnonzero(from_spared[arcs])
        if len(down):
            np.minimum.at(best, end[arcs][down] - k, value[down] + reduced)
        reach[nodes] = np.minimum(windows.over_windows(total), best[:, None])
    return reach, anyhow


def _trace_path(
    graph: ArcGraph,
    cost: Float,
    limits: NeighbourLimits,
    penalties: tuple[float, float],
    tables: tuple[Float, Float],
) -> Int:
    """Return the arcs of the path found by `cheapest_with_neighbours`, from the bed up."""
    (penalty, reduced), (reach, anyhow) = penalties, tables
    low, chain, k, above = int(graph.height.min()), list[int](), graph.n, 0
    while k > 0:
        a, b = graph.begin[k : k + 2].tolist()
        start = graph.start[a:b]
        height = k - start
        value = reach[start, height - low]
        if limits.spared[k]:
            value = np.minimum(value, anyhow[start] + reduced)
        value = value + cost[a:b]
        if above:
            meets = (height >= limits.least[above]) & (height <= limits.most[above])
            spared = limits.spared[start] | limits.spared[k] | limits.spared[k + above]
            value = value + np.where(meets, 0.0, np.where(spared, reduced, penalty))
        found = int(value.argmin())
        chain.append(a + found)
        above = int(height[found])
        k -= above
    return np.array(chain[::-1], np.int64)


class _WindowMinimum:
    """Computes the minimum over a window of columns for each column, with a sparse table.

    Args:
        first, last: (R,) columns of each window; columns that do not exist are ignored.
    """

    def __init__(self, first: Int, last: Int) -> None:
        columns = len(first)
        first, last = np.maximum(first, 0), np.minimum(last, columns - 1)
        level = np.frexp(last - first + 1)[1] - 1
        self._steps = [1 << k for k in range(int(level.max(initial=0)))]
        self._left = level * columns + first
        self._right = level * columns + last + 1 - (1 << level.astype(np.int64))
        self._runs: Float = np.zeros((0, 0))  # reused; entries beyond the columns stay infinite

    def over_windows(self, values: Float) -> Float:
        """Return the minimum of values (m, R) over each window, (m, R)."""
        rows, columns = values.shape
        if rows > len(self._runs):
            self._runs = np.full((rows, columns * (len(self._steps) + 1)), np.inf)
        runs = self._runs[:rows]
        runs[:, :columns] = values
        for level, step in enumerate(self._steps):
            one = runs[:, level * columns : (level + 1) * columns]
            into = runs[:, (level + 1) * columns : (level + 2) * columns]
            np.minimum(one[:, :-step], one[:, step:], out=into[:, : columns - step])
        return np.asarray(np.minimum(runs.take(self._left, axis=1), runs.take(self._right, axis=1)))


def cheapest_within_budget(
    search: Search, loss: Float, spent: Float, budget: float, within_budget: Int
) -> tuple[Int, float]:
    """Find the plan of least loss within a budget, by a price on the limited quantity; return plan and price.

    Some plans are optimal for no price. If the best one is among them, the next plan below the budget is returned.

    Args:
        search: finds the cheapest plan.
        loss: (A,) the quantity to minimize.
        spent: (A,) the limited quantity.
        budget: limit of its sum.
        within_budget: the arcs of any plan within the budget.
    """
    found, price = search(loss), 0.0
    for _ in range(_MAX_PRICES):
        if found is None or spent[found].sum() <= budget:
            return (within_budget if found is None else found), price
        # Both plans cost the same at this price; one that costs less lies between them.
        saved = float(spent[found].sum() - spent[within_budget].sum())
        price = float(loss[within_budget].sum() - loss[found].sum()) / saved
        charged = loss + price * spent
        between, least = search(charged), float(charged[within_budget].sum())
        if between is None or charged[between].sum() >= least - _ROUNDING * abs(least):
            break
        if spent[between].sum() <= budget:
            within_budget = between
        else:
            found = between
    return within_budget, price


def cheapest_with_max_layers(graph: ArcGraph, cost: Float, max_layers: int) -> Int | None:
    """Find the cheapest plan of at most `max_layers` layers; None if that many layers cannot reach the top.

    Args:
        graph: the candidate layers.
        cost: (A,) cost of each.
        max_layers: maximum number of layers.
    """
    count = np.where(np.isfinite(cost), 1.0, np.inf)
    fewest = cheapest_path(graph, count)
    if fewest is None or len(fewest) > max_layers:
        return None
    few, price = cheapest_within_budget(
        lambda charged: cheapest_path(graph, charged), cost, np.ones_like(cost), max_layers, fewest
    )
    # With this price per layer: an upper bound of the best plan's cost, and a lower bound of any plan's cost.
    through, least = _costs_through(graph, cost + price)
    spare = float(cost[few].sum()) + price * max_layers - least
    rounding = _ROUNDING * (abs(least) + abs(spare))
    if spare <= rounding:
        return few
    kept = np.flatnonzero(through <= least + spare + rounding)
    found = _find_cheapest_by_count(_compact_subgraph(graph, kept), cost[kept], max_layers)
    return few if found is None else kept[found]


def _reverse_graph(graph: ArcGraph, cost: Float) -> tuple[ArcGraph, Float]:
    """Reverse the graph: arcs from the top of the part down."""
    end = graph.n - graph.start
    order = np.argsort(end, kind="stable")
    begin = np.append(0, np.cumsum(np.bincount(end, minlength=graph.n + 1)))
    return ArcGraph(begin, (graph.n - graph.end)[order]), cost[order]


def _compact_subgraph(graph: ArcGraph, kept: Int) -> ArcGraph:
    """Return the graph that has only the arcs `kept` (K,) and the nodes at their ends."""
    start, end = graph.start[kept], graph.end[kept]
    touched: Bool = np.zeros(graph.n + 1, np.bool_)
    touched[[0, graph.n]] = touched[start] = touched[end] = True
    number = np.cumsum(touched) - 1
    count = np.bincount(number[end], minlength=int(number[-1]) + 1)
    return ArcGraph(np.append(0, np.cumsum(count)), number[start])


def _find_cheapest_by_count(graph: ArcGraph, cost: Float, max_layers: int) -> Int | None:
    """Find the cheapest plan of at most `max_layers` layers, with one cost table per number of layers."""
    reached = np.flatnonzero(np.diff(graph.begin))
    tables = [np.full(graph.n + 1, np.inf)]
    tables[0][0] = 0.0
    for _ in range(max_layers):
        after = np.full(graph.n + 1, np.inf)
        after[reached] = np.minimum.reduceat(tables[-1][graph.start] + cost, graph.begin[reached])
        tables.append(after)
    count = int(np.argmin([table[-1] for table in tables]))
    if not np.isfinite(tables[count][-1]):
        return None
    chain, k = [], graph.n
    for table in tables[:count][::-1]:
        chain.append(_find_last_arc(graph, k, table, cost))
        k = int(graph.start[chain[-1]])
    return np.array(chain[::-1], np.int64)
