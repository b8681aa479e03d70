"""Loose ends of contours: who goes on where, whatever the order they are given in."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer.arrays import Float, Int
from printer_slicer.geometry.contour_closing import Chords, LooseEnds, close_with_chords, join_near_ends

seeds = st.integers(0, 2**32 - 1)
NOTHING = np.zeros((0, 2))


def scattered(seed: int, n: int, extent: float) -> tuple[Float, Int]:
    """As many tails (even) as heads (odd), each pair on the same plane."""
    rng = np.random.default_rng(seed)
    return rng.uniform(0, extent, (2 * n, 2)), np.repeat(np.sort(rng.integers(0, 3, n)), 2)


def ends(xy: Float, plane: Int) -> LooseEnds:
    return LooseEnds(xy, plane, np.arange(0, len(xy), 2), np.arange(1, len(xy), 2))


def greedy(xy: Float, plane: Int, reach: float) -> set[tuple[int, int]]:
    """The shortest pair of all that are left, again and again."""
    pairs = [
        (float(np.hypot(*(xy[tail] - xy[head]))), tail, head)
        for tail in range(0, len(xy), 2)
        for head in range(1, len(xy), 2)
        if plane[tail] == plane[head]
    ]
    found: set[tuple[int, int]] = set()
    used: set[int] = set()
    for width, tail, head in sorted(pairs):
        if width <= reach and not used & {tail, head}:
            used |= {tail, head}
            found.add((tail, head))
    return found


def pairs_of(chords: Chords) -> set[tuple[int, int]]:
    return set(zip(chords.tail.tolist(), chords.head.tolist(), strict=True))


@given(seed=seeds, n=st.integers(1, 40), extent=st.sampled_from([0.01, 1.0, 5.0, 50.0]))
def test_near_ends_are_joined_the_shortest_first(seed: int, n: int, extent: float) -> None:
    xy, plane = scattered(seed, n, extent)

    chords = join_near_ends(ends(xy, plane), 1.0)

    assert pairs_of(chords) == greedy(xy, plane, 1.0)
    assert chords.width == pytest.approx(np.hypot(*(xy[chords.tail] - xy[chords.head]).T))


@given(seed=seeds, n=st.integers(1, 30))
def test_on_a_lattice_full_of_ties_the_order_of_the_ends_decides_nothing(seed: int, n: int) -> None:
    rng = np.random.default_rng(seed)
    xy, plane = rng.integers(0, 5, (2 * n, 2)) * 0.25, np.zeros(2 * n, np.int64)
    order = rng.permutation(n)
    moved = np.stack([2 * order, 2 * order + 1], axis=1).ravel()

    first, second = join_near_ends(ends(xy, plane), 1.0), join_near_ends(ends(xy[moved], plane), 1.0)

    def places(chords: Chords, points: Float) -> list[list[float]]:
        return sorted(np.column_stack([points[chords.tail], points[chords.head]]).tolist())

    assert places(second, xy[moved]) == places(first, xy)


@given(seed=seeds, extent=st.sampled_from([0.3, 3.0, 30.0]), far=st.sampled_from([0.0, 1e5, -9e6]))
def test_near_ends_are_found_wherever_the_part_stands(seed: int, extent: float, far: float) -> None:
    """Among many ends far from each other, on planes with any number, at coordinates up to 10 km."""
    xy, plane = scattered(seed, 30, extent)
    xy, plane = np.round(xy, 6) + far, plane * 5000

    assert pairs_of(join_near_ends(ends(xy, plane), 1.0)) == greedy(xy, plane, 1.0)


def test_ends_on_either_side_of_any_border_between_cells_are_near() -> None:
    """Pairs 1 mm apart in steps of 0.37 mm along both axes; between pairs nothing is near."""
    step = np.arange(400)
    tails = np.column_stack([step * 10.37, step * 10.37])
    heads = tails + np.column_stack([np.cos(step), np.sin(step)]) * 0.999999
    xy, plane = np.stack([tails, heads], axis=1).reshape(-1, 2), np.zeros(800, np.int64)

    chords = join_near_ends(ends(xy, plane), 1.0)

    assert pairs_of(chords) == {(2 * k, 2 * k + 1) for k in range(400)}


def test_a_chord_goes_around_nothing_and_through_nothing() -> None:
    """The nearest beginning lies behind a segment, so the farther one is taken."""
    xy = np.array([(0.0, 0.0), (2.0, 0.0), (20.0, 0.0), (0.0, 3.0)])
    loose = LooseEnds(xy, np.zeros(4, np.int64), np.array([0, 2]), np.array([1, 3]))
    begin, end = np.array([(1.0, -5.0)]), np.array([(1.0, 2.0)])

    chords = close_with_chords(loose, begin, end, np.zeros(1, np.int64))

    assert pairs_of(chords) == {(0, 3), (2, 1)}


def test_ends_with_a_wall_between_them_stay_loose() -> None:
    xy = np.array([(0.0, 0.0), (2.0, 0.0)])
    loose = LooseEnds(xy, np.zeros(2, np.int64), np.array([0]), np.array([1]))

    chords = close_with_chords(loose, np.array([(1.0, -5.0)]), np.array([(1.0, 5.0)]), np.zeros(1, np.int64))

    assert pairs_of(chords) == set()
    assert len(loose.without(chords).tails) == 1


def test_too_many_ends_in_one_place_are_not_compared() -> None:
    rng = np.random.default_rng(4)
    with pytest.raises(OverflowError):
        join_near_ends(ends(rng.uniform(0, 0.5, (40_000, 2)), np.zeros(40_000, np.int64)), 1.0)
    loose = ends(rng.uniform(0, 500, (2_000, 2)), np.zeros(2_000, np.int64))
    with pytest.raises(OverflowError):
        close_with_chords(loose, NOTHING, NOTHING, np.zeros(0, np.int64))
