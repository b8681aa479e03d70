"""Pictures: well-formed SVG that shows every layer and every bead, whatever the part."""

from __future__ import annotations

import math
import re
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer.drawing import draw_layer, draw_plan
from printer_slicer.mesh_io import load_mesh
from printer_slicer.model import LayerPlan, Program, Role, Sections
from printer_slicer.pipeline import slice_part
from printer_slicer.placing import place
from printer_slicer.planning import plan_layers
from printer_slicer.profile import Profile, load_profile
from printer_slicer.slicing import cut

PARTS = Path(__file__).parents[1] / "sample_parts"
SVG = "{http://www.w3.org/2000/svg}"
UNIFORM = load_profile("marlin_220", "pla", "standard", {"layer_height": 0.3, "first_layer_height": 0.3})
PAPER = load_profile("marlin_220_06", "pla", "case_study")


def sections_of(name: str, profile: Profile = UNIFORM) -> Sections:
    part = place(load_mesh(PARTS / f"{name}.stl"), profile.printer)
    return cut(part, plan_layers(part, profile), profile.quality.resolution)


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


def layer_boxes(picture: ET.Element) -> list[tuple[float, float, float, float, str]]:
    """x, y, width, height, colour of the rectangles that stand for layers: neither background nor legend."""
    boxes = [element.attrib for element in picture.iter(f"{SVG}rect")]
    return [
        (float(box["x"]), float(box["y"]), float(box["width"]), float(box["height"]), box["fill"])
        for box in boxes
        if "x" in box and box["width"] != "14"
    ]


# Plans


@pytest.mark.parametrize("name", ["box", "cone", "case_study", "bridge", "thin_wall", "sphere"])
def test_a_plan_is_a_picture_of_880_by_640_with_its_title(name: str) -> None:
    picture = parsed(draw_plan(sections_of(name), name))

    assert size_of(picture) == (880, 640)
    assert name in texts_of(picture)


@pytest.mark.parametrize("name", ["box", "cone", "bridge", "thin_wall"])
def test_everything_of_a_plan_lies_inside_the_picture(name: str) -> None:
    picture = parsed(draw_plan(sections_of(name), name))

    for x, y, width, height, _ in layer_boxes(picture):
        assert min(x, y) >= 0
        assert x + width <= 880
        assert y + height <= 640


def test_every_layer_of_a_box_is_one_rectangle_of_the_same_width() -> None:
    sections = sections_of("box")
    boxes = layer_boxes(parsed(draw_plan(sections, "box")))

    assert len(boxes) == sections.plan.n_layers
    assert len({width for _, _, width, _, _ in boxes}) == 1


def test_layers_stand_on_each_other() -> None:
    boxes = layer_boxes(parsed(draw_plan(sections_of("cone"), "cone")))
    bottoms = [y + height for _, y, _, height, _ in boxes]
    tops = [y for _, y, _, _, _ in boxes]

    assert tops == sorted(tops, reverse=True)
    assert np.allclose(tops[:-1], bottoms[1:], atol=0.1)


def test_a_section_of_two_pillars_is_two_rectangles() -> None:
    sections = sections_of("bridge")
    boxes = layer_boxes(parsed(draw_plan(sections, "bridge")))
    pillars = int((sections.plan.cut < 15).sum())

    assert len(boxes) == 2 * pillars + (sections.plan.n_layers - pillars)


def test_layers_of_different_height_have_different_colours_and_a_legend() -> None:
    sections = sections_of("case_study", PAPER)
    picture = parsed(draw_plan(sections, "the paper's part"))
    heights = sorted({float(height) for height in sections.plan.height})
    colours = {colour for *_, colour in layer_boxes(picture)}

    assert heights == [0.1, 0.4]
    assert len(colours) == 2
    assert f"{int((sections.plan.height == 0.1).sum())} x 0.1 mm" in texts_of(picture)
    assert f"{int((sections.plan.height == 0.4).sum())} x 0.4 mm" in texts_of(picture)
    assert f"{sections.plan.n_layers} layers, planner area" in texts_of(picture)


def flat_box() -> Sections:
    """One layer of the box."""
    return cut(
        place(load_mesh(PARTS / "box.stl"), UNIFORM.printer),
        LayerPlan.from_tops(np.array([0.3]), "uniform"),
        0,
    )


BOX = flat_box()


@given(st.text(st.characters(codec="utf-8", exclude_categories=("Cc", "Cs", "Cn")), max_size=30))
def test_any_title_is_text_and_never_markup(title: str) -> None:
    picture = parsed(draw_plan(BOX, title))

    assert texts_of(picture)[0] == title
    assert [child.tag for child in picture.iter() if not child.tag.startswith(SVG)] == []


@pytest.mark.parametrize("title", ["a\x1bb", "\x0b"])
def test_a_title_with_control_characters_still_makes_a_picture(title: str) -> None:
    parsed(draw_plan(BOX, title))


def test_a_plan_of_one_layer_is_drawn() -> None:
    picture = parsed(draw_plan(BOX, "one"))

    assert len(layer_boxes(picture)) == 1
    assert any(text.startswith("1 layer") for text in texts_of(picture))


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
        role=np.array([Role.TRAVEL, Role.OUTER_PERIMETER, Role.TRAVEL]),
        width=np.array([0.0, 0.45, 0.0]),
    )


def test_a_layer_of_travels_alone_is_drawn() -> None:
    lines = strokes(parsed(draw_layer(only_travels(), 1)))

    assert [("stroke-dasharray" in line) for line in lines] == [True]


def test_a_layer_with_one_straight_bead_is_drawn() -> None:
    picture = parsed(draw_layer(only_travels(), 0))

    assert len(strokes(picture)) == 2
    assert min(size_of(picture)) > 0
