"""Tours: every unit once, in its group, on a way that is never longer and mostly the shortest."""

from __future__ import annotations

from itertools import permutations, product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer.arrays import Bool, Float, Int
from printer_slicer.ordering.tour_improvement import shorten_tour


def way(begin: Float, end: Float, order: Int, turned: Bool) -> float:
    into = np.where(turned[:, None], end[order], begin[order])
    out = np.where(turned[:, None], begin[order], end[order])
    return float(np.hypot(*(into[1:] - out[:-1]).T).sum())


@given(seed=st.integers(0, 10**6), n=st.integers(0, 60), groups=st.integers(1, 5), free=st.floats(0, 1))
def test_every_unit_is_visited_once_in_its_group_and_the_way_is_no_longer(
    seed: int, n: int, groups: int, free: float
) -> None:
    rng = np.random.default_rng(seed)
    begin, end = rng.uniform(0, 50, (2, n, 2))
    may_turn, group = rng.random(n) < free, np.sort(rng.integers(0, groups, n))

    order, turned = shorten_tour(begin, end, may_turn, group)

    assert sorted(order.tolist()) == list(range(n))
    assert np.array_equal(group[order], group)
    assert may_turn[order[turned]].all()
    assert n < 2 or way(begin, end, order, turned) <= way(begin, end, np.arange(n), np.zeros(n, bool)) + 1e-6


def test_the_first_and_the_last_have_no_way_before_and_behind_them() -> None:
    rng = np.random.default_rng(65537)
    begin, end = rng.uniform(0, 50, (2, 6, 2))

    order, turned = shorten_tour(begin, end, np.zeros(6, bool), np.zeros(6, np.int64))

    assert way(begin, end, order, turned) <= way(begin, end, np.arange(6), np.zeros(6, bool)) + 1e-6


@pytest.mark.parametrize("may_turn", [False, True])
def test_few_units_are_visited_on_nearly_the_shortest_way(may_turn: bool) -> None:
    """Against every order and every way of turning; the first and the last stay where they are."""
    ratios = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        n = 6
        begin, end = rng.uniform(0, 50, (2, n, 2))
        group = np.array([0, *[1] * (n - 2), 2])
        order, turned = shorten_tour(begin, end, np.full(n, may_turn) & (group == 1), group)
        best = min(
            way(begin, end, np.array([0, *middle, n - 1]), np.array([False, *turns, False]))
            for middle in permutations(range(1, n - 1))
            for turns in product([False, True] if may_turn else [False], repeat=n - 2)
        )
        ratios.append(way(begin, end, order, turned) / best)

    assert np.mean(ratios) < 1.05
    assert max(ratios) < 1.25


def test_lines_of_a_comb_are_visited_to_and_fro() -> None:
    x = np.random.default_rng(3).permutation(40)
    begin, end = np.column_stack([x, np.zeros(40)]), np.column_stack([x, np.full(40, 30.0)])

    order, turned = shorten_tour(begin, end, np.ones(40, bool), np.zeros(40, np.int64))

    assert way(begin, end, order, turned) < 0.12 * way(begin, end, np.arange(40), np.zeros(40, bool))
