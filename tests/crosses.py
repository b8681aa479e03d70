"""Parameters of which not every combination is tried each time."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import product
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from _pytest.mark import ParameterSet

__all__ = ["crossed", "some"]


def crossed(*axes: Iterable[object], laps: int = 1) -> list[ParameterSet]:
    """All combinations of some values: `just check` tries some in which every value is met, `just thorough` all.

    Args:
        axes: the values of each parameter.
        laps: in how many combinations each value of the longest axis is met.
    """
    values = [list(axis) for axis in axes]
    longest = max(map(len, values))
    tried = {
        tuple((step + lap * nth) % len(axis) for nth, axis in enumerate(values))
        for lap in range(laps)
        for step in range(longest)
    }
    return [
        pytest.param(
            *(axis[at] for axis, at in zip(values, places, strict=True)),
            marks=() if places in tried else pytest.mark.thorough,
        )
        for places in product(*(range(len(axis)) for axis in values))
    ]


def some(values: Iterable[object], few: int) -> list[ParameterSet]:
    """Values of which `just check` tries the first few, `just thorough` all: seeds, where more are only more."""
    return [
        pytest.param(value, marks=() if nth < few else pytest.mark.thorough)
        for nth, value in enumerate(values)
    ]
