"""The brim holds on to the part where it is asked to, keeps its gap, and is never laid over anything."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer import bead
from printer_slicer.adhesion import adhesion_paths
from printer_slicer.adhesion.brim_ears import find_sharp_corners
from printer_slicer.arrays import Float
from printer_slicer.errors import PartError
from printer_slicer.geometry import Areas
from printer_slicer.geometry.engine import using_engine
from printer_slicer.model import Sections, Toolpaths
from printer_slicer.roles import Role
from tests.adhesion.plates import disc, foot, lines, plastic, plate, ring_of, standing, star
from tests.parts import plain, shapely
from tests.strategies import clean_areas

GAP = float(bead.spacing(0.45, 0.2))
SQUARE = ring_of(0, 0, 10, 10)
FRAME = [ring_of(0, 0, 30, 30), ring_of(6, 6, 24, 24)[::-1]]


def brim(sections: Sections, **changes: Any) -> Toolpaths:
    return adhesion_paths(sections, plain(**changes))


def inside_out(area: Any) -> Any:
    """The holes of an area, as areas."""
    polygons = shapely.get_parts(area)
    return shapely.difference(shapely.union_all([shapely.Polygon(one.exterior) for one in polygons]), area)


@pytest.mark.parametrize("wide", [0.3, 1.0, 2.5, 5.0])
@pytest.mark.parametrize("gap", [0.0, 0.15])
def test_the_brim_begins_at_its_gap_and_is_at_least_as_wide_as_asked_for(wide: float, gap: float) -> None:
    sections = plate([SQUARE])
    paths = brim(sections, brim_width=wide, brim_gap=gap)

    distances = sorted(float(shapely.distance(ring, foot(sections))) for ring in lines(paths, Role.BRIM))
    assert distances[0] == pytest.approx(gap + 0.225, abs=0.01)
    assert np.diff(distances) == pytest.approx(GAP, abs=0.01)
    assert gap + wide <= distances[-1] + 0.225 + 0.02
    assert distances[-1] + 0.225 < gap + wide + 2 * GAP


def test_the_brim_goes_from_far_away_to_the_part() -> None:
    paths = brim(plate([SQUARE]), brim_width=4)

    lengths = [ring.length for ring in lines(paths, Role.BRIM)]
    assert lengths == sorted(lengths, reverse=True)


def test_skirt_comes_before_brim_and_lies_around_it() -> None:
    sections = plate([SQUARE])
    paths = brim(sections, skirt_loops=1, skirt_distance=2, brim_width=3)

    assert paths.role[0] == Role.SKIRT
    distance = shapely.distance(lines(paths, Role.SKIRT)[0], plastic(paths, Role.BRIM))
    assert distance == pytest.approx(2.225, abs=0.02)


@pytest.mark.parametrize(
    ("kind", "outside", "within"),
    [("outer", True, False), ("inner", False, True), ("both", True, True), ("ears", True, False)],
)
def test_the_brim_is_laid_where_it_is_asked_for(kind: str, outside: bool, within: bool) -> None:
    sections = plate(FRAME)
    laid = plastic(brim(sections, brim_width=2, brim_type=kind), Role.BRIM)
    hole = inside_out(foot(sections))

    assert bool(shapely.area(shapely.difference(laid, hole)) > 1) is outside
    assert bool(shapely.area(shapely.intersection(laid, hole)) > 1) is within


@pytest.mark.parametrize("engine", ["clipper", "planar"])
def test_an_inner_brim_fills_a_band_along_the_wall_of_the_hole(engine: str) -> None:
    sections = plate(FRAME)
    with using_engine(engine):
        paths = brim(sections, brim_width=3 * GAP, brim_type="inner")

    sides = [18 - 2 * (0.225 + i * GAP) for i in (2, 1, 0)]
    assert [ring.length for ring in lines(paths, Role.BRIM)] == pytest.approx([4 * s for s in sides], abs=0.1)


def test_a_body_in_a_hole_of_another_has_an_outer_brim_that_keeps_off_the_wall_around_it() -> None:
    sections = plate([*FRAME, ring_of(7, 7, 15, 15)])
    paths = brim(sections, brim_width=3, brim_type="outer", brim_gap=0.1)
    laid = plastic(paths, Role.BRIM)
    hole = shapely.Polygon(ring_of(6, 6, 24, 24))

    within = shapely.intersection(laid, hole)
    assert float(shapely.distance(within, foot(sections))) == pytest.approx(0.1, abs=0.01)
    assert shapely.area(shapely.intersection(within, shapely.Polygon(ring_of(15, 15, 24, 24)))) > 1
    assert not shapely.intersects(
        within, shapely.Polygon(ring_of(19, 6, 24, 24))
    )  # farther than the brim is wide
    assert not paths.closed[paths.role == Role.BRIM].all()  # cut at the wall, on the near side


def test_a_brim_does_not_reach_through_a_thin_wall_into_a_hole() -> None:
    """The neighbour is 0.5 mm from a wall of 1 mm; its brim of 5 mm ends there."""
    sections = plate([[*ring_of(0, 0, 20, 20)], [*ring_of(1, 1, 19, 19)[::-1]], [*ring_of(20.5, 5, 30, 15)]])
    laid = plastic(brim(sections, brim_width=5), Role.BRIM)

    assert not shapely.intersects(laid, shapely.Polygon(ring_of(1, 1, 19, 19)))


def test_brims_of_neighbours_become_one() -> None:
    two = [ring_of(0, 0, 10, 10), ring_of(13, 0, 23, 10)]
    near = brim(plate(two), brim_width=4)
    far = brim(plate([two[0], two[1] + np.array([20.0, 0.0])]), brim_width=4)
    rings = [shapely.Polygon(line) for line in lines(near, Role.BRIM)]

    assert len(lines(far, Role.BRIM)) == 2 * int(np.ceil(4 / GAP))
    assert sum(bool(shapely.contains(ring, foot(plate(two)))) for ring in rings) > 3
    assert shapely.intersection(plastic(near, Role.BRIM), shapely.Polygon(ring_of(10, 1, 13, 9))).area > 20


def test_far_apart_brims_are_laid_one_after_the_other() -> None:
    squares = [SQUARE + np.array([x, y]) for x in (-60.0, 0.0, 50.0) for y in (-50.0, 20.0)]
    paths = brim(plate(squares), brim_width=3)

    middles = np.array([np.round(paths.path(i).mean(axis=0)) for i in range(paths.n_paths)])
    changes = (np.diff(middles, axis=0) != 0).any(axis=1).sum()
    assert changes == len(squares) - 1


@given(clean_areas(1), st.sampled_from(["outer", "inner", "both", "ears"]), st.sampled_from([0.0, 0.3]))
def test_the_brim_never_lies_on_the_part_or_where_it_was_not_asked_for(
    areas: Areas, kind: str, gap: float
) -> None:
    sections = standing(areas)
    paths = brim(sections, brim_width=2, brim_type=kind, brim_gap=gap)
    if paths.n_paths == 0:
        return
    part, centres = foot(sections), shapely.union_all(lines(paths, Role.BRIM))

    assert shapely.is_empty(part) or float(shapely.distance(centres, part)) > gap + 0.225 - 0.01
    within = shapely.intersection(centres, shapely.Polygon(shapely.envelope(part).exterior))
    alone = [one for one in shapely.get_parts(part) if not shapely.intersects(inside_out(part), one)]
    if kind in ("outer", "ears") and len(alone) == len(shapely.get_parts(part)):
        assert shapely.length(shapely.intersection(within, inside_out(part))) < 1e-6
    if kind == "inner":
        assert shapely.length(shapely.difference(centres, inside_out(part))) < 1e-6
    # Nothing lies much farther away than it is wide: the last loop begins within the width.
    points = shapely.points(paths.xy)
    assert float(np.max(shapely.distance(points, part))) < gap + 2 + GAP + 0.225


def test_a_brim_that_leaves_the_bed_is_refused() -> None:
    with pytest.raises(PartError, match="leaves the bed"):
        brim(plate([ring_of(-109, 0, 0, 10)]), brim_width=5)


# Ears


def corners_of(ring: Float, angle: float = 125, scale: float = 2) -> Float:
    return find_sharp_corners(Areas.from_rings([[ring]]), angle, scale)[0]


def rounded(side: float, radius: float) -> Float:
    """A square with rounded corners."""
    quarter = np.linspace(0, np.pi / 2, 12)
    arc = radius * np.column_stack([np.cos(quarter), np.sin(quarter)])
    at = side / 2 - radius
    ways = [np.array([[c, -s], [s, c]]) for c, s in ((1, 0), (0, 1), (-1, 0), (0, -1))]
    return np.concatenate([(arc + at) @ way.T for way in ways])


def test_a_square_has_its_four_corners() -> None:
    assert sorted(map(tuple, corners_of(SQUARE).tolist())) == [(0, 0), (0, 10), (10, 0), (10, 10)]


def test_corners_rounded_off_a_little_count_and_large_curves_do_not() -> None:
    assert len(corners_of(rounded(20, 0.8))) == 4
    assert len(corners_of(rounded(20, 6))) == 0
    assert len(corners_of(disc(5))) == 0
    assert len(corners_of(disc(0.8))) > 1


def test_the_angle_decides_which_corners_are_sharp() -> None:
    turn = 2 * np.pi * np.arange(6) / 6
    hexagon = 12 * np.column_stack([np.cos(turn), np.sin(turn)])  # 120 degrees

    assert len(corners_of(hexagon, angle=125)) == 6
    assert len(corners_of(hexagon, angle=115)) == 0


def test_points_along_straight_sides_and_noise_make_no_corners() -> None:
    fine = np.concatenate(
        [np.linspace(a, b, 400, endpoint=False) for a, b in zip(SQUARE, np.roll(SQUARE, -1, 0), strict=True)]
    )
    noisy = fine + 0.01 * np.sin(np.arange(len(fine)) * 2.399)[:, None]

    assert len(corners_of(noisy)) == 4


def test_only_the_points_of_a_star_get_ears() -> None:
    sections = plate([star(5, 20, 9)])
    paths = brim(sections, brim_width=3, brim_type="ears")
    laid = shapely.get_parts(plastic(paths, Role.BRIM))

    assert len(laid) == 5
    for tip in star(5, 20, 9)[::2]:
        near = min(float(shapely.distance(one, shapely.Point(tip))) for one in laid)
        assert near < 0.01


def test_one_ear_is_laid_after_the_other() -> None:
    paths = brim(plate([star(5, 20, 9)]), brim_width=4, brim_type="ears")

    middle = np.array([paths.path(i).mean(axis=0) for i in range(paths.n_paths)])
    ear = np.argmin(np.hypot(*(middle[:, None] - star(5, 20, 9)[None, ::2]).transpose(2, 0, 1)), axis=1)
    assert (np.diff(ear) != 0).sum() == 4


@given(st.integers(3, 9), st.integers(20, 60), st.sampled_from([0.0, 0.2]), st.integers(0, 62))
def test_every_ear_holds_on_to_its_corner(points: int, inner: int, gap: float, turned: int) -> None:
    c, s = np.cos(turned / 10), np.sin(turned / 10)
    ring = star(points, 15, 15 * inner / 100) @ np.array([[c, -s], [s, c]])
    sections = plate([ring])
    corners = corners_of(ring)
    laid = plastic(brim(sections, brim_width=2.5, brim_type="ears", brim_gap=gap), Role.BRIM)

    assert len(corners) >= points
    reach = gap + int(np.ceil(2.5 / GAP - 1e-6)) * GAP + 0.45
    assert shapely.contains(
        shapely.union_all([shapely.buffer(shapely.Point(at), reach) for at in corners]), laid
    )
    for at in corners:
        assert float(shapely.distance(laid, shapely.Point(at))) == pytest.approx(gap, abs=0.02)
        ear = shapely.difference(shapely.buffer(shapely.Point(at), 2.4), shapely.buffer(foot(sections), gap))
        covered = shapely.area(shapely.intersection(ear, laid)) / shapely.area(ear)
        assert covered > 0.9


def test_no_ear_is_laid_over_a_neighbour() -> None:
    sections = plate([SQUARE, ring_of(10.6, 0, 20, 10)])
    paths = brim(sections, brim_width=4, brim_type="ears")

    centres = shapely.union_all(lines(paths, Role.BRIM))
    assert float(shapely.distance(centres, foot(sections))) > 0.225 - 0.01
