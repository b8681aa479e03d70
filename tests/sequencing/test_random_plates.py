"""Random plates: where an order is found, the simulated printer sees no contact; where none is, none is possible."""

from __future__ import annotations

import pytest

from benchmarks.sequential import try_plate

SEEDS = [*range(4), *(pytest.param(seed, marks=pytest.mark.thorough) for seed in range(4, 30))]


@pytest.mark.parametrize("seed", SEEDS)
def test_the_head_touches_nothing_in_the_order_that_is_found(seed: int) -> None:
    assert try_plate(seed).fault == ""
