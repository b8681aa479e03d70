"""The benchmark of supports measures small G-code, whose supports are known, and finds planted faults."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from benchmarks.support_beads import SupportFile, read_supports, support_seconds
from benchmarks.support_figures import Figures, measure_supports
from benchmarks.support_parts import arch, figure, read_rotation, support_parts, turned
from benchmarks.support_solid import Island, Overhang, Solid, find_islands, find_overhang
from benchmarks.supports import layer_changes
from printer_slicer import bead
from printer_slicer.errors import UsageError
from printer_slicer.gcode import write_gcode
from printer_slicer.mesh_io import export_stl
from printer_slicer.model import Mesh
from printer_slicer.pipeline import slice_stages
from printer_slicer.profile import OptimalPlanner, UniformPlanner, load_profile
from tests.parts import box, joined, prism
from tests.supports.shapes import hook, mushroom, sphere_on_bed, tee

DIAMETER, DENSITY = 1.75, 1.24
WIDTH, HEIGHT = 0.45, 0.2
FILAMENT = float(bead.filament_per_mm(WIDTH, HEIGHT, DIAMETER))
BOTTOM = 2.0  # of the plate


@cache
def table() -> Mesh:
    """A plate of 20 x 12 at a height of 2 mm, on a post of 4 x 12 at its left end."""
    return joined([box((4.0, 12.0, 3.0)), box((20.0, 12.0, 1.0), (0.0, 0.0, BOTTOM))], "table")


class Text:
    """G-code with relative extrusion, written line by line."""

    def __init__(self) -> None:
        self.lines = ["G90", "M83"]

    def layer(self, top: float, kind: str) -> Text:
        """Begin extrusions of a kind at a height."""
        self.lines += [";LAYER_CHANGE", f";HEIGHT:{HEIGHT}", f";TYPE:{kind}", f"G1 Z{top:g} F9000"]
        return self

    def path(self, *points: Sequence[float]) -> Text:
        """Travel to the first point, and extrude through the others."""
        self.lines.append(f"G1 X{points[0][0]:g} Y{points[0][1]:g} F9000")
        for (x, y), (u, v) in zip(points[1:], points[:-1], strict=True):
            fed = FILAMENT * float(np.hypot(x - u, y - v))
            self.lines.append(f"G1 X{x:g} Y{y:g} E{fed:.8f} F3600")
        return self

    def rows(self, left: float, right: float) -> Text:
        """Extrude rows along x, 1 mm apart, over the depth of the table."""
        for y in np.arange(0.5, 12.0):
            self.path((left, y), (right, y))
        return self

    def read(self) -> SupportFile:
        """Return the extrusions."""
        return read_supports("\n".join(self.lines).encode(), DIAMETER)


def supported(
    levels: Sequence[float] = (0.2, 0.4, 0.6, 0.8, 1.0, 1.2, 1.4, 1.6, 1.8), *, left: float = 4.5
) -> Text:
    """A table with rows of support at some levels, and the lowest layer of its plate."""
    text = Text()
    for top in levels:
        text.layer(top, "Support material").rows(left, 19.5)
    return text.layer(BOTTOM + HEIGHT, "External perimeter").rows(0.5, 19.5)


@cache
def measured_part(part: Mesh) -> tuple[Solid, tuple[Overhang, list[Island]]]:
    """A part, and what of it needs supports."""
    solid = Solid.of(part)
    return solid, (find_overhang(solid, 40, 10), find_islands(solid, 0.2))


def measured(text: Text) -> Figures:
    """The figures of a file of the table."""
    return measure_supports(text.read(), *measured_part(table()), DENSITY)


# What hangs


def test_a_flat_hangs_with_its_whole_area() -> None:
    overhang = measured_part(tee())[1][0]

    assert overhang.area == pytest.approx(500, abs=0.5)
    assert overhang.z == pytest.approx(40)
    assert overhang.is_flat.all()
    assert len(set(overhang.patch.tolist())) == 2


def test_slopes_hang_up_to_the_threshold() -> None:
    solid = Solid.of(sphere_on_bed(20.0, 360))
    overhang = find_overhang(solid, 40, 10)
    first = 0.2  # mm of height, which lie on the bed
    lower = np.pi * ((20 * np.sin(np.deg2rad(40))) ** 2 - first * (40 - first))

    assert overhang.area == pytest.approx(lower, rel=0.02)
    assert find_overhang(solid, 10, 10).area < 0.12 * lower


def test_bridges_between_two_ends_do_not_count_up_to_their_longest_span() -> None:
    solid = Solid.of(arch(span=9.0))

    assert find_overhang(solid, 40, 10).area == 0
    assert find_overhang(solid, 40, 10).bridged == pytest.approx(9 * 16, rel=0.02)
    assert find_overhang(solid, 40, 8).area == pytest.approx(9 * 16, rel=0.02)
    assert find_overhang(Solid.of(tee(arm=9.0)), 40, 10).area == pytest.approx(180, rel=0.02)


def roof(span: float, lean: float) -> Mesh:
    """A slab, 10 mm deep, between two walls `span` apart; its lower side rises by `lean` along y."""
    side = np.array([(0.0, 10.0), (10.0, 10.0 + lean), (10.0, 20.0), (0.0, 20.0)])  # y and z
    slab = Mesh(prism(side, span).triangles[:, :, [2, 0, 1]], "slab")
    walls = [box((4.0, 10.0, 20.0), (x, 0.0, 0.0)) for x in (-4.0, span)]
    return joined([slab, *walls], "roof")


def tunnel(diameter: float) -> Mesh:
    """A wall, 6 mm thick, with a horizontal round hole through it, open at the bed."""
    turn = np.linspace(0.0, np.pi, 61)
    round_side = np.column_stack([-np.cos(turn), np.sin(turn)]) * diameter / 2
    outer = np.array([(20.0, 0.0), (20.0, 20.0), (-20.0, 20.0), (-20.0, 0.0)])
    return Mesh(prism(np.concatenate([round_side, outer])[::-1], 6.0).triangles[:, :, [0, 2, 1]], "tunnel")


@pytest.mark.parametrize(("diameter", "area"), [(3.0, 0), (4.0, 0), (6.0, 0), (16.0, 40)])
def test_crowns_of_small_holes_are_bridged(diameter: float, area: float) -> None:
    found = find_overhang(Solid.of(tunnel(diameter)), 40, 10)

    assert found.area == pytest.approx(area, abs=12 if area else 0)


@pytest.mark.parametrize(
    ("span", "lean", "is_held"), [(6.0, 3.0, True), (12.0, 3.0, False), (6.0, 6.0, False)]
)
def test_ceilings_that_slope_slightly_between_two_walls_are_bridged(
    span: float, lean: float, is_held: bool
) -> None:
    found = find_overhang(Solid.of(roof(span, lean)), 40, 10)

    assert found.area == pytest.approx(0 if is_held else span * 10, abs=3)


@pytest.mark.parametrize(("width", "area"), [(0.9, 0), (1.3, 26)])
def test_patches_into_which_no_circle_fits_do_not_count(width: float, area: float) -> None:
    shelf = joined([box((30.0, 10.0, 20.0)), box((20.0, width, 2.0), (0.0, 10.0, 18.0))], "shelf")

    assert find_overhang(Solid.of(shelf), 40, 10).area == pytest.approx(area, abs=2)


def test_turning_a_part_about_z_changes_nothing() -> None:
    areas = [find_overhang(Solid.of(turned(mushroom(10, 10), (0, 0, a))), 40, 10).area for a in (0, 17, 45)]

    assert areas == pytest.approx([areas[0]] * 3, rel=0.01)


def test_a_model_is_turned_as_its_name_says(tmp_path: Path) -> None:
    export_stl(box((10.0, 20.0, 30.0)), tmp_path / "block.stl")

    (part,) = support_parts(tmp_path, ["block@x90z90"], load_profile())

    assert part.name == "block@x90z90"
    assert np.ptp(part.bounds, axis=0) == pytest.approx((30.0, 10.0, 20.0))
    assert read_rotation("block@y-35.5") == ("block", (0.0, -35.5, 0.0))
    for wrong in ("block", "block@60", "block@x60q", "other@x60"):
        with pytest.raises(UsageError):
            list(support_parts(tmp_path, [wrong], load_profile()))


def test_adaptive_layers_are_planned() -> None:
    planned, equal = (
        load_profile(quality=quality, changes=layer_changes(plan, 0.2, 0.2)).quality.planner
        for quality, plan in (("adaptive", "adaptive"), ("standard", "uniform"))
    )

    assert isinstance(planned, OptimalPlanner)
    assert isinstance(equal, UniformPlanner)


def test_islands_are_pieces_that_begin_in_the_air() -> None:
    assert [round(one.z, 1) for one in measured_part(hook())[1][1]] == [15.1]
    assert measured_part(tee())[1][1] == []
    assert len(find_islands(Solid.of(figure()), 0.2)) == 2


def test_a_body_that_never_joins_what_stands_is_an_island() -> None:
    apart = joined([box((5.0, 5.0, 5.0)), box((5.0, 5.0, 5.0), (10.0, 0.0, 3.0))], "two")

    assert [round(one.z, 2) for one in find_islands(Solid.of(apart), 0.2)] == [3.0]


@pytest.mark.parametrize(("lower", "count"), [(0.24, 0), (0.36, 1)])
def test_pieces_lower_than_a_layer_are_no_islands(lower: float, count: int) -> None:
    knob = box((3.0, 3.0, 4.0), (10.0, 0.0, 10.0 - lower))
    part = joined([box((5.0, 5.0, 12.0)), box((15.0, 5.0, 2.0), (0.0, 0.0, 10.0)), knob], "knob")

    assert len(find_islands(Solid.of(part), 0.3)) == count


# A file without fault


def test_a_sound_support_has_no_fault() -> None:
    found = measured(supported())

    assert found.overhang == pytest.approx(16 * 12, rel=0.01)
    assert (found.bare, found.floats, found.inside, found.standing) == (0, [], 0, 0)
    assert [flat.gap for flat in found.flats] == pytest.approx([0.2])
    assert found.touching == pytest.approx(12 * 15 * WIDTH, rel=0.15)
    volume = 9 * 12 * 15 * float(bead.cross_section(WIDTH, HEIGHT))
    assert found.grams == pytest.approx(volume * DENSITY / 1000, rel=1e-5)


def test_without_comments_on_heights_the_layers_give_them() -> None:
    text = supported()
    text.lines = [line for line in text.lines if not line.startswith(";HEIGHT")]
    file = text.read()

    assert file.support.height == pytest.approx(HEIGHT, abs=1e-6)


def test_minutes_follow_the_rule() -> None:
    text = Text().layer(0.2, "Support material").path((0, 0), (60, 0), (60, 1)).path((60, 10), (0, 10))
    extruding, travelling = support_seconds(text.read())

    far = 60 / 60 + 60 / 1500
    assert extruding == pytest.approx(2 * far + 2 * np.sqrt(1 / 1500), rel=1e-6)
    assert travelling == pytest.approx(2 * np.sqrt(9 / 1500), rel=1e-6)  # the first move begins at 0, 0


# Planted faults


def test_a_missing_layer_is_found_in_the_air() -> None:
    levels = [0.2, 0.4, 0.6, 1.0, 1.2, 1.4, 1.6, 1.8]
    found = measured(supported(levels))

    assert [place.z for place in found.floats] == [0.8]
    assert found.floating == pytest.approx(12 * 15, rel=0.01)


def test_one_extrusion_in_the_air_is_found() -> None:
    text = supported()
    text.layer(1.8, "Support material").path((22.0, 6.0), (24.5, 6.0))
    found = measured(text)

    assert len(found.floats) == 1
    assert found.floats[0].amount == pytest.approx(2.5, abs=0.1)


@pytest.mark.parametrize(("beyond", "floats"), [(1.5, 0), (2.6, 1)])
def test_a_free_end_may_be_2_mm_long(beyond: float, floats: int) -> None:
    text = supported().layer(1.8, "Support material").path((18.0, 6.5), (19.5 + beyond, 6.5))

    assert len(measured(text).floats) == floats


@pytest.mark.parametrize("shift", np.arange(0.0, 0.1, 0.02).tolist())
@pytest.mark.parametrize(("aside", "floats"), [(0.2, 0), (0.25, 1)])
def test_half_of_the_width_must_lie_over_something(aside: float, floats: int, shift: float) -> None:
    """The places of cells do not matter: 0.25 or 0.20 of 0.45 mm lie over the extrusion below."""
    text = Text()
    for top, y in ((0.2, 5.0), (0.4, 5.0), (0.6, 5.0 + aside)):
        text.layer(top, "Support material").path((8.0, y + shift), (14.0, y + shift))

    assert len(measured(text).floats) == floats


def test_supports_stand_on_extrusions_of_the_part_that_are_higher_than_the_model() -> None:
    text = Text().layer(3.2, "External perimeter").path((8.0, 5.0), (14.0, 5.0))
    text.layer(3.8, "Support material").path((8.0, 5.0), (14.0, 5.0)).path((8.0, 8.0), (14.0, 8.0))

    assert [place.y for place in measured(text).floats] == [pytest.approx(8.0 - 6.0, abs=0.1)]


@pytest.mark.parametrize(("away", "sags"), [(4.0, 0), (9.0, 1)])
def test_lines_may_span_from_row_to_row(away: float, sags: int) -> None:
    text = Text()
    for top in (0.2, 0.4, 0.6):
        text.layer(top, "Support material").rows(6.0, 8.0).rows(8.0 + away, 10.0 + away)
    found = measured(text.layer(0.8, "Support material").path((6.0, 6.5), (10.0 + away, 6.5)))

    assert len(found.sags) == sags
    assert found.floats == []
    assert (found.span > 0) == (not sags)


def test_support_in_the_part_is_found() -> None:
    found = measured(supported(left=3.0))

    # Rows reach 1 mm, and half a width, into the post; a cell at the edge is tolerated.
    assert found.inside == pytest.approx(9 * 12 * WIDTH * (1 - 0.1), rel=0.2)
    assert found.inside_places[0].x < -5


def test_a_gap_that_is_too_large_is_measured() -> None:
    found = measured(supported([0.2, 0.4, 0.6, 0.8, 1.0, 1.2, 1.4, 1.6]))

    assert [flat.gap for flat in found.flats] == pytest.approx([0.4])


@pytest.mark.parametrize(("right", "bare"), [(19.5, 0), (9.5, (20 - 9.5 - WIDTH / 2 - 1.5) * 12)])
def test_what_no_support_is_near_is_bare(right: float, bare: float) -> None:
    text = Text()
    for top in np.arange(0.2, 1.9, 0.2).tolist():
        text.layer(top, "Support material").rows(4.5, right)
    found = measured(text.layer(BOTTOM + HEIGHT, "External perimeter").rows(0.5, 19.5))

    assert found.bare == pytest.approx(bare, rel=0.05)
    assert (found.farthest > 2.5) == (bare > 0)


def test_a_support_that_ends_too_low_holds_nothing() -> None:
    found = measured(supported([0.2, 0.4, 0.6, 0.8, 1.0]))

    assert found.bare == pytest.approx(16 * 12, rel=0.01)
    assert [flat.gap for flat in found.flats] == pytest.approx([1.0])


def test_the_side_of_a_branch_below_the_edge_of_a_flat_is_no_gap() -> None:
    text = Text().layer(1.0, "Support material").path((20.15, 5.0), (20.15, 5.4))
    text.layer(BOTTOM + HEIGHT, "External perimeter").rows(0.5, 19.9)

    assert measured(text).flats == []


def test_support_on_the_part_is_a_scar() -> None:
    text = Text()
    for top in (3.4, 3.6):  # a gap of 0.2 over the plate
        text.layer(top, "Support material").rows(5.0, 10.0)
    text.layer(BOTTOM + HEIGHT, "External perimeter").rows(0.5, 19.5)

    assert measured(text).standing == pytest.approx(12 * 5 * WIDTH, rel=0.15)


def test_an_island_without_support_is_found() -> None:
    file = Text().layer(0.2, "External perimeter").path((0, 0), (10, 0)).read()
    found = measure_supports(file, *measured_part(hook()), DENSITY)

    assert [place.z for place in found.unsupported] == pytest.approx([15.0], abs=0.2)


def test_a_slim_pillar_is_slim() -> None:
    text = Text()
    for top in np.arange(0.2, 30.0, 0.2).tolist():
        text.layer(top, "Support material").path((30, 5), (31.6, 5), (31.6, 5.4), (30, 5.4))
    found = measured(text.layer(BOTTOM + HEIGHT, "External perimeter").rows(0.5, 19.5))

    assert 12 < found.slimness < 25


# Our own files


@pytest.mark.parametrize("style", ["columns", "tree"])
def test_a_layer_taken_out_of_our_own_file_is_found(style: str) -> None:
    changes = {"support": style, "skirt_loops": 0}
    profile = load_profile(quality="standard", changes=changes)
    stages = slice_stages(tee(10, 15), profile)
    text = write_gcode(stages.program, profile)
    solid = Solid.of(stages.part)
    truth = find_overhang(solid, 40, 10), find_islands(solid, 0.2)
    sound = read_supports(text, profile.material.filament_diameter)
    tops = np.unique(np.round(sound.support.z_top, 3))
    taken = tops[len(tops) // 2]
    kept = np.flatnonzero(np.abs(sound.support.z_top - taken) > 0.001)
    planted = SupportFile(sound.support.take(kept), sound.path[kept], sound.part, sound.travel, sound.before)

    before, after = (measure_supports(one, solid, truth, DENSITY) for one in (sound, planted))
    assert before.bare == 0
    assert len(after.floats) > len(before.floats)
    assert any(abs(place.z - taken) < 0.001 for place in after.floats)
