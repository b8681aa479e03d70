"""Common Layer Interface: header, units, both kinds."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from hypothesis import given

from printer_slicer.errors import OutputError, UsageError
from printer_slicer.exports import write_cli
from printer_slicer.model import Sections
from tests.exports.readers import read_cli
from tests.exports.stacks import closed_area, frame, of, sections, uneven
from tests.strategies import box

TINY_ASCII = b"""$$HEADERSTART
$$ASCII
$$UNITS/0.001
$$VERSION/200
// printer-slicer: rounded to whole units, x, y and z at most 0.0005 mm off //
$$LABEL/1,part
$$DIMENSION/-1.0,0.0,0.0,2.5,3.0,0.5
$$LAYERS/000003
$$HEADEREND
$$GEOMETRYSTART
$$LAYER/0
$$LAYER/300
$$POLYLINE/1,1,5,-1000,0,2500,0,2500,3000,-1000,3000,-1000,0
$$POLYLINE/1,0,5,0,1000,0,2000,1000,2000,1000,1000,0,1000
$$LAYER/500
$$GEOMETRYEND
"""


def tiny() -> Sections:
    hole = np.array([(0, 1), (0, 2), (1, 2), (1, 1)], dtype=np.float64)
    return of([[box(-1, 0, 2.5, 3), hole], []], [0.3, 0.5])


def test_a_tiny_part_is_this_text() -> None:
    assert write_cli(tiny(), binary=False) == TINY_ASCII


def test_a_tiny_part_is_these_bytes() -> None:
    data = write_cli(of([[box(0, 0, 1, 1)]], [0.2]), binary=True)
    header, geometry = data.split(b"$$HEADEREND")

    assert header.startswith(b"$$HEADERSTART\n$$BINARY\n$$UNITS/0.001\n$$VERSION/200\n")
    pieces = [
        struct.pack("<Hf", 127, 0.0),
        struct.pack("<Hf", 127, 200.0),
        struct.pack("<Hiii", 130, 1, 1, 5),
        struct.pack("<10f", 0, 0, 1000, 0, 1000, 1000, 0, 1000, 0, 0),
    ]
    assert geometry == b"".join(pieces)


def test_a_layer_without_polylines_at_zero_gives_the_first_layer_its_thickness() -> None:
    file = read_cli(write_cli(uneven(), binary=False))

    assert [round(z, 9) for z, _ in file.layers] == [0.0, 0.3, 0.5, 0.7, 0.8, 0.9]
    assert file.layers[0][1] == []


def test_solids_run_counter_clockwise_with_direction_1_and_holes_clockwise_with_direction_0() -> None:
    polylines = read_cli(write_cli(of([frame()], [0.2]), binary=True)).layers[1][1]

    assert [direction for direction, _ in polylines] == [1, 0, 1]
    assert [round(closed_area([ring]), 9) for _, ring in polylines] == [100, -16, 4]


@given(stack=sections())
def test_both_kinds_hold_exactly_the_same_numbers(stack: Sections) -> None:
    text, binary = (read_cli(write_cli(stack, binary=kind)) for kind in (False, True))

    for (z, polylines), (other_z, others) in zip(text.layers, binary.layers, strict=True):
        assert z == other_z
        assert [d for d, _ in polylines] == [d for d, _ in others]
        assert all((a == b).all() for (_, a), (_, b) in zip(polylines, others, strict=True))
    for name in ("UNITS", "VERSION", "LABEL", "DIMENSION", "LAYERS"):
        assert text.header[name] == binary.header[name]


def test_the_header_tells_unit_version_box_layers_and_rounding_but_no_date() -> None:
    file = read_cli(write_cli(uneven(), binary=False))

    assert file.header["VERSION"] == "200"
    assert file.units == 0.001
    assert [float(n) for n in file.header["DIMENSION"].split(",")] == [-20, -30, 0, 10, 10, 0.9]
    assert int(file.header["LAYERS"]) == 6
    assert file.header["LABEL"].startswith("1,")
    assert "DATE" not in file.header
    assert "0.0005 mm" in file.comments[0]


@pytest.mark.parametrize("binary", [False, True])
def test_a_finer_unit_keeps_more(binary: bool) -> None:
    ring = box(0.12345, 0.5, 7.65432, 3)
    read = [
        read_cli(write_cli(of([[ring]], [0.2]), binary=binary, units_mm=units)).layers[1][1][0][1]
        for units in (0.001, 0.00001)
    ]

    assert np.abs(read[0][:-1] - ring).max() > 4e-4
    assert np.abs(read[1][:-1] - ring).max() < 1e-9


def test_rings_smaller_than_the_unit_are_counted_in_the_header() -> None:
    stack = of([[box(0, 0, 5, 5), box(1, 1, 1.0001, 1.0001)[::-1]]], [0.2])
    file = read_cli(write_cli(stack, binary=False))

    assert len(file.layers[1][1]) == 1
    assert "1 rings" in file.comments[1]


@pytest.mark.parametrize("units", [0.0, -1.0, 2.0, float("nan"), 1e-7])
def test_units_that_make_no_sense_are_refused(units: float) -> None:
    with pytest.raises(UsageError, match="units"):
        write_cli(uneven(), binary=False, units_mm=units)


def test_layers_thinner_than_the_unit_are_refused() -> None:
    with pytest.raises(OutputError, match="layer 2 is thinner"):
        write_cli(of([frame(), frame()], [0.2, 0.2004]), binary=False)


def test_numbers_that_32_bit_floats_would_round_are_refused_in_the_binary_kind_only() -> None:
    stack = of([[box(0, 0, 200, 1)]], [0.2])

    assert write_cli(stack, binary=False, units_mm=1e-5)
    with pytest.raises(OutputError, match="16777216"):
        write_cli(stack, binary=True, units_mm=1e-5)
