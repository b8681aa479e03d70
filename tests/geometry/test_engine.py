"""The functions over stacks: what both engines promise, and that they agree."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer.arrays import Float
from printer_slicer.errors import UsageError
from printer_slicer.geometry import (
    Areas,
    difference,
    intersection,
    normalize,
    offset,
    offset_open,
    simplify,
    union,
    window_intersection,
)
from printer_slicer.geometry.engine import ENGINES, load_engine, using_engine
from printer_slicer.geometry.polygons import ROUND_TOLERANCE, Join
from printer_slicer.kernel import VARIABLE
from tests.kernels import needs_kernel
from tests.parts import shape, shapely
from tests.strategies import areas, box, clean_areas, rectilinear_areas

engines = pytest.mark.parametrize("engine", list(ENGINES))

# Corners are known to a step of the grid (1e-5 mm), so areas to a few times that by the length of outline.
BLUR = 4e-5


def blur(*stacks: Areas) -> float:
    return 1e-6 + BLUR * sum(float(stack.ring_length().sum()) for stack in stacks)


def is_within(inner: Areas, outer: Areas, tolerance: float = 0.0) -> bool:
    return bool((difference(inner, outer).area() <= tolerance + blur(inner, outer)).all())


def is_same(a: Areas, b: Areas) -> bool:
    return is_within(a, b) and is_within(b, a)


def is_clean(areas: Areas) -> bool:
    """Rings that wind once around everything they hold lose nothing by being normalised."""
    signed, once = areas.area(), normalize(areas).area()
    return bool((np.abs(signed - once) <= blur(areas)).all() and (np.diff(areas.ring_start) >= 3).all())


# --- normalize ---


@engines
def test_overlapping_shells_merge(engine: str) -> None:
    stack = Areas.from_rings([[box(0, 0, 2, 2), box(1, 1, 3, 3)]])
    with using_engine(engine):
        merged = normalize(stack)

    assert merged.n_rings == 1
    assert merged.area() == pytest.approx([7])


@engines
def test_shells_that_share_an_edge_merge_without_leaving_points_on_it(engine: str) -> None:
    with using_engine(engine):
        merged = normalize(Areas.from_rings([[box(0, 0, 2, 2), box(2, 0, 4, 2)]]))

    assert sorted(merged.xy.tolist()) == [[0, 0], [0, 2], [4, 0], [4, 2]]


@engines
def test_a_shell_that_touches_another_along_a_side_is_joined_to_it(engine: str) -> None:
    # One of the rare cases in which a single pass of Clipper2 leaves the two apart.
    holes = [box(2, 3, 2.5, 6.5)[::-1], box(2, 0, 6, 1.5)[::-1]]
    solids = [box(0.5, 2, 2, 3.5), box(2, 1, 3, 3.5)]
    with using_engine(engine):
        joined = normalize(Areas.from_rings([holes + solids]))

        assert joined.n_rings == 1
        assert joined.area() == pytest.approx([1.5 * 1.5 + 2 * 1 - 0.5 * 0.5])


@engines
def test_only_the_lobe_of_a_figure_eight_that_runs_to_the_left_stays(engine: str) -> None:
    eight = np.array([[0, 0], [2, 2], [2, 0], [0, 2]], dtype=float)
    with using_engine(engine):
        left = normalize(Areas.from_rings([[eight], [eight[::-1]]]))

    assert left.area() == pytest.approx([1, 1])
    assert left.xy[left.ring_start[0] : left.ring_start[1], 0].max() == 1
    assert left.xy[left.ring_start[1] : left.ring_start[2], 0].min() == 1


@engines
def test_solids_run_left_and_holes_right(engine: str) -> None:
    stack = Areas.from_rings([[box(0, 0, 9, 9), box(1, 1, 8, 8)[::-1], box(2, 2, 7, 7)]])
    with using_engine(engine):
        nested = normalize(stack)

    assert sorted(nested.ring_area().tolist()) == pytest.approx([-49, 25, 81])


@engines
def test_a_hole_without_a_solid_covers_nothing(engine: str) -> None:
    with using_engine(engine):
        assert normalize(Areas.from_rings([[box(0, 0, 1, 1)[::-1]], []])).area().tolist() == [0, 0]


@engines
def test_a_hole_takes_away_only_one_of_two_shells(engine: str) -> None:
    stack = Areas.from_rings([[box(0, 0, 4, 4), box(1, 1, 3, 3), box(1, 1, 3, 3)[::-1]]])
    with using_engine(engine):
        assert normalize(stack).area() == pytest.approx([16])


@engines
@given(stack=areas(4))
def test_what_is_normalized_stays_as_it_is(engine: str, stack: Areas) -> None:
    with using_engine(engine):
        once = normalize(stack)

        assert is_clean(once)
        assert normalize(once).area() == pytest.approx(once.area(), abs=blur(once))


# --- union, difference, intersection ---


@engines
@given(a=clean_areas(4), b=clean_areas(4))
def test_union_and_intersection_together_hold_as_much_as_both(engine: str, a: Areas, b: Areas) -> None:
    with using_engine(engine):
        either, both = union(a, b), intersection(a, b)

        assert either.area() + both.area() == pytest.approx(a.area() + b.area(), abs=blur(a, b))
        assert is_clean(either)
        assert is_clean(both)


@engines
@given(a=clean_areas(4), b=clean_areas(4))
def test_difference_and_intersection_make_up_the_whole(engine: str, a: Areas, b: Areas) -> None:
    with using_engine(engine):
        rest, both = difference(a, b), intersection(a, b)

        assert rest.area() + both.area() == pytest.approx(a.area(), abs=blur(a, b))
        assert intersection(rest, b).area() == pytest.approx(np.zeros(4), abs=blur(a, b))
        assert is_same(union(rest, both), a)
        assert is_clean(rest)


@engines
@pytest.mark.parametrize("combine", [union, difference, intersection])
def test_of_a_crowd_only_what_meets_is_worked_on(engine: str, combine: Callable[..., Areas]) -> None:
    # Squares with holes beside, on and in the holes of each other.
    crowd = [box(4 * i, 4 * j, 4 * i + 3, 4 * j + 3) for i in range(6) for j in range(6)]
    holes = [box(4 * i + 1, 4 * j + 1, 4 * i + 2, 4 * j + 2)[::-1] for i in range(6) for j in range(6)]
    others = [box(0.5, 0.5, 9, 2.5), box(13.25, 1.25, 13.75, 1.75), box(30, 0, 31, 1), box(8, 3, 9, 4)]
    with using_engine(engine):
        made = combine(Areas.from_rings([crowd + holes]), Areas.from_rings([others]))

    one, other = shape(Areas.from_rings([crowd + holes]), 0), shape(Areas.from_rings([others]), 0)
    wanted = getattr(one, combine.__name__)(other)
    assert shapely.area(shape(made, 0).symmetric_difference(wanted)) < 1e-3
    assert is_clean(made)


@engines
def test_layers_that_do_not_meet_are_passed_through(engine: str) -> None:
    a = Areas.from_rings([[box(0, 0, 1, 1)], [], [box(0, 0, 1, 1)], [box(0, 0, 2, 2)]])
    b = Areas.from_rings([[], [box(0, 0, 1, 1)], [box(5, 5, 6, 6)], [box(1, 0, 3, 2)]])
    with using_engine(engine):
        results = [f(a, b) for f in (union, difference, intersection)]

    assert [r.area().tolist() for r in results] == [[1, 1, 2, 6], [1, 0, 1, 2], [0, 0, 0, 2]]
    assert all(r.n_layers == 4 for r in results)


@engines
@pytest.mark.parametrize("combine", [union, difference, intersection])
def test_empty_stacks_give_empty_stacks(engine: str, combine: type) -> None:
    with using_engine(engine):
        assert combine(Areas.empty(2), Areas.empty(2)).area().tolist() == [0, 0]
        assert combine(Areas.empty(0), Areas.empty(0)).n_layers == 0


@pytest.mark.parametrize("combine", [union, difference, intersection])
def test_stacks_of_different_height_are_refused(combine: type) -> None:
    with pytest.raises(ValueError, match="different numbers of layers: 2 and 3"):
        combine(Areas.empty(2), Areas.empty(3))


# --- offset ---


@engines
def test_each_layer_is_moved_by_its_own_distance(engine: str) -> None:
    stack = Areas.from_rings([[box(0, 0, 10, 10)]] * 4)
    with using_engine(engine):
        moved = offset(stack, np.array([1.0, -1.0, -6.0, 0.0]))

    assert moved.area() == pytest.approx([144, 64, 0, 100])
    assert moved.ring_layer.tolist() == [0, 1, 3]


@engines
def test_a_hole_shrinks_when_its_solid_grows(engine: str) -> None:
    stack = Areas.from_rings([[box(0, 0, 10, 10), box(3, 3, 7, 7)[::-1]]])
    with using_engine(engine):
        assert offset(stack, 1.0).area() == pytest.approx([144 - 4])
        assert offset(stack, -1.0).area() == pytest.approx([64 - 36])
        assert offset(stack, 2.5).area() == pytest.approx([225])


@engines
def test_corners_of_a_triangle_keep_their_points_down_to_the_miter_limit(engine: str) -> None:
    def triangle(apex_deg: float) -> Float:
        half = np.deg2rad(apex_deg / 2)
        return 10 * np.array([[0, 0], [np.cos(half), -np.sin(half)], [np.cos(half), np.sin(half)]])

    with using_engine(engine):
        tips = [
            float(-offset(Areas.from_rings([[triangle(apex)]]), 0.5).xy[:, 0].min()) for apex in (62, 58, 20)
        ]

    assert tips == pytest.approx([0.5 / np.sin(np.deg2rad(31)), 0.5, 0.5], abs=1e-4)


@engines
def test_round_joins_follow_the_circle(engine: str) -> None:
    stack = Areas.from_rings([[box(0, 0, 10, 10)], []])
    with using_engine(engine):
        round_corners = offset(stack, 2.0, join="round")
    reach = np.hypot(*np.maximum(np.abs(round_corners.xy - 5) - 5, 0).T)

    assert round_corners.area()[0] == pytest.approx(100 + 4 * 20 + 4 * np.pi, abs=4 * np.pi * 0.005)
    assert reach == pytest.approx(np.full(len(reach), 2.0), abs=1e-4)


def round_trip(stack: Areas, by: float, join: Join) -> Areas:
    grown = offset(stack, by, join=join)
    back = offset(grown, -by, join=join)

    assert is_within(stack, grown)
    assert is_clean(grown)
    assert is_clean(back)
    return back


@engines
@given(stack=clean_areas(3), distance=st.integers(1, 12))
def test_grown_then_shrunk_areas_hold_the_original(engine: str, stack: Areas, distance: int) -> None:
    by = distance / 8
    with using_engine(engine):
        back = round_trip(stack, by, "round")
        # Chords stay within the circle; GEOS leaves out points that matter less than 1 % of the distance.
        allowed = ROUND_TOLERANCE + (0.0 if engine == "clipper" else 0.01 * by)

        assert is_within(stack, back, allowed * float(stack.ring_length().sum()))


@engines
@given(
    stack=rectilinear_areas(3),
    distance=st.integers(1, 12),
)
def test_mitered_right_angles_survive_growing_and_shrinking(engine: str, stack: Areas, distance: int) -> None:
    with using_engine(engine):
        assert is_within(stack, round_trip(stack, distance / 8, "miter"))


@engines
@given(stack=clean_areas(3), distances=st.lists(st.integers(-12, 12), min_size=3, max_size=3))
def test_layers_do_not_know_each_other(engine: str, stack: Areas, distances: list[int]) -> None:
    by = np.array(distances) / 8
    with using_engine(engine):
        together = offset(stack, by).area()
        alone = [offset(stack, float(d)).area()[k] for k, d in enumerate(by)]

    assert together == pytest.approx(alone, abs=1e-9)


@engines
def test_offsets_of_nothing_are_nothing(engine: str) -> None:
    with using_engine(engine):
        assert offset(Areas.empty(2), -1.0).n_layers == 2
        assert offset(Areas.empty(0), 1.0).n_rings == 0
        assert offset_open(Areas.empty(2), 1.0).n_rings == 0


@pytest.mark.parametrize("distance", [np.ones(3), float("nan"), float("inf")])
def test_distances_that_make_no_sense_are_refused(distance: float | Float) -> None:
    with pytest.raises(ValueError, match=r"layer|finite"):
        offset(Areas.empty(2), distance)


# --- simplify ---


def circle(n: int, radius: float = 10.0, start: float = 0.0) -> Float:
    angle = start + np.arange(n) * (2 * np.pi / n)
    return radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def test_no_point_of_a_simplified_ring_is_lost_by_more_than_the_tolerance() -> None:
    rings = [[circle(1000, 5 + k, 0.1 * k)] for k in range(5)]
    simple = simplify(Areas.from_rings(rings), 0.05)

    assert (np.diff(simple.ring_start) < 100).all()
    for k in range(5):
        (ring,) = simple.rings(k)
        middle = (ring + np.roll(ring, -1, axis=0)) / 2
        assert np.hypot(*middle.T).min() >= 5 + k - 0.05 - 1e-9


def test_simplified_rings_do_not_depend_on_where_they_begin() -> None:
    ring = circle(60)
    turned = [np.roll(ring, shift, axis=0) for shift in range(60)]
    simple = simplify(Areas.from_rings([[r] for r in turned]), 0.2)

    assert len({tuple(map(tuple, r)) for k in range(60) for r in simple.rings(k)}) == 1


@pytest.mark.parametrize("tolerance", [0.0, 0.01])
def test_a_start_in_the_middle_of_a_side_is_dropped(tolerance: float) -> None:
    ring = np.array([[5, 0], [10, 0], [10, 10], [5, 10], [0, 10], [0, 5], [0, 0], [0, 0]], dtype=float)
    simple = simplify(Areas.from_rings([[ring], [ring[::-1]]]), tolerance)

    assert simple.area().tolist() == [100, -100]
    assert np.diff(simple.ring_start).tolist() == [4, 4]
    assert simple.ring(0)[0].tolist() == simple.ring(1)[0].tolist() == [0, 0]


def test_tolerance_zero_keeps_every_turn() -> None:
    ring = circle(500)
    simple = simplify(Areas.from_rings([[np.repeat(ring, 3, axis=0)], [ring]]), 0.0)

    assert simple.area() == pytest.approx([simple.area()[1]] * 2)
    assert np.diff(simple.ring_start).tolist() == [500, 500]


def test_points_on_a_sloping_side_are_dropped_in_spite_of_rounding() -> None:
    share = np.linspace(0, 1, 50)[:, None]
    a, b, c = np.array([0.1, 0.2]), np.array([7.3, 2.9]), np.array([3.1, 11.7])
    ring = np.concatenate([p + share[:-1] * (q - p) for p, q in ((a, b), (b, c), (c, a))])
    simple = simplify(Areas.from_rings([[ring]]), 0.0)

    assert np.diff(simple.ring_start).tolist() == [3]


@pytest.mark.parametrize("tolerance", [0.0, 0.01])
def test_rings_that_collapse_are_dropped(tolerance: float) -> None:
    flat = np.array([[0, 0], [5, 0], [9, 0], [5, 0]], dtype=float)
    point = np.zeros((4, 2))
    simple = simplify(Areas.from_rings([[flat, point], [flat, box(0, 0, 1, 1)], [point]]), tolerance)

    assert simple.ring_layer.tolist() == [1]
    assert simple.area().tolist() == [0, 1, 0]


def test_spikes_without_area_are_dropped() -> None:
    spike = np.array([[0, 0], [4, 0], [4, 2], [9, 2], [4, 2], [4, 4], [0, 4]], dtype=float)

    assert len(simplify(Areas.from_rings([[spike]]), 0.0).xy) == 4


@given(areas(3), st.integers(0, 10))
def test_simplified_areas_change_by_at_most_the_tolerance_along_the_outline(stack: Areas, steps: int) -> None:
    tolerance = steps / 20
    simple = simplify(stack, tolerance)

    assert simple.n_layers == 3
    lost = stack.n_rings - simple.n_rings
    assert lost == 0 or tolerance > 0
    assert np.abs(simple.area() - stack.area()).sum() <= tolerance * stack.ring_length().sum() + 1e-9


def test_nothing_is_simplified_to_nothing() -> None:
    for tolerance in (0.0, 0.1):
        assert simplify(Areas.empty(2), tolerance).n_layers == 2


@pytest.mark.parametrize("tolerance", [-0.1, float("nan")])
def test_tolerances_that_make_no_sense_are_refused(tolerance: float) -> None:
    with pytest.raises(ValueError, match="tolerance"):
        simplify(Areas.empty(1), tolerance)


# --- window_intersection ---


def one_by_one(stack: Areas, first: int, last: int) -> float:
    """Area of what layers `first` to `last` - 1 have in common, one after the other."""
    if first < 0 or last > stack.n_layers:
        return 0.0
    result = Areas.from_rings([list(stack.rings(first))])
    for k in range(first + 1, last):
        result = intersection(result, Areas.from_rings([list(stack.rings(k))]))
    return float(result.area()[0])


@engines
@given(stack=clean_areas(6), data=st.data())
def test_windows_equal_intersections_one_by_one(engine: str, stack: Areas, data: st.DataObject) -> None:
    first = data.draw(st.lists(st.integers(-2, 5), min_size=6, max_size=6))
    last = [data.draw(st.integers(a + 1, 8)) for a in first]
    with using_engine(engine):
        result = window_intersection(stack, np.array(first), np.array(last))
        expected = [one_by_one(stack, a, b) for a, b in zip(first, last, strict=True)]

        assert result.area() == pytest.approx(expected, abs=blur(stack))
        assert is_clean(result)


@engines
def test_wide_windows_over_many_layers_hold_the_narrowest(engine: str) -> None:
    n = 40
    stack = Areas.from_rings([[box(0, 0, 10 + abs(k - 20), 10)] for k in range(n)])
    first = np.maximum(np.arange(n) - 7, 0)
    last = np.minimum(np.arange(n) + 6, n)
    with using_engine(engine):
        result = window_intersection(stack, first, last)

    narrowest = [min(abs(k - 20) for k in range(a, b)) for a, b in zip(first, last, strict=True)]
    assert result.area() == pytest.approx([10 * (10 + w) for w in narrowest])


@engines
def test_windows_that_reach_outside_the_stack_are_empty(engine: str) -> None:
    stack = Areas.from_rings([[box(0, 0, 1, 1)]] * 3)
    k = np.arange(3)
    with using_engine(engine):
        assert window_intersection(stack, k - 1, k + 1).area() == pytest.approx([0, 1, 1])
        assert window_intersection(stack, k, k + 2).area() == pytest.approx([1, 1, 0])
        assert window_intersection(stack, k - 9, k + 9).area() == pytest.approx([0, 0, 0])
        assert window_intersection(Areas.empty(0), k[:0], k[:0]).n_layers == 0


def test_empty_windows_are_refused() -> None:
    with pytest.raises(ValueError, match="window of layer 1 is empty: 2 to 2"):
        window_intersection(Areas.empty(2), np.array([0, 2]), np.array([1, 2]))
    with pytest.raises(ValueError, match="one window per layer"):
        window_intersection(Areas.empty(2), np.array([0]), np.array([1]))


# --- the twins ---


@given(clean_areas(3), clean_areas(3))
def test_the_twins_agree_on_what_areas_have_in_common(a: Areas, b: Areas) -> None:
    results = []
    for engine in ENGINES:
        with using_engine(engine):
            results.append([f(a, b) for f in (union, difference, intersection)])

    for one, other in zip(*results, strict=True):
        assert one.area() == pytest.approx(other.area(), abs=blur(a, b))
        assert is_same(one, other)


@given(areas(3))
def test_the_twins_agree_on_what_rings_wind_around(stack: Areas) -> None:
    results = []
    for engine in ENGINES:
        with using_engine(engine):
            results.append(normalize(stack))

    assert results[0].area() == pytest.approx(results[1].area(), abs=blur(stack))
    assert is_same(*results)


@pytest.mark.parametrize("join", ["miter", "round"])
@given(stack=clean_areas(3), distances=st.lists(st.integers(-12, 12), min_size=3, max_size=3))
def test_the_twins_agree_on_offsets(join: Join, stack: Areas, distances: list[int]) -> None:
    by = np.array(distances) / 8
    results = []
    for engine in ENGINES:
        with using_engine(engine):
            results.append(offset(stack, by, join=join))

    # Chords may lie differently on the circle; GEOS leaves out points that matter less than 1 % of it.
    chords = ROUND_TOLERANCE * float(results[0].ring_length().sum()) if join == "round" else 0.0
    allowed = 1e-3 + 1e-3 * float(stack.area().max()) + chords
    assert results[0].area() == pytest.approx(results[1].area(), abs=allowed)


@given(stack=rectilinear_areas(3), sixteenths=st.sampled_from(range(1, 20, 2)))
def test_the_twins_agree_on_what_is_wide_enough(stack: Areas, sixteenths: int) -> None:
    # No feature of the lattice is exactly twice as wide, where the last digit would decide over all of it.
    results = []
    for engine in ENGINES:
        with using_engine(engine):
            results.append(offset_open(stack, sixteenths / 16))

    assert results[0].area() == pytest.approx(results[1].area(), abs=1e-3)


# --- the choice ---


def test_an_engine_nobody_knows_is_refused_with_the_names_of_both() -> None:
    with pytest.raises(UsageError, match="clipper, planar"):
        load_engine("cgal")
    with pytest.raises(UsageError, match="'cgal'"), using_engine("cgal"):
        pass


def test_the_engine_is_the_one_before_again_after_the_block() -> None:
    with using_engine("planar"), using_engine("clipper"):
        pass

    assert load_engine("clipper") is not load_engine("planar")
    assert normalize(Areas.empty(1)).n_layers == 1


@pytest.mark.parametrize(
    ("chosen", "kernel", "loaded"),
    [
        ("", "off", ["clipper2"]),
        ("planar", "off", ["shapely"]),
        pytest.param("", "required", [], marks=needs_kernel),
    ],
)
def test_the_environment_chooses_and_only_that_engine_is_loaded(
    chosen: str, kernel: str, loaded: list[str]
) -> None:
    code = (
        "import sys; from printer_slicer.geometry import Areas, normalize\n"
        "def engines(): return {'clipper2', 'shapely'} & {name.partition('.')[0] for name in sys.modules}\n"
        "before = engines()\n"
        "normalize(Areas.empty(1))\n"
        "print(*before, *sorted(engines()))"
    )
    environment = {**os.environ, "PRINTER_SLICER_GEOMETRY": chosen, VARIABLE: kernel}
    run = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, check=True)

    assert run.stdout.decode().split() == loaded
