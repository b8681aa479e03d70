"""Choose how many cases and examples of a test run in `just check`, and how many in `just thorough`."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import product
from typing import Any

import pytest
from hypothesis import settings

__all__ = ["crossed", "examples", "few_of"]

_USUAL = 12
"""Examples of a property in `just check`, as `conftest.py` sets them."""

_MORE = 8
"""So many times as many examples in `just thorough`, if a property has a number of its own."""


def examples(few: int, many: int = 0) -> int:
    """So many in `just check`; in `just thorough` `many`, or without that eight times as many."""
    is_thorough = settings.default is not None and settings.default.max_examples > _USUAL
    return (many or few * _MORE) if is_thorough else few


def crossed(*axes: Iterable[Any], laps: int = 1) -> list[Any]:
    """All combinations of these values; in `just check` only as many as it takes for every value to occur.

    Args:
        axes: the values of each parameter.
        laps: in how many combinations each value of the longest axis occurs there.
    """
    values = [list(axis) for axis in axes]
    longest = max(len(axis) for axis in values)
    kept = {
        tuple((step + lap * nth) % len(axis) for nth, axis in enumerate(values))
        for lap in range(laps)
        for step in range(longest)
    }
    return [
        pytest.param(
            *(axis[i] for axis, i in zip(values, place, strict=True)),
            marks=[] if place in kept else [pytest.mark.thorough],
            id="-".join(names) if all(names) else None,
        )
        for place in product(*(range(len(axis)) for axis in values))
        for names in [[_name(axis[i]) for axis, i in zip(values, place, strict=True)]]
    ]


def _name(value: Any) -> str:
    """What a value is called in the name of a test, "" where pytest knows better."""
    return str(value) if isinstance(value, (str, int, float)) else str(getattr(value, "name", ""))


def few_of(cases: Iterable[Any], kept: int) -> list[Any]:
    """All cases; in `just check` the first ones only."""
    return [
        case if nth < kept else pytest.param(case, marks=pytest.mark.thorough)
        for nth, case in enumerate(cases)
    ]
