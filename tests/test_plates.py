"""Parts are arranged on plates: apart from each other, on the bed, all of them once."""

from __future__ import annotations

from itertools import combinations
from math import inf

import numpy as np
import pytest
import shapely

import printer_slicer as ps
from printer_slicer.errors import UsageError
from printer_slicer.plates import PART_GAP, measure_room
from printer_slicer.surface.top_view import project_from_above
from tests.parts import box, box_with_hole, joined

PROFILE = ps.load_profile("marlin_220", quality="standard")
TABLE = ps.Mesh(joined([box((4, 4, 20), at=(18, 18, 0)), box((40, 40, 4), at=(0, 0, 20))]).triangles, "table")


def named(name: str, size: tuple[float, float, float]) -> ps.Mesh:
    """Return a box with a name."""
    return ps.Mesh(box(size).triangles, name)


def seen(mesh: ps.Mesh) -> shapely.Geometry:
    """Return a part as seen from above, by shapely."""
    return shapely.union_all([shapely.Polygon(one) for one in mesh.triangles[:, :, :2]])


def split(plate: ps.Mesh) -> list[ps.Mesh]:
    """Return the parts of a plate."""
    return [
        ps.Mesh(plate.triangles[one.first : one.first + one.count], one.name) for one in plate.objects
    ] or [plate]


def test_the_outline_from_above_includes_what_hangs_over_and_leaves_holes_open() -> None:
    frame = ps.Mesh(box_with_hole((30, 30, 6), (20, 20)).triangles)
    assert project_from_above(TABLE).area().sum() == pytest.approx(1600)
    assert project_from_above(frame).area().sum() == pytest.approx(500)


def test_parts_that_overlap_in_their_files_stand_apart_on_the_bed() -> None:
    parts = [TABLE, named("bar", (60, 10, 5)), named("cube", (25, 25, 25)), named("tile", (80, 50, 3))]
    (plate,) = ps.arrange(parts, PROFILE)
    there = split(plate)
    assert [one.name for one in there] == [one.name for one in parts]
    assert all(one.bounds[0, 2] == 0 for one in there)
    for a, b in combinations(there, 2):
        assert seen(a).distance(seen(b)) >= PART_GAP
    low, high = np.array(PROFILE.printer.corners)
    assert (plate.bounds[0, :2] >= low).all()
    assert (plate.bounds[1, :2] <= high).all()
    stages = ps.slice_stages(plate, PROFILE, placement=ps.Placement(as_placed=True))
    assert stages.labels is not None
    assert len(stages.labels.names) == 4


def test_copies_fill_several_plates() -> None:
    tile = named("tile", (100, 100, 2))
    plates = ps.arrange([tile] * 9, PROFILE)
    assert [len(split(plate)) for plate in plates] == [4, 4, 1]


def test_a_part_keeps_its_volume_and_its_height() -> None:
    (plate,) = ps.arrange([TABLE], PROFILE)
    assert plate.volume == pytest.approx(TABLE.volume)
    assert plate.height == TABLE.height


def test_a_brim_lies_between_the_parts() -> None:
    wide = ps.profile_with(PROFILE, {"brim_width": 10})
    (plate,) = ps.arrange([named("one", (20, 20, 5)), named("two", (20, 20, 5))], wide)
    one, two = split(plate)
    assert seen(one).distance(seen(two)) >= PART_GAP + 20


def test_a_raft_counts_as_a_part_of_the_outline() -> None:
    on_raft = ps.profile_with(PROFILE, {"raft_height": 1, "raft_margin": 7})
    (plate,) = ps.arrange([named("one", (20, 20, 5)), named("two", (20, 20, 5))], on_raft)
    one, two = map(seen, split(plate))
    assert one.distance(two) >= PART_GAP + 14
    rafts = shapely.union_all([one, two]).buffer(14, join_style="mitre").buffer(-7)  # as the raft is made
    assert len(shapely.get_parts(rafts)) == 2


def test_a_part_as_large_as_the_bed_fits() -> None:
    (plate,) = ps.arrange([named("sheet", (220, 220, 1))], PROFILE)
    assert plate.bounds[0, :2].tolist() == pytest.approx([0, 0])


def test_a_part_larger_than_the_bed_is_named() -> None:
    with pytest.raises(
        ps.PrinterSlicerError,
        match=r"beam: the part is .* mm in x .* too large .* rotated by 45 degrees",
    ):
        ps.arrange([named("cube", (20, 20, 20)), named("beam", (400, 10, 10))], PROFILE)
    wide = ps.profile_with(PROFILE, {"brim_width": 10})
    with pytest.raises(
        ps.PrinterSlicerError, match=r"sheet: the part with its brim is 1.* mm in x"
    ) as caught:
        ps.arrange([named("sheet", (215, 215, 1))], wide)
    assert "without brim, raft or supports" in str(caught.value)


def test_a_part_higher_than_the_printer_is_named() -> None:
    with pytest.raises(ps.PrinterSlicerError, match=r"mast: the part is 50 mm too high"):
        ps.arrange([named("cube", (20, 20, 20)), named("mast", (9, 9, PROFILE.printer.bed_z + 50))], PROFILE)


@pytest.mark.parametrize("gap", [-1, inf, float("nan")])
def test_a_gap_that_is_no_distance_is_rejected(gap: float) -> None:
    with pytest.raises(ps.PrinterSlicerError, match="gap"):
        ps.arrange([TABLE], PROFILE, gap=gap)


def test_a_gap_larger_than_the_bed_puts_each_part_on_a_plate() -> None:
    assert len(ps.arrange([named("box", (10, 10, 5))] * 2, PROFILE, gap=1e9)) == 2


def test_a_gap_that_is_no_number_is_rejected() -> None:
    with pytest.raises(UsageError, match="must be a number, not a value of type str"):
        ps.arrange([named("box", (10, 10, 5))], PROFILE, gap="6")  # type: ignore[arg-type]


def test_no_parts_are_rejected() -> None:
    with pytest.raises(ps.PrinterSlicerError, match="no part to arrange"):
        ps.arrange([], PROFILE)


CLIPS = {"printer.excluded_areas": ["0x0 220x30", "190x30 220x30 220x60"], "printer.bed_margin": 5}


def test_parts_stay_off_the_margin_and_the_excluded_areas() -> None:
    clipped = ps.profile_with(PROFILE, CLIPS)
    excluded = shapely.union_all([shapely.Polygon(one) for one in clipped.printer.excluded_polygons])
    (plate,) = ps.arrange([named("tile", (60, 60, 2))] * 6, clipped)
    for one in split(plate):
        assert shapely.box(5, 5, 215, 215).covers(seen(one))
        assert not seen(one).buffer(-1e-6).intersects(excluded)
    assert ps.slice_stages(plate, clipped, placement=ps.Placement(as_placed=True)).program.n_moves
    with pytest.raises(
        ps.PrinterSlicerError, match=r"sheet: the part is about \d+ mm too large to fit beside"
    ):
        ps.arrange([named("sheet", (200, 200, 1))], clipped)
    with pytest.raises(ps.PrinterSlicerError, match=r"sheet: the part is 5 mm in x and 5 mm in y too large"):
        ps.arrange([named("sheet", (215, 215, 1))], clipped)


def test_a_single_part_moves_to_the_middle_as_far_as_excluded_areas_allow() -> None:
    (plate,) = ps.arrange([named("tile", (60, 60, 2))], ps.profile_with(PROFILE, CLIPS))
    assert (plate.bounds[0] + plate.bounds[1])[:2] / 2 == pytest.approx((110, 110))


def test_a_placed_part_in_an_excluded_area_or_the_margin_is_rejected() -> None:
    clipped = ps.profile_with(PROFILE, CLIPS)
    tile = named("tile", (60, 60, 2))
    for center, message in (((110, 40), "in an excluded area .* near x 110 y 20, over 60 x 20 mm"),):
        with pytest.raises(ps.PrinterSlicerError, match=message):
            ps.place(tile, clipped.printer, ps.Placement(center=center))
    with pytest.raises(ps.PrinterSlicerError, match="from x 3 to 63 mm, but the bed without its margin"):
        ps.place(tile, clipped.printer, ps.Placement(center=(33, 110)))
    assert ps.place(tile, clipped.printer, ps.Placement(center=(110, 61))).n_facets


def test_skirt_and_brim_stay_out_of_excluded_areas() -> None:
    tile, at = named("tile", (60, 60, 2)), ps.Placement(center=(110, 62))
    plain = {"skirt_loops": 1, "skirt_distance": 5}
    free, clipped = (
        ps.slice_stages(tile, ps.profile_with(PROFILE, plain | more), placement=at) for more in ({}, CLIPS)
    )
    assert (free.toolpaths.role == ps.Role.SKIRT).any()
    assert not (clipped.toolpaths.role == ps.Role.SKIRT).any()
    with pytest.raises(ps.PrinterSlicerError, match="enters an excluded area"):
        ps.slice_stages(tile, ps.profile_with(PROFILE, {"brim_width": 5} | CLIPS), placement=at)


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("excluded_areas", "0x0", "excluded_areas"),
        ("excluded_areas", "0x0 0x9", "has no area"),
        ("excluded_areas", "a b", "excluded_areas"),
        ("bed_margin", 110, "leave no room"),
    ],
)
def test_areas_and_margins_that_make_no_sense_are_rejected(key: str, value: object, message: str) -> None:
    with pytest.raises(ps.PrinterSlicerError, match=message):
        ps.load_profile("marlin_220", changes={f"printer.{key}": value})


@pytest.mark.parametrize("style", ["columns", "tree"])
@pytest.mark.parametrize("brim", [0, 4])
def test_supports_and_their_brim_stand_within_the_room_of_their_part(style: str, brim: float) -> None:
    profile = ps.profile_with(
        PROFILE, {"support": style, "brim_width": brim, "skirt_loops": 0, "layer_height": 0.3}
    )
    (plate,) = ps.arrange([TABLE, named("cube", (20, 20, 20)), TABLE], profile)
    stages = ps.slice_stages(plate, profile, placement=ps.Placement(as_placed=True))
    parts = split(plate)
    rooms = [seen(part).buffer(measure_room(part, profile)) for part in parts]
    assert measure_room(TABLE, profile) > measure_room(parts[1], profile) + 3
    assert all(one.distance(other) >= PART_GAP - 0.05 for one, other in combinations(rooms, 2))
    paths = stages.toolpaths
    chosen = np.isin(paths.role, [ps.Role.SUPPORT, ps.Role.SUPPORT_INTERFACE, ps.Role.BRIM])
    assert chosen.any()
    points = shapely.points(paths.take(np.flatnonzero(chosen)).xy)
    assert shapely.union_all(rooms).buffer(0.02).covers(points).all()


def test_a_part_has_room_for_its_own_supports_only() -> None:
    own = ps.profile_with(PROFILE, {"overrides": "table:support=columns"})
    other = ps.profile_with(PROFILE, {"overrides": "cube:support=columns"})
    assert measure_room(TABLE, own) > 0
    assert measure_room(TABLE, other) == 0
