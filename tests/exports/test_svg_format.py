"""SVG: millimetres, y upward, groups with their heights, and what other programs read."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from importlib import import_module
from io import BytesIO

import numpy as np
import pytest

from printer_slicer.errors import UsageError
from printer_slicer.exports import write_svg, write_svgs
from tests.exports.readers import SVG, read_svg
from tests.exports.stacks import frame, of, signed_area, uneven
from tests.strategies import box

TINY = b"""<?xml version="1.0" encoding="UTF-8"?>
<svg xmlns="http://www.w3.org/2000/svg" xmlns:slic3r="http://slic3r.org/namespaces/slic3r"\
 xmlns:inkscape="http://www.inkscape.org/namespaces/inkscape" version="1.1" width="3.000mm" height="2.500mm"\
 viewBox="0 0 3.000 2.500" data-x="-1.000" data-y="2.500">
<desc>Contours by printer-slicer. One unit is 1 mm; coordinates are rounded, at most 0.0005 mm off, heights\
 0.00005 mm. A point X Y of the drawing is x = data-x + X, y = data-y - Y of the part.</desc>
<g id="layer0" slic3r:z="0.3000" slic3r:slice-z="0.1500" slic3r:layer-height="0.3000" inkscape:groupmode="layer"\
 inkscape:label="layer 0, z 0.3000 mm"><path fill-rule="evenodd"\
 d="M 0.000,2.500 3.000,2.500 3.000,0.000 0.000,0.000 Z"/></g>
<g id="layer1" slic3r:z="0.5000" slic3r:slice-z="0.4000" slic3r:layer-height="0.2000" inkscape:groupmode="layer"\
 inkscape:label="layer 1, z 0.5000 mm"></g>
</svg>
"""


def test_a_tiny_part_is_this_text() -> None:
    assert write_svg(of([[box(-1, 0, 2, 2.5)], []], [0.3, 0.5])) == TINY


def test_the_drawing_is_in_millimetres_and_as_large_as_the_part() -> None:
    root = read_svg(write_svg(uneven()))[0]

    assert (root["width"], root["height"]) == ("30.000mm", "40.000mm")
    assert root["viewBox"] == "0 0 30.000 40.000"


def test_what_is_higher_in_the_part_is_higher_in_the_drawing() -> None:
    low, high = box(0, 0, 1, 1), box(0, 8, 1, 9)
    root = ET.fromstring(write_svg(of([[low], [high]], [0.2, 0.4])))
    first, second = (path.attrib["d"].split()[1].split(",") for path in root.iter(f"{SVG}path"))

    assert float(second[1]) < float(first[1])


def test_groups_are_the_children_of_the_root_in_the_order_of_the_layers() -> None:
    layers = read_svg(write_svg(uneven()))[2]

    assert [layer.attributes["id"] for layer in layers] == [f"layer{i}" for i in range(5)]
    assert [layer.z for layer in layers] == [0.3, 0.5, 0.7, 0.8, 0.9]
    assert [float(layer.attributes["slice-z"]) for layer in layers] == [0.15, 0.4, 0.6, 0.75, 0.85]
    assert [float(layer.attributes["layer-height"]) for layer in layers] == [0.3, 0.2, 0.2, 0.1, 0.1]


def test_drawings_of_single_layers_share_their_box_and_hold_what_the_layered_one_holds() -> None:
    stack = uneven()
    root, _, layers = read_svg(write_svg(stack))
    singles = list(write_svgs(stack))

    assert [name for name, _ in singles] == [f"layer{i:04d}.svg" for i in range(5)]
    for (_, data), layer in zip(singles, layers, strict=True):
        own_root, _, own = read_svg(data)
        assert own_root == root
        assert [one.attributes for one in own] == [layer.attributes]
        assert all((a == b).all() for a, b in zip(own[0].rings, layer.rings, strict=True))


def test_names_of_drawings_sort_by_layer_however_many_there_are() -> None:
    stack = of([[]] * 10_001, (np.arange(1, 10_002) / 10).tolist())
    names = [name for name, _ in write_svgs(stack)]

    assert names == sorted(names)
    assert names[-1] == "layer10000.svg"


@pytest.mark.parametrize(("digits", "off"), [(0, "0.5 mm"), (3, "0.0005 mm"), (5, "0.000005 mm")])
def test_the_description_tells_the_rounding(digits: int, off: str) -> None:
    stack = of([[box(0, 0, 7.123456, 3)]], [0.2])
    _, described, layers = read_svg(write_svg(stack, digits=digits))

    assert off in described
    assert abs(layers[0].rings[0][1][0] - 7.123456) <= 0.5 * 10**-digits


def test_rings_smaller_than_the_last_digit_are_counted_in_the_description() -> None:
    stack = of([[box(0, 0, 5, 5), box(1, 1, 1.0001, 1.0001)[::-1]]], [0.2])

    assert "1 rings" in read_svg(write_svg(stack))[1]
    assert "left out" not in read_svg(write_svg(uneven()))[1]


@pytest.mark.parametrize("digits", [-1, 7])
def test_digits_that_make_no_sense_are_refused(digits: int) -> None:
    with pytest.raises(UsageError, match="digits"):
        write_svg(uneven(), digits=digits)
    with pytest.raises(UsageError, match="digits"):
        next(write_svgs(uneven(), digits=digits))


def test_another_library_reads_the_same_contours_in_its_own_units() -> None:
    svgelements = pytest.importorskip("svgelements")
    drawing = svgelements.SVG.parse(BytesIO(write_svg(of([frame(-3, 5)], [0.2]))), ppi=25.4, reify=True)
    (path,) = [element for element in drawing.elements() if isinstance(element, svgelements.Path)]
    # y runs downward in the drawing; the last segment of each ring closes it.
    rings = [np.array([(part.end.x, -part.end.y) for part in sub][:-1]) for sub in path.as_subpaths()]

    # At 25.4 px per inch a px is a mm: the size of the document and of the view box agree.
    assert (drawing.width, drawing.height) == (pytest.approx(10), pytest.approx(10))
    # The library takes a mm for 3.77953 px of 96 per inch, which is 5e-7 too much.
    assert [signed_area(ring) for ring in rings] == pytest.approx([100, -16, 4], rel=1e-5)


def test_a_path_library_reads_the_same_areas() -> None:
    pytest.importorskip("svgpathtools")
    parse = import_module("svgpathtools").parse_path
    root = ET.fromstring(write_svg(of([frame()], [0.2])))
    (d,) = [path.attrib["d"] for path in root.iter(f"{SVG}path")]

    # y runs downward in the drawing, so areas have the other sign there.
    assert [round(sub.area(), 6) for sub in parse(d).continuous_subpaths()] == [-100, 16, -4]
