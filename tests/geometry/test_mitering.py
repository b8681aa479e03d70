"""Outlines moved corner by corner against Clipper2's own offsets, which join their corners in another way."""

from __future__ import annotations

import clipper2
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from printer_slicer.arrays import Float, Int
from printer_slicer.geometry import Areas, normalize, offset
from printer_slicer.geometry.clipper import combine, load
from printer_slicer.geometry.mitering import miter_rings
from printer_slicer.geometry.polygons import MITER_LIMIT

MM = 100_000


def moved(ring: list[tuple[float, float]], by: float) -> Int:
    """One ring, mm, moved outward by mm: steps, before any union."""
    xy = np.rint(np.array(ring) * MM).astype(np.int64)
    return miter_rings(xy, np.array([0, len(xy)]), np.array([by * MM]))[0]


def theirs(areas: Areas, by: float) -> list[list[Int]]:
    result = []
    for rings in load(areas):
        inflater = clipper2.ClipperOffset(MITER_LIMIT, 1.0)
        inflater.add_paths(rings, clipper2.JoinType.MITER, clipper2.EndType.POLYGON)
        result.append(inflater.execute(by * MM))
    return result


def area_of(layers: list[list[Int]]) -> float:
    x = [ring / MM for rings in layers for ring in rings]
    return sum(float(r[:, 0] @ np.roll(r[:, 1], -1) - r[:, 1] @ np.roll(r[:, 0], -1)) / 2 for r in x)


def flattest_tip(areas: Areas) -> float:
    """Cosine of the sharpest turn."""
    way = areas.xy[areas.following] - areas.xy
    way /= np.hypot(*way.T)[:, None]
    return float((way * way[areas.following]).sum(axis=1).min())


def star(seed: int, corners: int, spikes: float, at: float = 0.0) -> Float:
    """(n, 2) mm, a ring around a point whose corners are at uneven angles and distances."""
    rng = np.random.default_rng(seed)
    angle = np.sort(rng.uniform(0, 2 * np.pi, corners))
    reach = 5 * (1 - spikes * rng.random(corners))
    return np.column_stack([at + reach * np.cos(angle), reach * np.sin(angle)])


@given(
    st.integers(0, 10**6),
    st.integers(3, 60),
    st.floats(0, 0.9),
    st.floats(-3, 1.5).filter(lambda by: abs(by) > 1e-3),
)
def test_offsets_cover_what_those_of_the_other_way_cover(
    seed: int, corners: int, spikes: float, by: float
) -> None:
    hole = star(seed + 1, 12, 0.5)[::-1] * 0.3
    areas = normalize(
        Areas.from_rings([[star(seed, corners, spikes), hole, star(seed + 2, 9, 0.2, at=11.0)]])
    )
    assume(areas.n_rings)
    assume(flattest_tip(areas) > -0.995)  # at sharper ones a step of rounding is many steps of the tip

    ours, expected = load(offset(areas, by)), theirs(areas, by)

    apart = area_of(combine("difference", ours, expected)) + area_of(combine("difference", expected, ours))
    # Both round to the grid, and the second engine its tips to its own: outlines of some 100 mm, 0.05 µm apart.
    assert apart <= 5e-3


def test_the_corners_of_a_square_stay_corners() -> None:
    square = [(0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (0.0, 2.0)]

    assert (moved(square, 0.5) / MM).tolist() == [[-0.5, -0.5], [2.5, -0.5], [2.5, 2.5], [-0.5, 2.5]]


def test_inner_corners_of_a_curve_are_joined_and_others_led_through() -> None:
    angle = np.arange(12) * np.pi / 6
    ring = [(5 * np.cos(turn), 5 * np.sin(turn)) for turn in angle.tolist()]
    square = [(0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (0.0, 2.0)]

    assert len(moved(ring, -1.0)) == 12
    assert len(moved(ring, -6.0)) == 36
    assert len(moved(square, -0.5)) == 12


def test_a_sharp_corner_is_cut_off_at_the_distance() -> None:
    tip = moved([(0.0, 0.0), (10.0, -1.0), (10.0, 1.0)], 0.5)

    assert len(tip) == 4
    assert tip[:, 0].min() == pytest.approx(-0.5 * MM, abs=1)
    assert (tip[:, 0] == tip[:, 0].min()).sum() == 2


def test_points_that_are_there_twice_count_once() -> None:
    square = [(0.0, 0.0), (2.0, 0.0), (2.0, 0.0), (2.0, 2.0), (0.0, 2.0), (0.0, 0.0)]

    assert len(moved(square, 0.5)) == 4


def test_a_ring_that_is_one_point_is_nothing() -> None:
    xy = np.array([[0, 0], [0, 0], [0, 0], [5, 5], [9, 5], [9, 9]])

    points, start = miter_rings(xy, np.array([0, 3, 6]), np.array([1.0, 1.0]))

    assert start.tolist() == [0, 0, len(points)]


def test_what_is_shrunk_too_far_vanishes() -> None:
    for wide in (0.1, 1.0, 7.0):
        areas = Areas.from_rings([[np.array([(0.0, 0.0), (10.0, 0.0), (10.0, wide), (0.0, wide)])]])

        assert offset(areas, -wide / 2 - 0.01).n_rings == 0
        assert offset(areas, -30.0).n_rings == 0
