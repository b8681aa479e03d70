"""A layer of a file from above: beads are where they are laid and as wide, later ones over earlier ones."""

from __future__ import annotations

import io
import re
from math import pi
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from printer_slicer import bead
from printer_slicer.drawing import View, draw_gcode_layer
from printer_slicer.drawing.canvas import Fill, Line, Picture, Strokes, Text
from printer_slicer.drawing.extrusion_kinds import find_kinds
from printer_slicer.geometry import Areas
from printer_slicer.inspection.coverage.gcode_extrusions import extrusions_of_gcode
from printer_slicer.inspection.coverage.layer_extrusions import (
    LayerExtrusions,
    extrusions_of_layer,
    file_layers_of,
)
from printer_slicer.inspection.coverage.stack import stack_extrusions
from tests.contoured_gcode import example
from tests.inspection.coverage.lines import path
from tests.parts import shape, shapely
from tests.strategies import clean_areas

SVG = "{http://www.w3.org/2000/svg}"


def laid(*lines: str) -> LayerExtrusions:
    deposit = extrusions_of_gcode("\n".join(["M83", *lines]).encode())
    return extrusions_of_layer(deposit, file_layers_of(deposit, stack_extrusions(deposit.beads)), 0)


def strokes(picture: Picture, name: str) -> list[Strokes]:
    return [one for one in picture.shapes if isinstance(one, Strokes) and one.name == name]


def words(picture: Picture) -> list[str]:
    return [one.text for one in picture.shapes if isinstance(one, Text)]


def pixels(picture: Picture) -> Any:
    """(height, width, 3) what the PNG shows."""
    return np.asarray(Image.open(io.BytesIO(picture.png())).convert("RGB")).astype(int)


def scale_of(picture: Picture) -> float:
    """Px for a mm, as the scale bar says."""
    bar = next(one for one in picture.shapes if isinstance(one, Line) and one.name == "scale")
    return float(np.ptp(bar.points[:, 0])) / float(words(picture)[-1].removesuffix(" mm"))


def body(sheet: LayerExtrusions) -> Any:
    """What the beads cover, mm, as shapely sees it."""
    lines = shapely.linestrings(np.stack([sheet.beads.begin, sheet.beads.end], axis=1))
    return shapely.union_all(shapely.buffer(lines, sheet.beads.width / 2, quad_segs=32))


ZIGZAG = path([(0, 0), (20, 0), (20, 6), (3, 6), (11, 13)], 0.2, 0.2, 0.8)


def test_the_png_is_coloured_where_plastic_lies_and_nowhere_else() -> None:
    sheet = laid(*ZIGZAG)
    picture = draw_gcode_layer(sheet, "", View(pixels=600))
    drawn = pixels(picture)[60:-44]
    coloured = (255 * 3 - drawn.sum(axis=2)) > 290  # half of what edges differ from white

    assert coloured.sum() / scale_of(picture) ** 2 == pytest.approx(body(sheet).area, rel=0.01)


def test_each_bead_is_as_wide_as_what_is_fed_says() -> None:
    sheet = laid(*path([(0, 0), (20, 0)], 0.2, 0.2, 0.4), *path([(0, 3), (20, 3)], 0.2, 0.2, 0.9))
    picture = draw_gcode_layer(sheet, "")
    edges = strokes(picture, "edge")

    assert [one.widths[0] / scale_of(picture) for one in edges] == pytest.approx([0.4, 0.9], abs=0.005)
    assert len(edges) == 2


def test_a_bead_of_changing_width_is_one_path_of_many_pieces() -> None:
    x, lines = 0.0, ["G0 X0 Y0 Z0.2"]
    widths = [0.4, 0.5, 0.6, 0.7]
    for width in widths:
        x += 5
        fed = 5 * bead.cross_section(width, 0.2) / (pi * 1.75**2 / 4)
        lines.append(f"G1 X{x:g} E{fed:.7f}")
    picture = draw_gcode_layer(laid(*lines), "")
    (edge,), (inside,) = strokes(picture, "edge"), strokes(picture, "unknown")

    assert np.array(edge.widths) / scale_of(picture) == pytest.approx(widths, abs=0.005)
    # All edges of a path lie under all that is between edges, so that pieces are not told apart.
    assert picture.shapes.index(edge) < picture.shapes.index(inside)
    assert (np.array(inside.widths) < edge.widths).all()


def test_of_two_beads_that_overlap_the_later_one_is_seen_whole() -> None:
    level, upright = path([(0, 5), (10, 5)], 0.2, 0.2, 1.0), path([(5, 0), (5, 10)], 0.2, 0.2, 1.0)
    cases = {
        "Perimeter": [*level, ";TYPE:Perimeter", *upright],
        "Sparse": [*upright, ";TYPE:Sparse infill", *level],
    }
    colours = []
    for lines in cases.values():
        sheet = laid(*lines)
        picture = draw_gcode_layer(sheet, "", View(pixels=500))
        last = [one for one in picture.shapes if isinstance(one, Strokes)][-1]
        (x, y) = last.lines[0].mean(axis=0)
        colours.append((pixels(picture)[round(y), round(x)].tolist(), last.colour))

    for seen, said in colours:
        assert seen == [int(said[i : i + 2], 16) for i in (1, 3, 5)]


def test_what_of_the_section_has_no_plastic_is_seen() -> None:
    sheet = laid(*ZIGZAG)
    square = np.array([(4.0, 1.0), (18.0, 1.0), (18.0, 5.0), (4.0, 5.0)])
    picture = draw_gcode_layer(sheet, "", View(pixels=600, section=[square]))
    empty = next(one for one in picture.shapes if isinstance(one, Fill))
    colour = np.array([int(empty.colour[i : i + 2], 16) for i in (1, 3, 5)])
    seen = (np.abs(pixels(picture)[90:] - colour).sum(axis=2) < 10).sum() / scale_of(picture) ** 2

    assert seen == pytest.approx(shapely.Polygon(square).difference(body(sheet)).area, rel=0.03)
    assert "Section without extrusion" in words(picture)


def test_title_and_legend_say_what_there_is() -> None:
    sheet = laid(
        ";TYPE:External perimeter", *ZIGZAG, ";TYPE:Top solid infill", *path([(3, 2), (9, 2)], 0.2, 0.2)
    )
    found = words(draw_gcode_layer(sheet, "part.gcode"))

    assert found[0] == "part.gcode: layer 1 of 1, z 0.2 mm, 0.2 mm high"
    assert found[1:-1] == ["External perimeter", "Top solid infill"]


def test_the_legend_leaves_out_what_the_box_leaves_out() -> None:
    sheet = laid(";TYPE:Perimeter", *ZIGZAG, ";TYPE:Skirt", *path([(-9, -9), (30, -9)], 0.2, 0.2))
    picture = draw_gcode_layer(sheet, "", View(((10.0, 4.0), (2.0, 8.0))))

    assert words(picture)[1:-1] == ["Perimeter"]


def test_ways_of_the_nozzle_are_seen_if_they_are_asked_for() -> None:
    sheet = laid(*path([(0, 0), (9, 0)], 0.2, 0.2), "G0 X9 Y4", *path([(0, 4), (3, 4)], 0.2, 0.2))
    with_them, without = (draw_gcode_layer(sheet, "", View(travel=travel)) for travel in (True, False))
    ways = [one for one in with_them.shapes if isinstance(one, Line) and one.name == "travel"]

    assert [len(way.points) for way in ways] == [3]
    assert float(np.hypot(*np.diff(ways[0].points, axis=0).T).sum()) == pytest.approx(
        13 * scale_of(with_them)
    )
    assert [one for one in without.shapes if isinstance(one, Line) and one.name == "travel"] == []
    assert "Travel" in words(with_them)
    assert "Travel" not in words(without)


Corner = st.tuples(st.integers(-40, 60), st.integers(-40, 60))


@given(st.lists(Corner, min_size=2, max_size=12), Corner, Corner)
def test_a_box_shows_what_a_cut_of_the_beads_shows(
    corners: list[tuple[int, int]], one: tuple[int, int], other: tuple[int, int]
) -> None:
    low, high = np.minimum(one, other) / 2, np.maximum(one, other) / 2 + 1.0
    sheet = laid(*path([(x / 2, y / 2) for x, y in [*corners, (70, 70)]], 0.2, 0.2, 0.5))
    picture = draw_gcode_layer(sheet, "", View(((low[0], high[1]), (high[0], low[1])), pixels=500))
    scale = scale_of(picture)
    drawn = sum(
        float(np.hypot(*np.diff(line, axis=0).T).sum()) for s in strokes(picture, "edge") for line in s.lines
    )
    around = shapely.box(*(low - 0.25), *(high + 0.25))
    lines = shapely.linestrings(np.stack([sheet.beads.begin, sheet.beads.end], axis=1))
    expected = float(shapely.length(shapely.intersection(lines, around)).sum())

    assert drawn / scale == pytest.approx(expected, abs=1e-3)


@given(clean_areas(1))
def test_the_section_is_cut_to_the_box_with_its_holes(areas: Areas) -> None:
    sheet = laid(*path([(-30, -30), (30, 30)], 0.2, 0.2))
    picture = draw_gcode_layer(sheet, "", View(((-5.0, -5.0), (7.0, 4.0)), 800, section=list(areas.rings(0))))
    scale = scale_of(picture)
    rings = [ring for one in picture.shapes if isinstance(one, Fill) for ring in one.rings]
    x, y = 4 / scale * np.ones(2)
    expected = shape(areas, 0).intersection(shapely.box(-5 - x, -5 - y, 7 + x, 4 + y)).area
    turned = sum(
        float(ring[:, 0] @ np.roll(ring[:, 1], -1) - ring[:, 1] @ np.roll(ring[:, 0], -1)) for ring in rings
    )

    assert abs(turned) / 2 / scale**2 == pytest.approx(expected, abs=1e-3)


def test_the_svg_has_every_line_to_a_tenth_of_a_px() -> None:
    picture = draw_gcode_layer(laid(*ZIGZAG), "a & b")
    root = ET.fromstring(picture.svg())  # this package wrote it
    (edge,) = strokes(picture, "edge")
    (found,) = [one for one in root.iter(f"{SVG}path") if one.get("class") == "edge"]
    numbers = np.array([int(word) for word in re.findall(r"-?\d+", found.attrib["d"])]).reshape(-1, 2)

    assert np.abs(np.cumsum(numbers, axis=0) / 10 - edge.lines[0]).max() <= 0.3
    assert float(found.attrib["stroke-width"]) / 10 == pytest.approx(edge.widths[0], abs=0.01)
    assert root.findtext(f"{SVG}title") == "a & b: layer 1 of 1, z 0.2 mm, 0.2 mm high"


def test_a_layer_of_thousands_of_beads_makes_a_small_file() -> None:
    back_and_forth = [
        (x / 4, y) for i in range(1000) for x, y in ([(i, 0), (i, 9)] if i % 2 else [(i, 9), (i, 0)])
    ]
    text = draw_gcode_layer(laid(*path(back_and_forth, 0.2, 0.2, 0.25)), "").svg()

    assert len(text) < 40_000


def test_a_layer_without_a_place_cannot_be_drawn() -> None:
    deposit = extrusions_of_gcode(b"M83\nG1 X5 E1 Z0.2\nG1 X9 E1 Z0.2")
    sheet = extrusions_of_layer(deposit, file_layers_of(deposit, stack_extrusions(deposit.beads)), 0)
    empty = LayerExtrusions(
        0, 1, 0.2, 0.2, sheet.beads.take(np.zeros(0, np.int64)), np.zeros(0), (), np.zeros((0, 2, 2))
    )

    with pytest.raises(ValueError, match="nothing to draw"):
        draw_gcode_layer(empty, "")


def test_contoured_extrusions_are_coloured_by_their_height() -> None:
    _, text = example("wedge 10", "lowered")
    gcode = extrusions_of_gcode(text.encode())
    layers = file_layers_of(gcode, stack_extrusions(gcode.beads))
    layer = extrusions_of_layer(gcode, layers, 10)
    kind, kinds = find_kinds(layer)
    names = [name for name, _ in kinds]

    assert layers.n_layers == 20
    assert [name for name in names if name.startswith("Contoured")] == [
        f"Contoured, {low:.2g} to {low + 0.05:.2g} mm high" for low in (0.05, 0.1, 0.15)
    ]
    assert len({colour for _, colour in kinds}) == len(names) == kind.max() + 1
    assert "Contoured, 0.1 to 0.15 mm high" in words(draw_gcode_layer(layer, ""))
