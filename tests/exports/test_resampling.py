"""Smoothing and sampling: the bound holds both ways, and the contours keep their topology."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from printer_slicer.arrays import Float
from printer_slicer.errors import UsageError
from printer_slicer.exports import resample, smooth
from printer_slicer.exports.ring_clearance import find_ring_contacts, measure_clearance
from printer_slicer.geometry import Areas
from tests.parts import shapely
from tests.strategies import box, clean_areas

ROUNDING = 1e-8  # mm
BOUNDS = st.sampled_from([0.001, 0.02, 0.1, 0.5, 3.0])


def circle(n: int, radius: float = 10.0, at: tuple[float, float] = (0.0, 0.0)) -> Float:
    turn = 2 * np.pi * np.arange(n) / n
    return np.asarray(radius * np.stack([np.cos(turn), np.sin(turn)], axis=1) + np.array(at))


def noisy(n: int, size: float, seed: int = 3) -> Float:
    """A circle of 10 mm whose points are up to `size` off."""
    radius = 10 + np.random.default_rng(seed).uniform(-size, size, n)
    return circle(n) / 10 * radius[:, None]


def stack(*rings: Float) -> Areas:
    return Areas.from_rings([list(rings)])


def distance(a: Float, b: Float) -> float:
    """Hausdorff distance of two closed lines, both ways, also measured between their corners, mm."""
    first, second = shapely.LinearRing(a), shapely.LinearRing(b)
    return float(shapely.hausdorff_distance(first, second, densify=0.1))


def roughness(ring: Float) -> float:
    """How much the contour turns in all, in turns: 1 if convex."""
    step = np.roll(ring, -1, axis=0) - ring
    angle = np.arctan2(step[:, 1], step[:, 0])
    turn = (np.roll(angle, -1) - angle + np.pi) % (2 * np.pi) - np.pi
    return float(np.abs(turn).sum() / (2 * np.pi))


def nesting(areas: Areas) -> list[tuple[int, int]]:
    """Pairs (inner, outer) of rings of one layer of which one lies in the other."""
    shapes = [shapely.Polygon(areas.ring(i)) for i in range(areas.n_rings)]
    return [
        (i, j)
        for i, a in enumerate(shapes)
        for j, b in enumerate(shapes)
        if i != j
        and areas.ring_layer[i] == areas.ring_layer[j]
        and b.contains(a.representative_point())
        and a.area < b.area
    ]


def check(new: Areas, old: Areas, bound: float) -> None:
    """The bound and the topology, with another library's eyes."""
    assert new.n_rings == old.n_rings
    assert new.ring_layer.tolist() == old.ring_layer.tolist()
    assert (np.sign(new.ring_area()) == np.sign(old.ring_area())).all()
    for i in range(old.n_rings):
        assert distance(new.ring(i), old.ring(i)) <= bound + ROUNDING
        if shapely.LinearRing(old.ring(i)).is_simple:
            assert shapely.LinearRing(new.ring(i)).is_simple
    for layer in range(old.n_layers):
        before, after = ([shapely.LinearRing(r) for r in one.rings(layer)] for one in (old, new))
        for i in range(len(before)):
            for j in range(i):
                if before[i].distance(before[j]) > ROUNDING:
                    assert not after[i].intersects(after[j])
    assert nesting(new) == nesting(old)


# Any contours


@given(areas=clean_areas(2), bound=BOUNDS)
def test_smoothed_contours_keep_to_the_bound_and_their_topology(areas: Areas, bound: float) -> None:
    check(smooth(areas, bound), areas, bound)


@given(
    areas=clean_areas(2),
    bound=st.one_of(st.just(0.0), BOUNDS),
    spacing=st.sampled_from([0.1, 1.0, 7.0, np.inf]),
)
def test_resampled_contours_keep_to_the_bound_and_their_topology(
    areas: Areas, bound: float, spacing: float
) -> None:
    check(resample(areas, spacing, bound), areas, bound)


@given(seed=st.integers(0, 10**6), bound=BOUNDS, size=st.sampled_from([0.01, 0.2, 1.0]))
def test_rough_contours_that_nearly_touch_keep_to_the_bound_and_their_topology(
    seed: int, bound: float, size: float
) -> None:
    outer = noisy(80, size, seed)
    areas = stack(outer, 0.98 * outer[::-1], 0.9 * noisy(60, size, seed + 1), circle(5, 0.05, (11.2, 0)))
    rings = [shapely.LinearRing(areas.ring(i)) for i in range(areas.n_rings)]
    assume(all(ring.is_simple for ring in rings))
    assume(not any(rings[i].intersects(rings[j]) for i in range(4) for j in range(i)))

    check(smooth(areas, bound), areas, bound)
    check(resample(areas, 0.7, bound), areas, bound)


@given(areas=clean_areas(1), spacing=st.floats(0.05, 5), bound=st.sampled_from([0.0, 0.01, 0.2]))
def test_points_are_no_farther_apart_than_asked_for(areas: Areas, spacing: float, bound: float) -> None:
    made = resample(areas, spacing, bound)
    step = np.hypot(*(made.xy[made.following] - made.xy).T)

    assert step.max(initial=0.0) <= spacing + ROUNDING


@given(areas=clean_areas(1), spacing=st.floats(0.05, 5))
def test_points_of_a_resampled_contour_lie_on_the_old_one(areas: Areas, spacing: float) -> None:
    made = resample(areas, spacing, 0.1)
    for i in range(areas.n_rings):
        old = shapely.LinearRing(areas.ring(i))
        assert shapely.distance(shapely.points(made.ring(i)), old).max() <= ROUNDING


# Known contours


def test_noise_fades() -> None:
    rough = noisy(600, 0.02)
    smoothed = smooth(stack(rough), 0.05).ring(0)

    assert roughness(rough) > 10
    assert roughness(smoothed) < roughness(rough) / 2


def test_the_corners_of_a_box_are_rounded_and_its_sides_stay() -> None:
    made = smooth(stack(box(0, 0, 20, 10)), 0.05)
    ring = made.ring(0)
    step = np.roll(ring, -1, axis=0) - ring
    turn = np.diff(np.unwrap(np.arctan2(step[:, 1], step[:, 0])))

    assert np.degrees(turn).max() < 30
    assert np.degrees(turn).min() > -1e-6  # convex as before
    assert ring.min(axis=0).tolist() == [0, 0]
    assert ring.max(axis=0).tolist() == [20, 10]
    assert 199.95 < made.area()[0] < 200


def test_a_fine_circle_keeps_its_points_and_nearly_its_size() -> None:
    made = smooth(stack(circle(200, 1.0)), 0.05)

    assert len(made.xy) == 200
    assert 0.997 < np.hypot(*made.xy.T).min() <= np.hypot(*made.xy.T).max() < 1


def test_contours_that_touch_stay_where_they_touch() -> None:
    areas = stack(box(0, 0, 5, 5), box(5, 5, 10, 10))
    made = smooth(areas, 0.5)

    assert [5.0, 5.0] in made.ring(0).tolist()
    assert [5.0, 5.0] in made.ring(1).tolist()


def test_walls_thinner_than_the_bound_stay_whole() -> None:
    wall = box(0, 0, 20, 0.02)
    made = smooth(stack(wall), 1.0)

    check(made, stack(wall), 1.0)
    assert made.area()[0] > 0


@given(
    thickness=st.sampled_from([0.002, 0.02, 0.1]),
    bound=st.sampled_from([0.05, 0.3, 2.0]),
    points=st.tuples(st.integers(40, 200), st.integers(40, 200)),
)
def test_a_thin_curved_wall_in_one_ring_never_crosses_itself(
    thickness: float, bound: float, points: tuple[int, int]
) -> None:
    outside, inside = (np.linspace(0, 5, n) for n in points)
    outer = 10 * np.stack([np.cos(outside), np.sin(outside)], axis=1)
    inner = (10 - thickness) * np.stack([np.cos(inside), np.sin(inside)], axis=1)
    areas = stack(np.concatenate([outer, inner[::-1]]))
    assume(shapely.Polygon(areas.ring(0)).is_valid)

    check(smooth(areas, bound), areas, bound)
    check(resample(areas, np.inf, bound), areas, bound)


def test_a_hole_beside_the_outline_stays_inside() -> None:
    areas = stack(box(0, 0, 20, 20), circle(12, 0.05, (0.11, 0.11))[::-1])
    for made in (smooth(areas, 0.5), resample(areas, 3.0, 0.5)):
        check(made, areas, 0.5)


def test_a_fine_circle_is_sampled_evenly() -> None:
    made = resample(stack(circle(1000)), 1.0, 0.05).ring(0)
    step = np.hypot(*(np.roll(made, -1, axis=0) - made).T)

    assert 63 <= len(made) <= 100
    assert step.max() <= 1.0
    assert step.max() / step.min() < 1.6


def test_points_that_the_bound_does_not_need_are_left_out() -> None:
    made = resample(stack(circle(5000)), np.inf, 0.01)

    assert len(made.xy) < 150
    check(made, stack(circle(5000)), 0.01)


def test_with_a_bound_of_nothing_the_line_stays_the_same() -> None:
    made = resample(stack(box(0, 0, 2, 1)), 0.5, 0.0)

    assert len(made.xy) == 12
    assert made.area().tolist() == [2]
    assert {(0.0, 0.0), (2.0, 0.0), (2.0, 1.0), (0.0, 1.0)} <= {(x, y) for x, y in made.xy.tolist()}


def test_empty_layers_stay_empty() -> None:
    areas = Areas.from_rings([[], [box(0, 0, 1, 1)], []])

    for made in (smooth(areas, 0.1), resample(areas, 0.1, 0.0)):
        assert made.n_layers == 3
        assert set(made.ring_layer.tolist()) == {1}
    assert smooth(Areas.empty(4), 0.1).n_layers == 4
    assert resample(Areas.empty(4), 0.1, 0.1).n_layers == 4


@pytest.mark.parametrize("bound", [0.0, -0.1, float("nan"), float("inf")])
def test_bounds_that_make_no_sense_are_refused(bound: float) -> None:
    with pytest.raises(UsageError, match="smoothed"):
        smooth(stack(box(0, 0, 1, 1)), bound)
    if bound:
        with pytest.raises(UsageError, match="sampled"):
            resample(stack(box(0, 0, 1, 1)), 0.1, bound)


@pytest.mark.parametrize("spacing", [0.0, -1.0, float("nan"), 1e-9])
def test_distances_that_make_no_sense_are_refused(spacing: float) -> None:
    with pytest.raises(UsageError, match=r"apart|distance"):
        resample(stack(box(0, 0, 1, 1)), spacing, 0.1)


# What they are built on


@given(areas=clean_areas(2), reach=st.sampled_from([0.01, 0.6, 4.0]))
def test_the_distance_to_other_rings_is_that_of_another_library(areas: Areas, reach: float) -> None:
    found = measure_clearance(areas, reach)
    ring = np.repeat(np.arange(areas.n_rings), np.diff(areas.ring_start))
    for i, (a, b) in enumerate(zip(areas.xy, areas.xy[areas.following], strict=True)):
        others = [
            shapely.LinearRing(areas.ring(j))
            for j in range(areas.n_rings)
            if j != ring[i] and areas.ring_layer[j] == areas.ring_layer[ring[i]]
        ]
        nearest = min((shapely.LineString([a, b]).distance(other) for other in others), default=np.inf)
        assert found[i] == pytest.approx(min(nearest, reach), abs=ROUNDING)


@given(seed=st.integers(0, 2**32 - 1), n=st.integers(3, 90))
def test_where_a_long_ring_meets_itself_is_what_another_library_says(seed: int, n: int) -> None:
    rng = np.random.default_rng(seed)
    turn = 2 * np.pi * np.arange(n) / n
    wild = np.column_stack([np.cos(turn), np.sin(turn)]) + rng.normal(0, 0.1, (n, 2))
    edges = [shapely.LineString([wild[i], wild[(i + 1) % n]]) for i in range(n)]
    wanted = {
        (i, j)
        for i in range(n)
        for j in range(i + 2, n)
        if (i, j) != (0, n - 1) and edges[i].intersects(edges[j])
    }

    assert set(zip(*find_ring_contacts(stack(wild, circle(40), wild + 1.0)), strict=True)) >= wanted
    assert set(zip(*find_ring_contacts(stack(wild)), strict=True)) == wanted


def test_edges_that_cross_touch_or_fold_back_are_found_and_neighbours_are_not() -> None:
    eight = np.array([(0, 0), (2, 2), (2, 0), (0, 2)], dtype=np.float64)
    pinched = np.array([(0, 0), (2, 0), (1, 1), (2, 2), (0, 2), (1, 1)], dtype=np.float64)
    folded = np.array([(0, 0), (4, 0), (2, 0), (2, 3)], dtype=np.float64)

    assert set(zip(*find_ring_contacts(stack(eight)), strict=True)) == {(0, 2)}
    assert len(find_ring_contacts(stack(pinched))[0]) == 4
    assert (0, 1) in set(zip(*find_ring_contacts(stack(folded)), strict=True))
    assert len(find_ring_contacts(stack(box(0, 0, 1, 1), circle(3), circle(50)))[0]) == 0
