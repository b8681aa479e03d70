"""The order of objects: the same as by trying all of them, and a message that tells what is missing."""

from __future__ import annotations

import re
from itertools import permutations

import numpy as np
import pytest
import shapely
from hypothesis import assume, given
from hypothesis import strategies as st

import printer_slicer as ps
from printer_slicer.errors import PartError
from printer_slicer.geometry import Areas, convex_hull
from printer_slicer.sequencing import ObjectExtent, find_print_order, list_obstacles
from printer_slicer.sequencing.obstacles import _sum_convex

HEADS = [
    "0: 12",
    "0: 3, 6: -20x-8 20x8",
    "0: 5, 15: -9999x-9999 9999x9999",
    "0: 4, 8: 15, 12: -9999x-10 9999x10",
]


def head(text: str) -> ps.Printer:
    return ps.load_profile(changes={"printer.head": text}).printer


def block(name: str, low: tuple[float, float], size: tuple[float, float, float]) -> ObjectExtent:
    """Return a block that is printed in layers of its outline."""
    (x, y), (w, d, h) = low, size
    ring = np.array([[x, y], [x + w, y], [x + w, y + d], [x, y + d]], np.float64)
    one = Areas.from_rings([[ring]])
    return ObjectExtent(name, h, np.array([0.2]), one, np.zeros(1), one)


def random_blocks(seed: int) -> list[ObjectExtent]:
    random = np.random.default_rng(seed)
    return [
        block(
            f"block_{number}",
            tuple(random.uniform(0, 90, 2).round(1).tolist()),
            tuple(random.uniform(3, 22, 3).round(1).tolist()),
        )
        for number in range(int(random.integers(2, 6)))
    ]


def is_possible(order: tuple[int, ...], blocked: set[tuple[int, int]]) -> bool:
    pairs = ((a, b) for at, a in enumerate(order) for b in order[at + 1 :])
    return not any(pair in blocked for pair in pairs)


@pytest.mark.parametrize("text", HEADS)
def test_an_order_is_found_exactly_if_one_of_all_is_possible(text: str) -> None:
    printer, found = head(text), {True: 0, False: 0}
    for seed in range(60):
        extents = random_blocks(seed)
        blocked = {(one.first, one.later) for one in list_obstacles(extents, printer)}
        exists = any(is_possible(order, blocked) for order in permutations(range(len(extents))))
        found[exists] += 1
        if exists:
            assert is_possible(find_print_order(extents, printer), blocked)
        else:
            with pytest.raises(PartError, match="cannot be printed one after the other"):
                find_print_order(extents, printer)
    assert min(found.values()) > 3


def test_blocks_are_in_the_way_if_their_distance_is_less_than_the_reach_of_the_head() -> None:
    printer = head("0: -9x-4 9x4")
    for gap, is_free in ((8.99, False), (9.01, True)):
        extents = [block("a", (0, 0), (10, 10, 9)), block("b", (10 + gap, 0), (10, 10, 9))]
        assert (list_obstacles(extents, printer) == []) is is_free


def test_the_missing_distance_is_enough() -> None:
    printer = head("0: -9x-9 9x9")
    blocks = [block("left", (0, 0), (10, 10, 9)), block("right", (14, 0), (10, 10, 9))]
    with pytest.raises(PartError, match=r"left and right|right and left") as caught:
        find_print_order(blocks, printer)
    missing = float(re.findall(r"([\d.]+) mm more", str(caught.value))[0])

    assert missing == pytest.approx(5, abs=0.1)
    find_print_order([blocks[0], block("right", (14 + missing, 0), (10, 10, 9))], printer)


def test_what_is_higher_than_the_gantry_comes_last() -> None:
    printer = head("0: 5, 15: -9999x-9999 9999x9999")
    extents = [
        block("tall", (0, 0), (9, 9, 40)),
        block("low", (30, 0), (9, 9, 8)),
        block("flat", (60, 0), (9, 9, 2)),
    ]
    assert find_print_order(extents, printer) == (2, 1, 0)

    extents.append(block("mast", (90, 0), (9, 9, 30)))
    with pytest.raises(PartError, match="at any distance, because both are higher than the 15 mm") as caught:
        find_print_order(extents, printer)
    assert caught.value.remedy is not None
    assert "separate plates" in caught.value.remedy


def test_a_bar_along_x_allows_tall_blocks_in_rows() -> None:
    printer = head("0: 5, 15: -9999x-20 9999x20")
    rows = [block("front", (0, 0), (9, 9, 40)), block("back", (0, 40), (9, 9, 40))]
    assert find_print_order(rows, printer) == (0, 1)

    with pytest.raises(PartError, match="mm more distance in y would") as caught:
        find_print_order([rows[0], block("beside", (60, 0), (9, 9, 40))], printer)
    missing = float(re.findall(r"([\d.]+) mm more", str(caught.value))[0])
    assert missing == pytest.approx(29, abs=0.15)
    find_print_order([rows[0], block("beside", (60, missing), (9, 9, 40))], printer)


def test_a_head_that_reaches_to_one_side_decides_the_order() -> None:
    printer = head("0: -3x-3 12x3")
    extents = [block("right", (20, 0), (9, 9, 9)), block("left", (0, 0), (9, 9, 9))]

    assert find_print_order(extents, printer) == (1, 0)


@given(st.integers(0, 10_000))
def test_the_area_that_the_head_sweeps_is_the_hull_of_all_sums_of_corners(seed: int) -> None:
    random = np.random.default_rng(seed)
    round_corners = convex_hull(random.uniform(-9, 9, (random.integers(4, 40), 2)))
    on_grid = convex_hull(random.integers(-3, 4, (9, 2)).astype(np.float64))
    assume(on_grid.n_rings)
    a, b = round_corners.ring(0), on_grid.ring(0)
    wanted = shapely.Polygon(convex_hull((a[:, None] + b).reshape(-1, 2)).ring(0))
    for first, other in ((a, b), (b, a)):
        found = shapely.Polygon(_sum_convex(first, other))
        assert found.is_valid
        assert found.symmetric_difference(wanted).area < 1e-9
