"""Arranged parts keep their distance and stay on their plate, judged by shapely."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import affinity

from benchmarks.arranging import check_random_plate
from printer_slicer.arranging import Arrangement, FreeArea, arrange_outlines
from printer_slicer.arranging.footprints import find_touched_cells
from printer_slicer.errors import PartError
from printer_slicer.geometry import Areas
from printer_slicer.geometry.raster import CellGrid
from tests.effort import examples

ROOM = FreeArea(np.zeros(2), np.full(2, 100.0), Areas.empty(1))
KINDS = ("box", "angle", "frame", "triangle")


def shape(kind: str, width: float, depth: float) -> shapely.Polygon:
    """Return a part as seen from above."""
    beam = min(width, depth) / 4
    box = shapely.box(0, 0, width, depth)
    if kind == "angle":
        return box.difference(shapely.box(beam, beam, width, depth))
    if kind == "frame":
        return box.difference(shapely.box(beam, beam, width - beam, depth - beam))
    return shapely.Polygon([(0, 0), (width, 0), (width / 3, depth)]) if kind == "triangle" else box


def areas(polygon: shapely.Polygon) -> Areas:
    """Return a polygon as areas of one layer."""
    polygon = shapely.orient_polygons(polygon)
    rings = [polygon.exterior, *polygon.interiors]
    return Areas.from_rings([[shapely.get_coordinates(ring)[:-1] for ring in rings]])


def placed(arrangement: Arrangement, polygons: list[shapely.Polygon]) -> list[shapely.Polygon]:
    """Return the polygons at their places."""
    rows = zip(polygons, arrangement.angle, arrangement.shift, strict=True)
    return [affinity.translate(affinity.rotate(one, angle, origin=(0, 0)), *by) for one, angle, by in rows]


def arrange(polygons: list[shapely.Polygon], gap: float, room: FreeArea = ROOM) -> Arrangement:
    """Arrange polygons; they are named by their numbers."""
    return arrange_outlines(list(map(areas, polygons)), list(map(str, range(len(polygons)))), room, gap)


SHAPES = st.lists(
    st.builds(shape, st.sampled_from(KINDS), st.floats(5, 70), st.floats(5, 70)), min_size=1, max_size=6
)


@given(SHAPES, st.floats(0.5, 8))
@settings(max_examples=examples(8))
def test_parts_keep_the_gap_and_stay_on_the_plate(polygons: list[shapely.Polygon], gap: float) -> None:
    found = arrange(polygons, gap)
    there = placed(found, polygons)
    for a, b in combinations(range(len(there)), 2):
        if found.plate[a] == found.plate[b]:
            assert there[a].distance(there[b]) >= gap
    assert all(shapely.box(-1e-6, -1e-6, 100 + 1e-6, 100 + 1e-6).contains(one) for one in there)


def test_the_same_parts_get_the_same_places() -> None:
    polygons = [shape(kind, 30 + 9 * n, 20 + 7 * n) for n, kind in enumerate(KINDS)]
    one, other = arrange(polygons, 4), arrange(polygons, 4)
    assert (one.plate == other.plate).all()
    assert (one.shift == other.shift).all()
    assert (one.angle == other.angle).all()


def test_a_part_stands_in_the_hole_of_another() -> None:
    found = arrange([shape("frame", 90, 90), shape("box", 30, 30)], 5)
    assert found.n_plates == 1


def test_a_part_stands_in_the_corner_of_another() -> None:
    found = arrange([shape("angle", 98, 98), shape("angle", 98, 98), shape("angle", 68, 68)], 1)
    assert found.n_plates < 3


def test_a_part_that_fits_only_diagonally_is_rotated() -> None:
    found = arrange([shape("box", 120, 8)], 5)
    assert found.angle[0] % 90 == 45


def test_a_part_as_wide_as_a_plate_that_is_no_multiple_of_cells_fits() -> None:
    room = FreeArea(np.zeros(2), np.array([235.0, 225.0]), Areas.empty(1))
    polygons = [shape("box", 100, 224.9), shape("box", 100, 10)]
    there = placed(arrange(polygons, 3, room), polygons)
    assert all(shapely.box(0, 0, 235, 225).buffer(1e-6).contains(one) for one in there)


def test_a_single_part_stands_in_the_middle() -> None:
    found = arrange([shape("box", 20, 10)], 5)
    middle = placed(found, [shape("box", 20, 10)])[0].centroid
    assert (middle.x, middle.y) == pytest.approx((50, 50))


def test_parts_stay_out_of_excluded_areas() -> None:
    clips = shapely.box(0, 0, 100, 40)
    room = FreeArea(ROOM.low, ROOM.high, areas(clips))
    polygons = [shape("box", 40, 40), shape("triangle", 40, 30)]
    there = placed(arrange(polygons, 3, room), polygons)
    assert not any(one.intersects(clips) for one in there)


def test_a_part_that_is_too_large_is_named_with_the_missing_mm() -> None:
    with pytest.raises(
        PartError,
        match=r"1 is 4 mm in x and 50 mm in y too large",
    ):
        arrange([shape("box", 10, 10), shape("box", 104, 150)], 3)


def test_a_part_that_fits_nowhere_beside_excluded_areas_is_named() -> None:
    room = FreeArea(ROOM.low, ROOM.high, areas(shapely.box(40, 0, 60, 100)))
    with pytest.raises(PartError, match=r"1 is about \d+ mm too large to fit beside the excluded areas"):
        arrange([shape("box", 10, 10), shape("box", 50, 50)], 3, room)


@given(st.builds(shape, st.sampled_from(KINDS), st.floats(2, 20), st.floats(2, 20)), st.floats(0, 360))
def test_touched_cells_are_those_that_intersect_the_part(polygon: shapely.Polygon, angle: float) -> None:
    turned = affinity.rotate(polygon, angle, origin=(0, 0))
    grid = CellGrid(-30.0, -30.0, 1.5, 40, 40)
    touched = find_touched_cells(areas(turned), grid)
    x, y = np.meshgrid(grid.x + 1.5 * np.arange(40), grid.y + 1.5 * np.arange(40))
    cells = shapely.box(x, y, x + 1.5, y + 1.5)
    deep = shapely.intersects(cells, turned.buffer(-1e-6))
    assert touched[deep].all()
    assert not touched[~shapely.intersects(cells, turned.buffer(1e-6))].any()


@pytest.mark.parametrize("seed", range(50))
def test_random_plates_keep_the_exact_distance(seed: int) -> None:
    assert check_random_plate(seed) >= 0
