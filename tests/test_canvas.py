"""The canvas: one list of shapes, the same picture in SVG and in PNG, and what a file's name makes of it."""

from __future__ import annotations

import io
import math
import subprocess
import sys
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from hypothesis import given
from PIL import Image

from printer_slicer.drawing import check_picture_path, encode_picture
from printer_slicer.drawing.canvas import Anchor, Box, Fill, Line, Picture, Text, estimate_text_width
from printer_slicer.errors import UsageError
from printer_slicer.geometry import Areas
from tests.strategies import clean_areas
from tests.waiting import LAST_RESORT

SVG = "{http://www.w3.org/2000/svg}"


def pixels(picture: Picture) -> Any:
    """(height, width, 3) what the PNG shows."""
    return np.asarray(Image.open(io.BytesIO(picture.png())).convert("RGB"))


def dark(shapes: list[Any]) -> Any:
    """(200, 300) share of black in each pixel of a picture of black shapes."""
    return 1 - pixels(Picture(300, 200, tuple(shapes)))[:, :, 0] / 255.0


@given(clean_areas(1))
def test_areas_are_painted_as_large_as_they_are_holes_left_out(areas: Areas) -> None:
    rings = tuple(4 * ring + (150, 100) for ring in areas.rings(0))
    length = 4 * float(areas.ring_length().sum())

    assert float(dark([Fill(rings, "#000000")]).sum()) == pytest.approx(
        16 * areas.area()[0], abs=length / 4 + 2
    )


def test_boxes_and_lines_cover_what_they_say() -> None:
    box = dark([Box(10, 20, 30, 40, "#000000")])
    line = dark([Line(np.array([(50.0, 100.0), (250.0, 100.0)]), "#000000", 6)])
    dashes = dark([Line(np.array([(50.0, 100.0), (250.0, 100.0)]), "#000000", 6, (15, 5))])
    ends = dark([Line(np.array([(50.0, 100.0), (250.0, 100.0)]), "#000000", 6, round=True)])
    area = dark([Fill((np.array([(10.0, 20.0), (40.0, 20.0), (40.0, 60.0), (10.0, 60.0)]),), "#000000")])

    assert box[20:60, 10:40].min() == 1
    assert box.sum() == 30 * 40
    assert np.abs(area - box).max() < 0.4
    assert line.sum() == pytest.approx(1200, rel=0.02)
    assert dashes.sum() == pytest.approx(900, rel=0.05)
    assert ends.sum() == pytest.approx(1200 + math.pi * 9, rel=0.02)


@pytest.mark.parametrize(
    ("anchor", "begins", "ends"), [("start", 0, 1), ("middle", -0.5, 0.5), ("end", -1, 0)]
)
def test_text_stands_at_its_anchor_on_its_line(anchor: Anchor, begins: float, ends: float) -> None:
    seen = dark([Text(150, 100, "HIH³", 30, "#000000", anchor)])
    rows, columns = (np.flatnonzero(seen.any(axis=axis)) for axis in (1, 0))
    wide = columns[-1] - columns[0]

    assert 40 < wide < 100
    assert columns[0] == pytest.approx(150 + begins * wide, abs=4)
    assert columns[-1] == pytest.approx(150 + ends * wide, abs=4)
    assert 95 < rows[-1] <= 101
    assert 70 < rows[0] < 85


def test_the_png_writes_letters_with_accents_without_them() -> None:
    assert np.array_equal(dark([Text(10, 50, "é", 30)]), dark([Text(10, 50, "e", 30)]))


def test_pillow_is_only_loaded_for_a_png() -> None:
    code = (
        "import sys; from printer_slicer.drawing.canvas import *; "
        "Picture(9, 9, (Text(1, 1, 'a', 9),)).svg(); print('PIL' in sys.modules)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=LAST_RESORT, check=True
    )

    assert done.stdout.strip() == "False"


@pytest.mark.parametrize(
    ("name", "begins"), [("a.png", b"\x89PNG"), ("a.PNG", b"\x89PNG"), ("a.svg", b"<svg"), ("-", b"<svg")]
)
def test_the_name_of_a_file_says_what_it_becomes(name: str, begins: bytes) -> None:
    check_picture_path(Path(name))

    assert encode_picture(Picture(30, 20, ()), Path(name)).startswith(begins)


@pytest.mark.parametrize("name", ["a.jpg", "a", ".png", "a.svg.gz", "png"])
def test_other_kinds_of_pictures_are_refused_and_the_two_are_named(name: str) -> None:
    with pytest.raises(UsageError, match=r"(?s)\.svg or \.png"):
        encode_picture(Picture(30, 20, ()), Path(name))


# SVG


def test_shapes_are_drawn_in_their_order_and_areas_in_tenths_of_a_px() -> None:
    ring = np.array([(1.0, 2.0), (11.5, 2.0), (11.5, 7.26)])
    shapes = (Fill((ring,), "#112233", "part"), Box(1, 2, 3, 4, "#445566"), Fill((ring,), "#778899"))
    root = ET.fromstring(Picture(20, 10, shapes, "a <b> & c").svg())
    drawn = [one for one in root.iter() if one.tag in {f"{SVG}path", f"{SVG}rect"}]

    assert [one.attrib["fill"] for one in drawn] == ["#ffffff", "#112233", "#445566", "#778899"]
    assert drawn[1].attrib["d"] == "M10 20l105 0 0 53z"
    assert drawn[1].attrib["class"] == "part"
    assert [group.attrib["transform"] for group in root.iter(f"{SVG}g")] == ["scale(0.1)", "scale(0.1)"]
    assert root.findtext(f"{SVG}title") == "a <b> & c"


def test_areas_too_small_to_see_make_no_outline_and_no_fault() -> None:
    speck = Picture(20, 10, (Fill((np.full((4, 2), 5.001),), "#000000"), Fill((), "#000000")))

    assert ET.fromstring(speck.svg()).find(f".//{SVG}path") is not None
    assert pixels(speck).shape == (10, 20, 3)


@pytest.mark.parametrize("text", ["0.1 to 0.3 mm", "max error, at z 10.73 mm", "Wanderer", "iiii"])
def test_text_is_given_at_least_the_room_that_it_takes(text: str) -> None:
    columns = np.flatnonzero(dark([Text(5, 100, text, 20)]).any(axis=0))

    assert columns[-1] - columns[0] <= estimate_text_width(text, 20)
