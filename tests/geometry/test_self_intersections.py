"""Sides that meet elsewhere than at their ends are found, exactly."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer.geometry.self_intersections import find_layers_with_self_intersections

Side = tuple[tuple[int, int], tuple[int, int]]

CASES: dict[str, tuple[list[Side], bool]] = {
    "apart": ([((0, 0), (10, 0)), ((0, 1), (10, 1))], False),
    "behind each other": ([((0, 0), (10, 0)), ((11, 0), (20, 0))], False),
    "joined": ([((0, 0), (10, 0)), ((10, 0), (20, 0))], False),
    "joined at their beginnings": ([((0, 0), (10, 0)), ((0, 0), (0, 10))], False),
    "crossing": ([((0, 0), (10, 10)), ((0, 10), (10, 0))], True),
    "an end upon a side": ([((0, 0), (10, 0)), ((5, 0), (5, 5))], True),
    "one along the other": ([((0, 0), (10, 0)), ((5, 0), (20, 0))], True),
    "there and back": ([((0, 0), (10, 0)), ((10, 0), (0, 0))], True),
    "back a little": ([((0, 0), (10, 0)), ((10, 0), (7, 0))], True),
    # A corner that rounding has put across a side that goes to the corner's neighbour, by less than a step.
    "rounded across": (
        [
            ((714425, 4841595), (700749, 4870126)),
            ((700749, 4870126), (1264678, 5133554)),
            ((1264678, 5133554), (596778, 4821558)),
        ],
        True,
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_sides_may_share_ends_and_nothing_else(name: str) -> None:
    sides, entangled = CASES[name]
    ends = np.array(sides)

    assert find_layers_with_self_intersections(ends, np.full(len(ends), 3)).tolist() == (
        [3] if entangled else []
    )
    alone = np.arange(len(ends))
    assert find_layers_with_self_intersections(ends, alone).tolist() == []


point = st.tuples(st.integers(0, 6), st.integers(0, 6))
side = st.tuples(point, point).filter(lambda ends: ends[0] != ends[1])


@given(layers=st.lists(st.lists(side, min_size=1, max_size=4), min_size=1, max_size=3))
def test_the_layers_found_are_those_another_library_finds(layers: list[list[Side]]) -> None:
    wanted = []
    for layer, sides in enumerate(layers):
        for one, other in combinations(sides, 2):
            both = shapely.intersection(shapely.LineString(one), shapely.LineString(other))
            at_ends = both.geom_type == "Point" and both.coords[0] in one and both.coords[0] in other
            if not both.is_empty and not at_ends:
                wanted.append(layer)
                break
    ends = np.array([ends for sides in layers for ends in sides])
    layer = np.repeat(np.arange(len(layers)), [len(sides) for sides in layers])

    assert find_layers_with_self_intersections(ends, layer).tolist() == wanted
