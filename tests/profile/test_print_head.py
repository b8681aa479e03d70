"""The shapes of the print head: texts, defaults, imports."""

from __future__ import annotations

from math import hypot
from pathlib import Path

import pytest

from printer_slicer.errors import ProfileError
from printer_slicer.importing import import_profiles
from printer_slicer.profile import load_profile
from printer_slicer.profile.print_head import parse_head_shape
from tests.importing.files import json_file


def test_a_radius_becomes_a_polygon_around_the_circle() -> None:
    shape = parse_head_shape("2.5: 40")

    assert shape.height == 2.5
    radii = [hypot(x, y) for x, y in shape.corners]
    middles = [
        hypot((a[0] + b[0]) / 2, (a[1] + b[1]) / 2)
        for a, b in zip(shape.corners, shape.corners[1:] + shape.corners[:1], strict=True)
    ]
    assert min(middles) == pytest.approx(40)
    assert max(radii) < 40.2


def test_two_corners_are_a_rectangle_and_more_are_a_polygon() -> None:
    assert parse_head_shape("25:-999x-30 999x30").corners == ((-999, -30), (999, -30), (999, 30), (-999, 30))
    assert parse_head_shape("0: -2x0 0x3 2x0 0x1").corners == ((-2, 0), (2, 0), (0, 3))


def test_shapes_are_sorted_by_height() -> None:
    profile = load_profile(changes={"printer.head": "25: -999x-30 999x30, 0: 40"})

    assert [shape.height for shape in profile.printer.head_shapes] == [0, 25]


@pytest.mark.parametrize(
    ("text", "problem"),
    [("0: 0", "has no area"), ("40", "head"), ("0: 1x2", "expected text"), ("0: 1x2 1x9", "has no area")],
)
def test_shapes_without_area_or_height_are_rejected(text: str, problem: str) -> None:
    with pytest.raises(ProfileError, match=problem):
        load_profile(changes={"printer.head": text})


def test_shipped_printers_have_a_head_that_reaches_everywhere_at_some_height() -> None:
    head = load_profile("creality_ender3").printer.head_shapes

    assert [shape.height for shape in head] == [0, 34]
    assert min(x for x, _ in head[-1].corners) == -999


def test_the_head_of_orcaslicer_has_rods_along_x_and_a_lid(tmp_path: Path) -> None:
    values = {
        "type": "machine",
        "name": "Rods",
        "printable_area": ["0x0", "220x0", "220x220", "0x220"],
        "printable_height": "250",
        "gcode_flavor": "klipper",
        "nozzle_diameter": ["0.4"],
        "extruder_clearance_radius": "47",
        "extruder_clearance_height_to_rod": "34",
        "extruder_clearance_height_to_lid": "140",
    }
    imported = import_profiles(json_file(tmp_path / "machine.json", values))

    values = next(one.values for one in imported if one.kind == "printer")
    assert values["head"] == ["0: 47", "34: -9999x-47 9999x47", "140: -9999x-9999 9999x9999"]
