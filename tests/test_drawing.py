"""Pictures: what they show is where it is, in SVG and in PNG, whatever the part."""

from __future__ import annotations

import io
import math
import re
from collections import Counter
from collections.abc import Callable
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from printer_slicer.arrays import Float
from printer_slicer.drawing import draw_layer, draw_plan, draw_program_layer
from printer_slicer.drawing.canvas import Box, Fill, Line, Picture, Text
from printer_slicer.drawing.colours import choose_height_colours
from printer_slicer.mesh_io import load_mesh
from printer_slicer.model import Areas, LayerPlan, Mesh, ObjectStack, Program, Sections, stack_sections
from printer_slicer.pipeline import slice_part
from printer_slicer.placing import place
from printer_slicer.planning import plan_layers
from printer_slicer.profile import Profile, load_profile
from printer_slicer.roles import Role
from printer_slicer.slicing import cut
from printer_slicer.surface import Certificate, certify, certify_stacks, read_surface
from tests.parts import box as box_part
from tests.parts import box_with_hole, joined, shape, shapely, sphere, step_pyramid

PARTS = Path(__file__).parents[1] / "sample_parts"
SVG = "{http://www.w3.org/2000/svg}"
UNIFORM = load_profile("marlin_220", "pla", "standard", {"layer_height": 0.3, "first_layer_height": 0.3})
PAPER = load_profile("marlin_220_06", "pla", "case_study")


@cache
def planned(name: str, profile: Profile = UNIFORM) -> tuple[Sections, Certificate]:
    part = place(load_mesh(PARTS / f"{name}.stl"), profile.printer)
    plan = plan_layers(part, profile)
    return cut(part, plan, profile.quality.resolution), certify(read_surface(part), plan)


def of(mesh: Mesh, heights: list[float], **options: Any) -> Picture:
    """The picture of a part in layers of these heights."""
    plan = LayerPlan.from_tops(np.cumsum(heights), "cusp")
    return draw_plan(cut(mesh, plan, 0.0), certify(read_surface(mesh), plan), mesh.name, **options)


def picture_of(name: str, profile: Profile = UNIFORM, **options: Any) -> Picture:
    return draw_plan(*planned(name, profile), name, **options)


def parsed(svg: str) -> ET.Element:
    """The picture; all its numbers must be finite."""
    assert not re.search(r"\b(nan|inf)\b", svg)
    return ET.fromstring(svg)  # this package wrote it


def size_of(picture: ET.Element) -> tuple[float, float]:
    left, top, width, height = map(float, picture.attrib["viewBox"].split())
    assert (left, top) == (0, 0)
    return width, height


def texts_of(picture: ET.Element) -> list[str]:
    return [element.text or "" for element in picture.iter(f"{SVG}text")]


def boxes(picture: Picture, name: str) -> list[Box]:
    return [one for one in picture.shapes if isinstance(one, Box) and one.name == name]


def layer_boxes(picture: Picture) -> list[Box]:
    """What stands for layers seen from the front, from the bed up."""
    return sorted(boxes(picture, "layer"), key=lambda box: -box.y)


def fills(picture: Picture, name: str) -> list[Fill]:
    return [one for one in picture.shapes if isinstance(one, Fill) and one.name == name]


def lines(picture: Picture, name: str) -> list[Line]:
    return [one for one in picture.shapes if isinstance(one, Line) and one.name == name]


def words(picture: Picture) -> list[str]:
    return [one.text for one in picture.shapes if isinstance(one, Text)]


def pixels(picture: Picture) -> Any:
    """(height, width, 3) what the PNG shows."""
    return np.asarray(Image.open(io.BytesIO(picture.png())).convert("RGB"))


def rgb(colour: str) -> tuple[int, ...]:
    return tuple(int(colour[i : i + 2], 16) for i in (1, 3, 5))


# Plans


@pytest.mark.parametrize("name", ["box", "cone", "bridge", "thin_wall", "sphere", "vase"])
def test_everything_of_a_plan_lies_inside_the_picture(name: str) -> None:
    picture = picture_of(name, tolerance=0.02, flats=[0.0, 1.0])
    width, height = size_of(parsed(picture.svg()))
    corners = [ring for one in picture.shapes if isinstance(one, Fill) for ring in one.rings]
    corners += [one.points for one in picture.shapes if isinstance(one, Line)]
    for one in picture.shapes:
        if isinstance(one, Box):
            corners.append(np.array([(one.x, one.y), (one.x + one.width, one.y + one.height)]))
    places = np.concatenate(corners)

    assert (width, height) == (picture.width, picture.height)
    assert width == 1600
    assert places.min() >= 0
    assert (places.max(axis=0) <= (width, height)).all()
    assert words(picture)[0] == name


def test_every_layer_of_a_box_is_one_rectangle_of_the_same_width() -> None:
    found = layer_boxes(picture_of("box"))

    assert len(found) == planned("box")[0].plan.n_layers
    assert len({box.width for box in found}) == 1


@pytest.mark.parametrize(("name", "profile"), [("cone", UNIFORM), ("case_study", PAPER)])
def test_layers_are_where_they_are_printed_in_every_panel(name: str, profile: Profile) -> None:
    picture = picture_of(name, profile)
    plan = planned(name, profile)[0].plan
    found = layer_boxes(picture)
    bars = sorted(boxes(picture, "height"), key=lambda bar: -bar.y)
    curve = fills(picture, "error")[0].rings[0]
    floor = float(curve[-1, 1])
    scale = (floor - float(curve[2 * plan.n_layers - 1, 1])) / plan.top[-1]
    tops = floor - scale * plan.top

    # Layers too thin to see are drawn together, so not every one is there.
    for edge in [*(box.y for box in found), *(bar.y for bar in bars)]:
        assert np.abs(tops - edge).min() < 1e-6
    for lower, upper in pairwise(found):
        assert lower.y - 1e-6 <= upper.y + upper.height <= lower.y + 0.51  # no gap, and hardly more
    assert np.allclose(curve[1 : 2 * plan.n_layers : 2, 1], tops)
    assert found[0].y + found[0].height == pytest.approx(floor)


def test_bars_and_curve_are_as_long_as_heights_and_bounds() -> None:
    picture = picture_of("case_study", PAPER)
    bars = sorted(boxes(picture, "height"), key=lambda bar: -bar.y)
    sections, certificate = planned("vase")
    curve = fills(picture_of("vase"), "error")[0].rings[0]
    reach = curve[: 2 * sections.plan.n_layers : 2, 0] - curve[-1, 0]

    assert np.allclose(np.array([bar.width for bar in bars]) / bars[0].width, [1, 0.25, 1])
    assert np.allclose(reach / reach.max(), certificate.bound / certificate.bound.max())


def test_a_section_of_two_pillars_is_two_rectangles() -> None:
    plan = planned("bridge")[0].plan
    pillars = int((plan.cut < 15).sum())

    assert len(layer_boxes(picture_of("bridge"))) == 2 * pillars + (plan.n_layers - pillars)


def test_layers_of_different_height_have_different_colours_and_a_legend() -> None:
    picture = picture_of("case_study", PAPER)
    sections, certificate = planned("case_study", PAPER)
    height = sections.plan.height
    legend = {box.colour for box in boxes(picture, "legend")}

    assert sorted({float(one) for one in height}) == [0.1, 0.4]
    assert (
        {box.colour for box in layer_boxes(picture)}
        == {bar.colour for bar in boxes(picture, "height")}
        == legend
    )
    assert len(legend) == 2
    assert f"{int((height == 0.1).sum())} x 0.1 mm" in words(picture)
    assert f"{int((height == 0.4).sum())} x 0.4 mm" in words(picture)
    assert {f"{len(height)} layers", "planner area", "0.1 to 0.4 mm"} <= set(words(picture))
    assert f"{certificate.max_error:.3g} mm" in words(picture)
    assert f"{certificate.volume_error:.3g} mm³" in words(picture)


def test_many_heights_share_entries_of_the_legend_and_none_is_left_out() -> None:
    heights = [0.05 + 0.01 * i for i in range(40)]
    picture = of(box_part((10, 10, sum(heights))), heights)
    entries = [re.fullmatch(r"(\d+) x ([\d.]+) to ([\d.]+) mm", text) for text in words(picture)]
    found = [(int(entry[1]), float(entry[2]), float(entry[3])) for entry in entries if entry]

    assert sum(count for count, _, _ in found) == 40
    assert (found[0][1], found[-1][2]) == (0.05, 0.44)
    assert all(a[2] < b[1] for a, b in pairwise(found))


def test_what_is_over_the_tolerance_is_marked_and_told() -> None:
    mesh = step_pyramid([20, 10], [3.15, 3.0])
    picture = of(mesh, [0.3] * 21, tolerance=0.05)
    marks = boxes(picture, "over-mark")
    step = layer_boxes(picture)[10]  # the flat at 3.15 lies within the layer from 3.0 to 3.3
    assert len(marks) == len(boxes(picture, "over")) >= 1
    assert any(mark.y <= step.y + 1 and mark.y + mark.height >= step.y + step.height - 1 for mark in marks)
    assert "max deviation, above 0.05" in words(picture)
    assert "tolerance 0.05" in words(picture)


def test_a_plan_within_the_tolerance_has_no_marks_but_the_line() -> None:
    picture = picture_of("case_study", PAPER, tolerance=0.1)
    line = lines(picture, "tolerance")[0].points
    curve = fills(picture, "error")[0].rings[0]
    bound = planned("case_study", PAPER)[1].bound.max()

    assert boxes(picture, "over") == boxes(picture, "over-mark") == []
    assert line[0, 0] - curve[-1, 0] == pytest.approx((curve[:, 0].max() - curve[-1, 0]) * 0.1 / bound)
    assert lines(picture_of("case_study", PAPER), "tolerance") == []


def test_flats_are_ticks_at_their_height() -> None:
    picture = picture_of("case_study", PAPER, flats=[0.0, 82.5, 1000.0])
    ticks = [float(line.points[0, 1]) for line in lines(picture, "flat")]
    found = layer_boxes(picture)

    assert ticks == pytest.approx([found[0].y + found[0].height, found[-1].y], abs=0.5)


def test_a_flat_part_is_drawn_higher_than_it_is_and_says_so() -> None:
    assert any(
        text.startswith("z drawn 2.5 times") for text in words(of(box_part((100, 10, 30)), [0.5] * 60))
    )
    assert not any("z drawn" in text for text in words(of(box_part((30, 10, 100)), [0.5] * 200)))


BOX = of(box_part((20, 20, 10)), [0.3])


@given(st.text(st.characters(codec="utf-8", exclude_categories=("Cc", "Cs", "Cn")), max_size=30))
def test_any_title_is_text_and_never_markup(title: str) -> None:
    first = BOX.shapes[0]
    assert isinstance(first, Text)
    named = Picture(
        BOX.width, BOX.height, (Text(first.x, first.y, title, first.size), *BOX.shapes[1:]), title
    )
    picture = parsed(named.svg())

    assert texts_of(picture)[0] == title
    assert [child.tag for child in picture.iter() if not child.tag.startswith(SVG)] == []


@pytest.mark.parametrize(
    "title", ["a\x1bb", "\x0b", "two\nlines", "\ud800", "<svg>]]>&", "中文 é ³", "", "W" * 500]
)
def test_hostile_titles_make_pictures_of_both_kinds(title: str) -> None:
    picture = draw_plan(*planned("box"), title)

    assert len(texts_of(parsed(picture.svg()))[0]) <= 200
    assert pixels(picture).shape == (picture.height, picture.width, 3)


def test_a_plan_of_one_layer_is_drawn() -> None:
    assert len(layer_boxes(BOX)) == 1
    assert "1 layer" in words(BOX)


def test_layers_without_area_leave_gaps_and_everything_empty_is_an_empty_bed() -> None:
    mesh = joined([box_part((10, 10, 1)), box_part((10, 10, 1), (0, 0, 2))])
    plan = LayerPlan.from_tops(np.linspace(0.25, 3, 12), "uniform")
    certificate = certify(read_surface(mesh), plan)
    gap = draw_plan(cut(mesh, plan, 0.0), certificate, "gap")
    nothing = draw_plan(Sections(plan, Areas.empty(12)), certificate, "nothing")

    assert len(layer_boxes(gap)) == len(fills(gap, "top")) == 8
    assert len(layer_boxes(nothing)) == len(fills(nothing, "top")) == 0
    for picture in (gap, nothing):
        parsed(picture.svg())
        picture.png()


def test_two_thousand_layers_become_rows_that_can_be_seen_in_a_file_of_usual_size() -> None:
    heights = [0.005 if i % 3 else 0.01 for i in range(3000)]
    picture = of(sphere(10.0), heights[: int(np.searchsorted(np.cumsum(heights), 19.0))])
    rows = layer_boxes(picture)

    assert "2849 layers" in words(picture)
    assert 300 < len(rows) < 900
    assert rows[-1].y < rows[0].y - 300
    assert len(picture.svg()) < 2_000_000


def test_layers_drawn_together_leave_no_gap_in_the_stack() -> None:
    picture = of(box_part((10, 10, 12)), [0.004, 0.008] * 1000)
    floors = [float(top.rings[0][:, 1].max()) for top in fills(picture, "top")]
    walls = [float(wall.rings[0][-1, 1] - wall.rings[0][0, 1]) for wall in fills(picture, "wall")]

    assert 100 < len(floors) < 1000
    assert len(walls) == 2 * len(floors)
    for k, rise in enumerate(-np.diff(floors), start=1):
        assert rise <= min(walls[2 * k : 2 * k + 2]) <= rise + 0.5


@pytest.mark.parametrize("factor", [1e-2, 1e4])
def test_tiny_and_huge_parts_look_as_they_do_in_mm(factor: float) -> None:
    heights = np.linspace(0.5, 1.5, 10)
    usual = of(sphere(5.0), heights.tolist())
    other = of(Mesh(sphere(5.0).triangles * factor, "sphere"), (heights * factor).tolist())
    places = [[(box.x, box.y, box.width, box.height) for box in layer_boxes(one)] for one in (usual, other)]

    assert np.allclose(places[0], places[1], atol=0.1)  # the tiny one's sections have a grid of 10 nm
    assert len(fills(usual, "top")) == len(fills(other, "top")) == 10


def test_sections_and_certificate_must_be_of_the_same_plan() -> None:
    with pytest.raises(ValueError, match="different plans"):
        draw_plan(planned("box")[0], planned("cone")[1], "")


# Colours


def lightness(colour: str) -> float:
    """CIE L*, 0 to 100."""
    linear = [
        c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in (v / 255 for v in rgb(colour))
    ]
    y = float(np.dot(linear, [0.2126, 0.7152, 0.0722]))
    return 116 * y ** (1 / 3) - 16 if y > 0.008856 else 903.3 * y


def test_both_views_show_each_stack_with_its_own_layers() -> None:
    left, right = box_part((8.0, 8.0, 6.0)), box_part((8.0, 8.0, 6.0), at=(20.0, 0.0, 0.0))
    plans = [LayerPlan.from_tops(np.arange(1, n + 1) * (6.0 / n)) for n in (20, 30)]
    stacks = [
        ObjectStack(plan, mesh, (k,)) for k, (mesh, plan) in enumerate(zip((left, right), plans, strict=True))
    ]
    cuts = [cut(one.mesh, one.plan, 0.0) for one in stacks]
    picture = draw_plan(stack_sections(cuts), certify_stacks(stacks), "two", stacks=cuts)
    left_sides = [one.x for one in picture.shapes if isinstance(one, Box) and one.name == "layer"]

    assert len(left_sides) == 20 + 30
    assert left_sides.count(min(left_sides)) == 20
    tops = [one for one in picture.shapes if isinstance(one, Fill) and one.name == "top"]
    assert sorted(Counter(round(one.rings[0][:, 0].min()) for one in tops).values()) == [20, 30]
    assert len({one.colour for one in tops}) == 2


@given(st.lists(st.integers(5, 80), min_size=2, max_size=60))
def test_thicker_layers_are_lighter_and_equal_ones_have_one_colour(steps: list[int]) -> None:
    heights = np.array(sorted(steps)) * 0.005
    light = [lightness(colour) for colour in choose_height_colours(heights)]
    rises = np.diff(heights) > 0

    assert (np.diff(light)[rises] > 0).all()
    assert (np.diff(light)[~rises] == 0).all()


@given(st.sets(st.integers(5, 80), min_size=2, max_size=8))
def test_a_few_heights_differ_in_lightness_alone_by_what_everybody_sees(steps: set[int]) -> None:
    light = [lightness(colour) for colour in choose_height_colours(np.array(sorted(steps)) * 0.005)]

    assert np.diff(light).min() > 2.3  # CIE76: a difference that is just noticeable
    assert light[-1] - light[0] > 35


# The stack


def test_a_hole_is_not_painted_over() -> None:
    picture = of(box_with_hole((20, 20, 4)), [0.5] * 8)
    top = fills(picture, "top")[-1]
    outer, hole = sorted(top.rings, key=lambda ring: -np.ptp(ring[:, 0]))
    seen = pixels(picture)
    inside, beside = (
        hole.mean(axis=0),
        (outer[0] + hole[np.argmin(np.linalg.norm(hole - outer[0], axis=1))]) / 2,
    )

    assert tuple(seen[int(beside[1]), int(beside[0])]) == rgb(top.colour)
    assert tuple(seen[int(inside[1]), int(inside[0])]) != rgb(top.colour)


def test_two_walls_of_a_box_face_the_viewer_in_different_light() -> None:
    picture = of(box_part((10, 10, 5)), [0.5] * 10)

    assert len(fills(picture, "top")) == 10
    assert len(fills(picture, "wall")) == 20
    assert len({fill.colour for fill in fills(picture, "wall")}) == 2


def first_hit(areas: list[Any], plan: LayerPlan, line: Callable[[float], Float]) -> tuple[int, str]:
    """Layer and kind of what a line of sight from above meets first; `line` gives its x, y at a height."""
    for k in reversed(range(plan.n_layers)):
        entry, leaving = line(float(plan.top[k])), line(float(plan.bottom[k]))
        if areas[k].contains(shapely.Point(entry)):
            return k, "top"
        if areas[k].intersects(shapely.LineString([entry, leaving])):
            return k, "wall"
    return -1, "none"


def test_the_painted_stack_shows_what_each_line_of_sight_meets_first() -> None:
    mesh = joined([box_part((20, 20, 3)), box_part((4, 4, 5), (2, 9, 3)), box_part((18, 6, 2), (1, 8, 8))])
    heights = [0.4, 0.6, 0.5, 0.7, 0.8, 1.0, 1.2, 0.9, 1.1, 0.8, 1.3, 0.7]
    picture, plan = of(mesh, heights), LayerPlan.from_tops(np.cumsum(heights))
    solid = cut(mesh, plan, 0.0).solid
    # The view, from where the corners of the bed and the middle of the highest face are: 12 and 10 mm, 10 mm up.
    bed, highest = fills(picture, "bed")[0].rings[0], fills(picture, "top")[-1].rings[0]
    plane = np.column_stack([(bed[1] - bed[0]) / 24, (bed[3] - bed[0]) / 24])
    up = (highest.mean(axis=0) - bed.mean(axis=0) - plane @ (0, 1)) / 10
    areas, seen = [shape(solid, k) for k in range(plan.n_layers)], pixels(picture)
    tops, walls = (
        [fill.colour for fill in fills(picture, "top")],
        {fill.colour for fill in fills(picture, "wall")},
    )
    low, high = highest.min(axis=0) - 20, bed.max(axis=0)
    found: list[str] = []
    for x, y in np.random.default_rng(7).uniform(low, high, (1500, 2)):
        around = seen[int(y) - 1 : int(y) + 2, int(x) - 1 : int(x) + 2].reshape(-1, 3)
        if (around != around[0]).any():
            continue  # an edge
        start = np.linalg.solve(plane, np.array([int(x) + 0.5, int(y) + 0.5]) - bed.mean(axis=0))
        step = np.linalg.solve(plane, up)
        layer, kind = first_hit(areas, plan, lambda z, start=start, step=step: start - step * z + 10)  # type: ignore[misc]
        colour = "#{:02x}{:02x}{:02x}".format(*around[0])
        found.append(kind)
        assert (colour in walls) == (kind == "wall")
        assert kind != "top" or colour == tops[layer]
    assert min(found.count(kind) for kind in ("top", "wall", "none")) > 50


# Both kinds of picture


@pytest.mark.parametrize(("name", "profile"), [("case_study", PAPER), ("bridge", UNIFORM)])
def test_svg_and_png_show_the_same(name: str, profile: Profile) -> None:
    picture = picture_of(name, profile, tolerance=0.02)
    seen = pixels(picture)
    rectangles = [
        {key: element.attrib[key] for key in ("x", "y", "width", "height", "fill")}
        for element in parsed(picture.svg()).iter(f"{SVG}rect")
        if element.attrib.get("class") in {"layer", "legend"} and float(element.attrib["height"]) > 4
    ]

    assert len(rectangles) > 2
    for one in rectangles:
        x, y = (float(one["x"]) + float(one["width"]) / 2, float(one["y"]) + float(one["height"]) / 2)
        assert tuple(seen[int(y), int(x)]) == rgb(one["fill"])
    assert picture.png().startswith(b"\x89PNG\r\n\x1a\n")
    assert seen.shape == (picture.height, picture.width, 3)
    assert tuple(seen[2, 2]) == (255, 255, 255)


# Layers


PROGRAM = slice_part(load_mesh(PARTS / "box.stl"), UNIFORM)


def strokes(picture: ET.Element) -> list[dict[str, str]]:
    return [element.attrib for element in picture.iter(f"{SVG}path")]


@pytest.mark.parametrize("layer", [0, 1, PROGRAM.plan.n_layers - 1])
def test_every_move_of_a_layer_is_a_line_and_travels_are_dotted(layer: int) -> None:
    lines = strokes(parsed(draw_layer(PROGRAM, layer)))
    member = PROGRAM.layer == layer
    travels = member & (PROGRAM.role == Role.TRAVEL)

    assert len(lines) == member.sum()
    assert sum("stroke-dasharray" in line for line in lines) == travels.sum()


def test_beads_lie_inside_the_picture() -> None:
    picture = parsed(draw_layer(PROGRAM, 0))
    width, height = size_of(picture)
    for line in strokes(picture):
        if "stroke-dasharray" in line:
            continue
        x0, y0, x1, y1 = (float(number) for number in re.findall(r"-?[\d.]+", line["d"]))
        assert 0 <= min(x0, x1) <= max(x0, x1) <= width
        assert 0 <= min(y0, y1) <= max(y0, y1) <= height


def test_beads_are_as_long_and_as_wide_as_they_are_laid() -> None:
    picture = parsed(draw_layer(PROGRAM, 1))
    member = PROGRAM.layer == 1
    beads = member & (PROGRAM.role != Role.TRAVEL)
    lengths = np.linalg.norm((PROGRAM.xyz - PROGRAM.start)[beads][:, :2], axis=1)
    drawn, widths = [], []
    for line in strokes(picture):
        if "stroke-dasharray" not in line:
            x0, y0, x1, y1 = (float(number) for number in re.findall(r"-?[\d.]+", line["d"]))
            drawn.append(math.hypot(x1 - x0, y1 - y0))
            widths.append(float(line["stroke-width"]))
    scale = sum(drawn) / lengths.sum()

    assert np.allclose(np.array(drawn), lengths * scale, atol=0.02)
    assert np.allclose(np.array(widths), PROGRAM.width[beads] * scale, rtol=0.1)


def test_roles_have_colours_of_their_own() -> None:
    picture = parsed(draw_layer(PROGRAM, 0))
    member = PROGRAM.layer == 0
    roles = {int(role) for role in PROGRAM.role[member]} - {int(Role.TRAVEL)}
    colours = {line["stroke"] for line in strokes(picture) if "stroke-dasharray" not in line}

    assert len(roles) >= 3
    assert len(colours) == len(roles)


def test_the_layer_and_its_height_are_written_on_it() -> None:
    assert f"layer 2 of {PROGRAM.plan.n_layers}, z 0.6 mm" in texts_of(parsed(draw_layer(PROGRAM, 1)))


@pytest.mark.parametrize("layer", [-1, PROGRAM.plan.n_layers, 10**6])
def test_a_layer_that_is_not_there_is_refused(layer: int) -> None:
    with pytest.raises(ValueError, match=str(layer)):
        draw_layer(PROGRAM, layer)


def only_travels() -> Program:
    """A program whose second layer lays nothing, as of a part with a tip narrower than a bead."""
    plan = LayerPlan.from_tops(np.array([0.2, 0.4]))
    return Program(
        plan=plan,
        origin=np.zeros(3),
        xyz=np.array([[10, 0, 0.2], [10, 10, 0.2], [20, 10, 0.4]]),
        filament=np.array([0.0, 1.0, 0.0]),
        speed=np.array([50.0, 20.0, 50.0]),
        layer=np.array([0, 0, 1]),
        role=np.array([Role.TRAVEL, Role.EXTERNAL_PERIMETER, Role.TRAVEL]),
        width=np.array([0.0, 0.45, 0.0]),
        height=np.array([0.0, 0.2, 0.0]),
    )


def test_a_layer_of_travels_alone_is_drawn() -> None:
    lines = strokes(parsed(draw_layer(only_travels(), 1)))

    assert [("stroke-dasharray" in line) for line in lines] == [True]


def test_a_layer_with_one_straight_bead_is_drawn() -> None:
    picture = parsed(draw_layer(only_travels(), 0))

    assert len(strokes(picture)) == 2
    assert min(size_of(picture)) > 0


def test_the_roles_of_a_layer_are_named_and_its_png_is_as_large() -> None:
    picture = draw_program_layer(PROGRAM, 0)

    assert {"External perimeter", "Perimeter", "Solid infill", "Skirt/Brim"} <= set(words(picture))
    assert pixels(picture).shape == (picture.height, picture.width, 3)
