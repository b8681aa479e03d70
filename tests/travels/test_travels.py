"""Ways from path to path: inside where that is possible, retracted where they leave the part."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer.geometry import Areas
from printer_slicer.model import LayerPlan, Sections, Toolpaths
from printer_slicer.roles import Role
from printer_slicer.travels import measure_detour_reach, travel
from printer_slicer.travels.detour_limit import detour_limits
from tests.parts import profile, shape, shapely
from tests.strategies import clean_areas
from tests.travels.places import length_of, places, sections_of, travelled, way

SQUARE = shapely.box(0, 0, 40, 40)
WITH_HOLE = SQUARE.difference(shapely.box(10, 10, 30, 30))
U_SHAPE = SQUARE.difference(shapely.box(15, 10, 25, 40))
TWO = shapely.union(shapely.box(0, 0, 10, 10), shapely.box(14, 0, 24, 10))
seeds = st.integers(0, 2**32 - 1)


def test_a_way_that_stays_inside_is_straight_and_not_retracted() -> None:
    _, travels = travelled(WITH_HOLE, (2, 2), (38, 2))

    assert travels.start.tolist() == [0, 0, 0]
    assert not travels.retract.any()
    assert not travels.crossings.any()


def test_a_way_across_a_hole_goes_around_it() -> None:
    paths, travels = travelled(WITH_HOLE, (5, 19), (35, 19))
    line = way(paths, travels, 1)

    assert travels.crossings.tolist() == [0, 0]
    assert not travels.retract.any()
    assert line[:, 1].min() > 8.9  # below the hole: the shorter side
    assert line[:, 1].max() <= 19
    # Around two corners: 5, 19 -> 10, 10 -> 30, 10 -> 35, 19, a bead's width away from them.
    assert length_of(line) == pytest.approx(2 * np.hypot(5, 9) + 20, rel=0.04)
    assert shapely.LineString(line[1:-1]).distance(shapely.box(10, 10, 30, 30)) == pytest.approx(
        0.45, abs=0.2
    )


def test_a_way_across_a_bay_follows_the_outline() -> None:
    paths, travels = travelled(U_SHAPE, (12, 20), (28, 20))
    line = way(paths, travels, 1)

    assert travels.crossings.tolist() == [0, 0]
    assert U_SHAPE.contains(shapely.LineString(line))
    assert length_of(line) == pytest.approx(2 * np.hypot(3, 10) + 10, rel=0.06)


def test_a_way_around_a_wall_stays_within_the_reach_of_detours() -> None:
    three = shapely.union_all([shapely.box(x, 0, x + wide, 8) for x, wide in ((0, 5), (7, 2), (11, 5))])
    paths, travels = travelled(three, (4, 7), (12, 7))
    line = way(paths, travels, 1)

    assert travels.crossings[1] == 2  # not 4, because it does not cross the wall between
    assert 0 < line[:, 1].max() - 8 <= measure_detour_reach(profile())
    assert measure_detour_reach(profile(avoid_crossing=False)) == 0


def test_a_way_around_a_wall_stays_on_the_bed() -> None:
    depth = profile().printer.bed_y
    three = shapely.union_all(
        [shapely.box(x, depth - 8, x + wide, depth) for x, wide in ((0, 5), (7, 2), (11, 5))]
    )
    paths, travels = travelled(three, (4, depth - 1), (12, depth - 1))

    assert way(paths, travels, 1)[:, 1].max() <= depth


def test_a_way_that_would_graze_a_corner_keeps_away_from_it() -> None:
    """0.03 mm beside a corner of the hole it bends; 3 mm beside it it is straight."""
    for off, bends in ((0.03, 1), (3.0, 0)):
        by = off / np.sqrt(2)
        paths, travels = travelled(WITH_HOLE, (6 - by, 14 - by), (14 - by, 6 - by))
        drawn = shapely.LineString(way(paths, travels, 1))

        assert travels.crossings.tolist() == [0, 0]
        assert int(np.diff(travels.start)[1]) == bends
        assert drawn.distance(shapely.Point(10, 10)) >= 0.2


def test_ways_between_pieces_are_straight_and_retracted() -> None:
    paths, travels = travelled(TWO, (5, 5), (19, 5))

    assert travels.crossings.tolist() == [0, 2]
    assert travels.retract.tolist() == [False, True]
    assert length_of(way(paths, travels, 1)) == 14


def test_a_way_to_another_piece_leaves_out_what_stands_between() -> None:
    """Three pieces in a row: around the one in the middle where it can be passed closely."""
    row = shapely.union_all([shapely.box(x, 0, x + 4, high) for x, high in ((0, 30), (10, 16), (20, 30))])
    paths, travels = travelled(row, (2, 15), (22, 15))

    assert travels.crossings.tolist() == [0, 2]
    assert travels.retract.tolist() == [False, True]
    assert not shapely.LineString(way(paths, travels, 1)).intersects(shapely.box(10, 0, 14, 16))


def test_what_stands_between_and_is_long_is_crossed() -> None:
    row = shapely.union_all([shapely.box(x, 0, x + 4, 30) for x in (0, 10, 20)])
    _, travels = travelled(row, (2, 15), (22, 15))

    assert travels.crossings.tolist() == [0, 4]
    assert travels.retract.tolist() == [False, True]


def test_ways_may_be_as_much_longer_as_is_asked_for() -> None:
    ends = (13, 38), (27, 38)  # around the bay: some 53 mm longer
    for detour, crossings in ((0, 2), (40, 2), (60, 0)):
        _, travels = travelled(U_SHAPE, *ends, printer="corexy_klipper", max_detour=detour)

        assert travels.crossings.tolist() == [0, crossings]
        assert travels.retract.tolist() == [False, crossings > 0]


def test_ways_are_longer_where_that_is_quicker_than_a_retraction() -> None:
    ends = (13, 30), (27, 30)
    _, slow = travelled(U_SHAPE, *ends, max_detour=0, retract_speed=5)
    _, quick = travelled(U_SHAPE, *ends, max_detour=0, retract_speed=100, retract_length=0.1)

    assert not slow.retract.any()
    assert quick.retract.tolist() == [False, True]


def test_time_is_what_decides() -> None:
    """At 100 mm/s and 1000 mm/s² 30 mm take 0.4 s; 0.5 s of retraction are worth 50 mm."""
    wanted = profile(
        "marlin_220",
        max_detour=0,
        retract_length=5,
        retract_speed=25,
        deretract_speed=25,
        retract_acceleration=500,
        travel_acceleration=1000,
        max_acceleration_x=1000,
        max_acceleration_y=1000,
        **{"speeds.travel": 100},
    )

    assert detour_limits(np.array([30.0]), wanted) == pytest.approx(30 + 100 * 2 * (5 / 25 + 25 / 500))


def test_nothing_is_avoided_where_that_is_not_asked_for() -> None:
    _, travels = travelled(WITH_HOLE, (5, 19), (35, 19), avoid_crossing=False)

    assert travels.start.tolist() == [0, 0, 0]
    assert travels.crossings.tolist() == [0, 2]
    assert travels.retract.tolist() == [False, True]


def test_a_printer_that_does_not_retract_still_goes_around() -> None:
    _, travels = travelled(WITH_HOLE, (5, 19), (35, 19), (5, 19), retract_length=0)

    assert not travels.crossings.any()
    assert not travels.retract.any()


def test_ways_that_leave_the_part_are_retracted_however_short() -> None:
    near = shapely.union(shapely.box(0, 0, 10, 10), shapely.box(10.5, 0, 20, 10))
    _, travels = travelled(near, (9.7, 5), (10.8, 5), (12, 5), retract_before_travel=1.5)

    assert travels.crossings.tolist() == [0, 2, 0]
    assert travels.retract.tolist() == [False, True, False]


def test_long_ways_inside_are_retracted_where_that_is_asked_for() -> None:
    ends = (2, 2), (12, 2), (38, 2)
    _, usual = travelled(SQUARE, *ends)
    _, asked = travelled(SQUARE, *ends, retract_inside=20)

    assert usual.retract.tolist() == [False, False, False]
    assert asked.retract.tolist() == [False, False, True]


def test_thin_walls_are_passed() -> None:
    """Two rooms and a wall of 0.5 mm between them, around a corner."""
    wall = [
        shapely.box(0, 0, 8, 8),
        shapely.box(7, 3, 20, 3.5),
        shapely.box(19.5, 3, 20, 20),
        shapely.box(16, 18, 26, 26),
    ]
    area = shapely.union_all(wall)
    paths, travels = travelled(area, (4, 6), (21, 24))
    line = shapely.LineString(way(paths, travels, 1))

    assert travels.crossings.tolist() == [0, 0]
    assert area.contains(line)
    # In the middle of the wall, about: half of it from both sides.
    assert area.boundary.distance(shapely.line_interpolate_point(line, 12.0)) > 0.1


def test_beads_in_the_margin_are_led_in() -> None:
    """Ends on the outline itself, and nearer to it than ways come."""
    for depth in (0.0, 0.02, 0.1, 0.225):
        paths, travels = travelled(WITH_HOLE, (depth, 20), (10 - depth, 20), (30 + depth, 20))

        assert travels.crossings.tolist() == [0, 0, 0], depth
        assert length_of(way(paths, travels, 2)) < 20 + 2 * 10 + 3


def test_ways_to_a_new_layer_follow_its_section() -> None:
    sections = sections_of(SQUARE, WITH_HOLE)
    paths = places(sections, [(5, 19), (35, 19), (5, 19)], [0, 0, 1])
    travels = travel(paths, sections, profile())

    assert np.diff(travels.start)[:2].tolist() == [0, 0]
    assert np.diff(travels.start)[2] >= 2
    assert not travels.crossings.any()


# --- top skin ---


def skinned(
    last: tuple[float, float], role: Role = Role.INTERNAL_INFILL, over: Role = Role.TOP_SOLID_INFILL
) -> Any:
    """Ten lines side by side, printed one after the other, then a way to `last`."""
    sections = sections_of(SQUARE)
    lines = [[(5, 10 + y), (30, 10 + y)][:: 1 if y % 2 else -1] for y in range(10)]
    xy = np.array([point for line in lines for point in line] + [last, last], np.float64)
    paths = Toolpaths.gathered(
        sections.plan,
        xy=xy,
        size=np.full(11, 2),
        layer=np.zeros(11, np.int64),
        role=np.array([int(over)] * 10 + [int(role)]),
        width=np.full(len(xy), 0.45),
        closed=False,
    )
    return travel(paths, sections, profile())


def test_ways_over_top_skin_are_retracted() -> None:
    over, beside = skinned((20, 2)), skinned((35, 30))

    assert np.flatnonzero(over.retract).tolist() == [10]
    assert over.crossings[10] == 0
    assert not beside.retract.any()


def test_skin_that_is_yet_to_be_ironed_may_be_passed() -> None:
    assert not skinned((20, 2), Role.IRONING).retract.any()
    assert skinned((20, 2), Role.IRONING, over=Role.IRONING).retract.any()


def test_other_beads_may_be_passed() -> None:
    assert not skinned((20, 2), over=Role.SOLID_INFILL).retract.any()


# --- nothing to do ---


@pytest.mark.parametrize("points", [[], [(5, 5)], [(5, 5), (5, 5)]])
def test_few_paths_and_ways_of_no_length(points: list[tuple[float, float]]) -> None:
    sections = sections_of(SQUARE)
    travels = travel(places(sections, points), sections, profile())

    assert travels.n_travels == len(points)
    assert travels.start.tolist() == [0] * (len(points) + 1)
    assert not travels.retract.any()


def test_sections_without_anything_are_never_crossed() -> None:
    sections = Sections(LayerPlan.from_tops(np.array([0.2])), Areas.empty(1))
    travels = travel(places(sections, [(1, 1), (30, 30)]), sections, profile())

    assert not travels.crossings.any()


def test_ways_outside_of_the_part_go_around_it() -> None:
    """From loop to loop of a skirt, say."""
    paths, travels = travelled(SQUARE, (-5, 38), (20, 45))
    line = shapely.LineString(way(paths, travels, 1))

    assert travels.crossings.tolist() == [0, 0]
    assert not line.intersects(SQUARE)


def test_slivers_and_rings_that_touch_do_no_harm() -> None:
    rings = [
        np.array([(0, 0), (20, 0), (20, 20), (0, 20)], float),
        np.array([(20, 20), (40, 20), (40, 40), (20, 40)], float),  # touches at a corner
        np.array([(50, 0), (90, 0), (90, 0.05)], float),  # thinner than anything
    ]
    sections = Sections(LayerPlan.from_tops(np.array([0.2])), Areas.from_rings([rings]))
    travels = travel(places(sections, [(10, 10), (30, 30), (70, 0.01), (10, 5)]), sections, profile())

    assert travels.crossings[1:].min() >= 1 or travels.retract[1:].all()
    assert travels.retract[1:].all()


# --- what always holds ---


@given(areas=clean_areas(2), seed=seeds, detour=st.sampled_from([0.0, 10.0, 1000.0]))
def test_ways_keep_their_promises(areas: Areas, seed: int, detour: float) -> None:
    rng = np.random.default_rng(seed)
    points, layer = rng.uniform(-15, 15, (24, 2)), np.sort(rng.integers(0, 2, 24))
    sections = Sections(LayerPlan.from_tops(np.array([0.2, 0.5])), areas)
    paths, wanted = places(sections, points, layer), profile(max_detour=detour)
    travels = travel(paths, sections, wanted)

    assert travels.n_travels == paths.n_paths
    assert (np.diff(travels.start) >= 0).all()
    assert travels.start[-1] == len(travels.xy)
    solids = [shape(areas, k) for k in range(2)]
    for index in range(1, paths.n_paths):
        line = way(paths, travels, index)
        drawn = shapely.LineString(line)
        solid, straight = solids[layer[index]], length_of(line[[0, -1]])
        crossed = shapely.get_num_coordinates(shapely.intersection(drawn, solid.boundary))
        legs = [shapely.LineString(leg) for leg in np.stack([line[:-1], line[1:]], axis=1)]
        rings = [shapely.LinearRing(ring) for ring in areas.rings(layer[index])]
        hits = sum(
            shapely.get_num_coordinates(shapely.intersection(leg, ring)) for leg in legs for ring in rings
        )
        assert travels.crossings[index] == hits
        assert (crossed == 0) == (hits == 0)
        if hits == 0 and solid.contains(shapely.Point(line[0])):
            assert solid.buffer(1e-9).contains(drawn)
        if hits == 0 and len(line) > 2:
            # Outside of the part ways are longer by no more than the tolls they save.
            assert length_of(line) <= float(detour_limits(np.array([straight]), wanted)[0]) + 30
        assert travels.retract[index] == (hits > 0)


@given(areas=clean_areas(1), seed=seeds)
def test_avoiding_never_crosses_more(areas: Areas, seed: int) -> None:
    points = np.random.default_rng(seed).uniform(-15, 15, (24, 2))
    sections = Sections(LayerPlan.from_tops(np.array([0.2])), areas)
    paths = places(sections, points)
    avoiding, straight = (travel(paths, sections, profile(avoid_crossing=wanted)) for wanted in (True, False))

    assert (avoiding.crossings <= straight.crossings).all()
    unchanged = (straight.crossings > 0) & (avoiding.crossings == straight.crossings)
    assert (np.diff(avoiding.start)[unchanged] == 0).all()


@given(areas=clean_areas(1), seed=seeds, by=st.tuples(st.integers(-90, 90), st.integers(-90, 90)))
def test_ways_move_with_the_part(areas: Areas, seed: int, by: tuple[int, int]) -> None:
    points = np.random.default_rng(seed).uniform(95, 125, (12, 2))
    plan = LayerPlan.from_tops(np.array([0.2]))
    here, there = (
        Sections(plan, Areas(areas.xy + 110 + shift, areas.ring_start, areas.ring_layer, 1))
        for shift in ((0, 0), by)
    )
    one = travel(places(here, points), here, profile())
    other = travel(places(there, points + by), there, profile())

    assert one.crossings.tolist() == other.crossings.tolist()
    assert one.retract.tolist() == other.retract.tolist()
