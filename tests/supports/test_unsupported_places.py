"""What stays without support is listed, with its place, its area, how far it reaches, and the reason."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from benchmarks.support_parts import figure, turned
from printer_slicer.model import Mesh, Overhangs, Sections, Supports, Toolpaths, UnsupportedPlace
from printer_slicer.pipeline import slice_stages
from printer_slicer.profile import Profile, load_profile
from printer_slicer.support_times import measure_group_times
from printer_slicer.supports import styles
from printer_slicer.supports.styles import PrintedSupports, make_supports
from printer_slicer.supports.support_layers import plan_support_layers
from printer_slicer.supports.unsupported_places import UnsupportedReasons, list_unsupported_places
from tests.parts import box, joined, prism
from tests.supports.by_stages import prepared
from tests.supports.shapes import hook, mushroom, round_body, sphere_on_bed, tee, tub

SHAPES = {"tee": tee, "hook": hook, "mushroom": mushroom, "sphere": sphere_on_bed}
NOTHING = UnsupportedReasons((), np.zeros((0, 3)))


def supported(overhangs: Overhangs, sections: Sections, profile: Profile) -> PrintedSupports:
    plan = plan_support_layers(overhangs, profile)
    return make_supports(overhangs, plan, sections, profile, measure_group_times)


@cache
def made(name: str, style: str = "columns") -> tuple[Supports, Toolpaths, Overhangs, Sections, Profile]:
    overhangs, _, sections, profile = prepared(SHAPES[name](), support=style)
    printed = supported(overhangs, sections, profile)
    return printed.supports, printed.paths, overhangs, sections, profile


def bare_of(mesh: Mesh, **changes: object) -> tuple[tuple[UnsupportedPlace, ...], Overhangs]:
    overhangs, _, sections, profile = prepared(mesh, **changes)  # type: ignore[arg-type]
    return supported(overhangs, sections, profile).supports.unsupported, overhangs


@pytest.mark.parametrize("style", ["columns", "tree"])
@pytest.mark.parametrize("name", ["tee", "hook", "mushroom"])
def test_nothing_is_bare_under_usual_parts(name: str, style: str) -> None:
    assert made(name, style)[0].unsupported == ()


def test_without_beads_all_that_hangs_is_bare() -> None:
    _, paths, overhangs, sections, profile = made("tee")
    none = paths.take(np.zeros(0, np.int64))

    bare = list_unsupported_places(overhangs, none, sections, profile, NOTHING)

    assert len(bare) == 2  # arms
    assert sum(place.area for place in bare) == pytest.approx(overhangs.area.area().sum(), rel=0.02)
    assert [place.z for place in bare] == pytest.approx([40.0, 40.0])
    assert [place.free_distance for place in bare] == pytest.approx([25.0, 25.0], abs=0.3)
    assert not any(place.is_island for place in bare)


def test_half_of_the_beads_leave_half_bare() -> None:
    _, paths, overhangs, sections, profile = made("tee")
    middle = float(sections.solid.xy[:, 0].mean())
    left = np.flatnonzero(np.minimum.reduceat(paths.xy[:, 0], paths.start[:-1]) < middle)

    (place,) = list_unsupported_places(overhangs, paths.take(left), sections, profile, NOTHING)

    assert place.area == pytest.approx(overhangs.area.area().sum() / 2, rel=0.02)
    assert place.x > middle + 5


def test_an_island_without_a_bead_comes_first() -> None:
    _, paths, overhangs, sections, profile = made("hook")
    none = paths.take(np.zeros(0, np.int64))

    first, *others = list_unsupported_places(overhangs, none, sections, profile, NOTHING)

    assert first.is_island
    assert first.z == pytest.approx(15.0, abs=0.3)
    assert not any(place.is_island for place in others)


def test_what_is_right_above_the_bed_lies_on_it() -> None:
    for style in ("columns", "tree"):
        assert all(place.z > 0.3 for place in made("sphere", style)[0].unsupported)


def test_places_outside_the_bed_say_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(styles, "_ADDED_STYLES", ())  # branches reach farther
    size = 220.0  # mm, the bed is as large
    wide = joined([box((10, 10, 20), (0, 0, 0)), box((10, size + 20, 2), (0, -size / 2 - 5, 20))])
    bare, overhangs = bare_of(wide)

    assert bare
    assert {place.reason for place in bare} == {"its support would lie outside the bed"}
    assert sum(place.area for place in bare) < 0.2 * overhangs.area.area().sum()


def test_places_over_the_part_say_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(styles, "_ADDED_STYLES", ())  # branches reach from the bed over the part
    plates = [box((30, 30, 2), (0, 0, z)) for z in (0, 20)]
    bare, _ = bare_of(joined([*plates, box((4, 30, 21), (0, 0, 1))]), support_on_bed_only=True)

    assert {place.reason for place in bare} == {"its support would stand on the part"}
    assert sum(place.area for place in bare) == pytest.approx(26 * 30, rel=0.15)


def test_places_that_trees_could_only_reach_from_the_part_say_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(styles, "_ADDED_STYLES", ())
    bare, _ = bare_of(tub(), support="tree", support_on_bed_only=True)

    assert {place.reason for place in bare} == {
        "no support reaches this place from the bed without touching the part"
    }


def test_where_beads_were_taken_out_the_reason_is_that() -> None:
    _, paths, overhangs, sections, profile = made("tee")
    none = paths.take(np.zeros(0, np.int64))
    bead = np.array([[*overhangs.area.xy.max(axis=0), 39.8]])

    bare = list_unsupported_places(overhangs, none, sections, profile, UnsupportedReasons((), bead))

    assert {place.reason for place in bare} == {
        "nothing below carries its support",
        "no support reaches this place without touching the part",
    }


@pytest.mark.parametrize("share", [0.25, 0.5])
def test_areas_do_not_depend_on_heights_of_layers(share: float) -> None:
    """A cone on its tip, of which beads carry the lower part only."""
    cone = round_body([(2.0, 0.0), (2.0, 10.0), (14.0, 16.0), (14.0, 18.0)])
    areas = []
    for height in (0.15, 0.25):
        overhangs, _, sections, profile = prepared(cone, height, support="columns")
        paths = supported(overhangs, sections, profile).paths
        low = paths.take(np.flatnonzero(paths.z_top < 10 + 6 * share))
        areas.append(
            sum(one.area for one in list_unsupported_places(overhangs, low, sections, profile, NOTHING))
        )
    assert areas[0] == pytest.approx(areas[1], rel=0.12)


def test_the_reason_for_large_places_needs_no_table_of_all_pairs() -> None:
    side = np.arange(0, 300) * 0.15
    points = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    removed = np.column_stack([points, np.full(len(points), 10.0)])

    assert UnsupportedReasons((), removed).choose(points, 10.2) == "nothing below carries its support"
    assert UnsupportedReasons((), removed).choose(points + 60.0, 10.2) != "nothing below carries its support"


@pytest.mark.parametrize("degrees", [34, 37, 39])
def test_narrow_strips_below_steep_slopes_make_one_column(degrees: int) -> None:
    outline = [(0, 0), (3, 0), (20, 17 * np.tan(np.radians(degrees))), (20, 40), (0, 40)]
    slope = turned(prism(np.array(outline, np.float64), 20.0), (90.0, 0.0, 0.0))
    profile = load_profile(quality="adaptive", changes={"support": "columns"})

    supports = slice_stages(slope, profile).supports

    assert supports is not None
    assert not supports.unsupported


def test_beads_above_a_stretch_that_is_cut_get_columns() -> None:
    profile = load_profile(quality="standard", changes={"support": "tree", "layer_height": 0.2})

    supports = slice_stages(figure(), profile).supports

    assert supports is not None
    assert not supports.unsupported


@pytest.mark.parametrize(("gap", "area"), [(0.2, 0.0), (1.0, 400.0)])
def test_ledges_just_above_the_bed_are_listed_if_the_gap_leaves_no_room(gap: float, area: float) -> None:
    ledge = joined(
        [box((20.0, 20.0, 10.0), (10.0, 0.0, 0.0)), box((40.0, 20.0, 2.0), (0.0, 0.0, 0.3))], "ledge"
    )
    profile = load_profile(quality="adaptive", changes={"support": "auto", "support_gap": gap})

    supports = slice_stages(ledge, profile).supports

    assert supports is not None
    assert sum(place.area for place in supports.unsupported) == pytest.approx(area, abs=1.0)


def leaning_wall(lean: float) -> Mesh:
    """A wall along x that leans by an angle from the vertical, in degrees, with an arm of 2.5 mm on its upper side."""
    way = 20 * float(np.tan(np.deg2rad(lean)))
    wall = [(0.0, 0.0), (4.0, 0.0), (4.0 + way, 20.0), (way, 20.0)]
    arm = [(way - 2.5, 20.0), (4.0 + way, 20.0), (4.0 + way, 24.0), (way - 2.5, 24.0)]
    outlines = (prism(np.array(one), 20.0).triangles[:, :, [2, 0, 1]] for one in (wall, arm))
    return joined([Mesh(one, "prism") for one in outlines], "wall")


@pytest.mark.parametrize("lean", [8, 15, 25])
def test_columns_lean_beside_steep_slopes(lean: float) -> None:
    bare, overhangs = bare_of(leaning_wall(lean))

    assert overhangs.area.area().sum() == pytest.approx(2.5 * 20, rel=0.05)
    assert bare == ()
