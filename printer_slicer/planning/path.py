"""The cheapest way from the bed to the top of the part, one layer after the other.

Nodes 0 to n are heights, an arc is a layer that ends at a node. `cost[r, k]` is the cost of the layer of `heights[r]`
steps that ends at node k, infinite where there is none. Layers are at least `heights[0]` steps high, so as many
neighbouring nodes do not depend on each other and are settled at once. Source: the shortest path in an acyclic graph
(Bellman's recursion).
"""

from __future__ import annotations

import numpy as np

from printer_slicer.model import Float, Int

__all__ = ["cheapest", "cheapest_even", "cheapest_few"]


def cheapest(cost: Float, heights: Int) -> Int | None:
    """The heights in steps of the layers of the cheapest plan, from the bed up; None where no plan reaches the top.

    Args:
        cost: (R, n + 1) of every layer by its end.
        heights: (R,) in steps, ascending, all over 0.
    """
    n, margin, block = cost.shape[1] - 1, int(heights[-1]), int(heights[0])
    best = np.full(n + 1 + margin, np.inf)  # what lies under the bed is never reached
    best[margin] = 0.0
    choice = np.zeros(n + 1, np.int64)
    before = margin + np.arange(block) - heights[:, None]
    for k in range(1, n + 1, block):
        end = min(k + block, n + 1)
        total = best[before[:, : end - k] + k] + cost[:, k:end]
        pick = total.argmin(axis=0)
        choice[k:end] = pick
        best[margin + k : margin + end] = total[pick, np.arange(end - k)]
    if not np.isfinite(best[-1]):
        return None
    chain, k = [], n
    while k > 0:
        chain.append(int(heights[choice[k]]))
        k -= chain[-1]
    return np.array(chain[::-1], np.int64)


def cheapest_even(cost: Float, heights: Int, change: int, fine: float) -> Int | None:
    """The same where neighbouring layers that differ by more than `change` steps cost `fine` more.

    Args:
        cost: (R, n + 1) of every layer by its end.
        heights: (R,) in steps, consecutive numbers.
        change: steps.
        fine: for each pair of neighbours that differ by more.
    """
    n, margin, block, rows = cost.shape[1] - 1, int(heights[-1]), int(heights[0]), len(heights)
    # reach[r, k]: cheapest way to node k from which a layer of heights[r] may go on; the bed allows any.
    reach = np.full((rows, n + 1 + margin), np.inf)
    reach[:, margin] = 0.0
    came_by = np.full((rows, n + 1), -1, np.int64)
    last = np.full(rows, np.inf)
    before = margin + np.arange(block) - heights[:, None]
    row = np.arange(rows)[:, None]
    for k in range(1, n + 1, block):
        end = min(k + block, n + 1)
        total = reach[row, before[:, : end - k] + k] + cost[:, k:end]
        if end == n + 1:
            last = total[:, -1]
        pick = _window_argmin(total, change)
        value = np.take_along_axis(total, pick, axis=0)
        any_pick = total.argmin(axis=0)
        with_fine = total[any_pick, np.arange(end - k)] + fine
        came_by[:, k:end] = np.where(value <= with_fine, pick, any_pick)
        reach[:, margin + k : margin + end] = np.minimum(value, with_fine)
    if not np.isfinite(last.min()):
        return None
    chain, k, at = [], n, int(last.argmin())
    while k > 0:
        chain.append(int(heights[at]))
        k -= chain[-1]
        at = int(came_by[at, k])
    return np.array(chain[::-1], np.int64)


def _window_argmin(total: Float, change: int) -> Int:
    """(R, m) for each row the row of the smallest entry among those at most `change` rows away, column by column."""
    rows = len(total)
    best, where = total.copy(), np.broadcast_to(np.arange(rows)[:, None], total.shape).copy()
    for shift in range(1, min(change, rows - 1) + 1):
        for here, there in (
            (slice(shift, None), slice(None, -shift)),
            (slice(None, -shift), slice(shift, None)),
        ):
            better = total[there] < best[here]
            best[here] = np.where(better, total[there], best[here])
            where[here] = np.where(better, np.arange(rows)[there, None], where[here])
    return where


def cheapest_few(cost: Float, heights: Int, most: int) -> Int | None:
    """The cheapest plan of at most `most` layers; None where that many do not reach the top.

    Args:
        cost: (R, n + 1) of every layer by its end.
        heights: (R,) in steps, ascending, all over 0.
        most: layers.
    """
    n, margin = cost.shape[1] - 1, int(heights[-1])
    best = np.full(n + 1 + margin, np.inf)
    best[margin] = 0.0
    before = margin + np.arange(n + 1) - heights[:, None]
    column = np.arange(n + 1)
    choices, totals = [], []
    for _ in range(min(most, n // int(heights[0]) + 1)):
        total = best[before] + cost
        pick = total.argmin(axis=0)
        best[margin:] = total[pick, column]
        choices.append(pick.astype(np.int16))
        totals.append(float(best[-1]))
    if not totals or not np.isfinite(min(totals)):
        return None
    chain, k = [], n
    for pick in choices[int(np.argmin(totals)) :: -1]:
        chain.append(int(heights[pick[k]]))
        k -= chain[-1]
    return np.array(chain[::-1], np.int64)
