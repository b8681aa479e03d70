"""Stretches between event planes: met exactly, with the heights allowed wherever they do."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from printer_slicer.arrays import Int
from printer_slicer.planning.reachable_heights import (
    fill_with_reachable_layers,
    find_event_planes,
    find_next_planes,
    find_reachable_layers,
)
from printer_slicer.planning.z_steps import ZSteps
from tests.parts import box, profile, step_pyramid


def steps_of(total: int, heights: tuple[int, ...] = (), **changes: Any) -> ZSteps:
    """Of a box so many z steps high and a list of heights in z steps."""
    listed = tuple(height / 100 for height in heights)
    return ZSteps(box((5, 5, total / 100)), profile(first_layer_height=0, layer_heights=listed, **changes))


def layers(limit: Int | int, planes: list[int], steps: ZSteps, bottom: int = 0) -> list[int]:
    limits = np.full(steps.part, limit) if isinstance(limit, int) else limit
    return [
        int(h)
        for h in fill_with_reachable_layers(
            find_reachable_layers(limits, planes, bottom, steps), limits, planes, bottom, steps
        )
    ]


@pytest.mark.parametrize(
    ("total", "listed", "limit", "expected"),
    [
        (96, (8, 32), 32, [32, 32, 32]),
        (64, (10, 20, 30), 30, [30, 20, 14]),  # a last one that fits
        (100, (10, 20, 30), 30, [30, 30, 20, 20]),  # 30, 30, 30, 10, and the last two share
        (90, (20, 30), 20, [20, 20, 20, 20, 10]),  # 30 at the end would be over the limit
        (35, (30,), 30, [18, 17]),
        (21, (), 8, [10, 11]),  # 8 and 13 would be farther over the limit
        (85, (), 32, [32, 27, 26]),
        (34, (10,), 10, [10, 12, 12]),
    ],
)
def test_a_stretch_is_filled_with_the_thickest_heights_that_end_on_its_plane(
    total: int, listed: tuple[int, ...], limit: int, expected: list[int]
) -> None:
    assert layers(limit, [total], steps_of(total, listed)) == expected


def test_no_layer_crosses_a_plane() -> None:
    assert layers(32, [40, 51, 100], steps_of(100)) == [20, 20, 11, 25, 24]


def test_a_narrow_printer_fills_a_stretch_with_three_heights_that_are_not_in_the_list() -> None:
    # 3.05 mm of 0.2 to 0.3: after nine layers of 0.3 there is too much left for one and too little for two.
    heights = layers(30, [305], steps_of(305, (30,), min_layer=0.2, max_layer=0.3))

    assert heights == [30] * 8 + [22, 22, 21]


def test_flats_too_near_to_each_other_are_met_by_size() -> None:
    mesh = step_pyramid([40, 30, 12, 11], [1.0, 0.04, 0.03, 1.0])
    steps = ZSteps(mesh, profile(first_layer_height=0))

    # 700 mm² at 1.00, 756 mm² at 1.04, 23 mm² at 1.07: only one of them can be an end.
    assert find_event_planes(mesh, steps, 0) == [104, 207]


def test_flats_near_the_bed_the_first_layer_and_the_top_are_not_ends() -> None:
    mesh = step_pyramid([40, 30, 20, 10], [0.05, 0.2, 1.0, 0.03])
    steps = ZSteps(mesh, profile())

    assert find_event_planes(mesh, steps, 20) == [128]
    assert find_event_planes(mesh, steps, 0) == [25, 128]


def test_the_next_plane_over_a_plane_is_another_one() -> None:
    assert find_next_planes([10, 30], steps_of(30))[[0, 9, 10, 29, 30]].tolist() == [10, 10, 30, 30, 30]


def can_be_met(limits: Int, start: int, end: int, allowed: list[int]) -> bool:
    """Whether allowed heights within the limits lead from one step to another, found from below."""
    reached = {start}
    for here in range(start, end):
        if here in reached:
            reached |= {here + height for height in allowed if height <= limits[here]}
    return end in reached


@given(
    listed=st.lists(st.integers(8, 32), min_size=1, max_size=5, unique=True),
    inner=st.lists(st.integers(8, 290), max_size=3, unique=True),
    total=st.integers(40, 300),
    seed=st.integers(0, 10**6),
    tight=st.booleans(),
)
def test_planes_are_met_within_limit_and_list_whenever_that_is_possible(
    listed: list[int], inner: list[int], total: int, seed: int, tight: bool
) -> None:
    steps = steps_of(total, tuple(listed))
    allowed = steps.allowed.tolist()
    planes = sorted({plane for plane in inner if plane <= total - 8} | {total})
    assume(min(np.diff([0, *planes])) >= 8)
    limits = np.full(total, 32)
    if tight:
        limits = np.maximum(np.random.default_rng(seed).integers(1, 33, size=total), allowed[0])

    heights = layers(limits, planes, steps)

    tops = np.cumsum(heights).tolist()
    bottoms = [0, *tops[:-1]]
    assert set(planes) <= set(tops)
    assert all(8 <= height <= 32 for height in heights)
    for start, end in pairwise([0, *planes]):
        inside = [(b, h) for b, h in zip(bottoms, heights, strict=True) if start <= b < end]
        assert {h for _, h in inside[:-2]} <= set(allowed)
        if can_be_met(limits, start, end, allowed):
            assert all(h in allowed and h <= limits[b] for b, h in inside)
