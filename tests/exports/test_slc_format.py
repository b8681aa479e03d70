"""StereoLithography Contour: header, sampling table, ends."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from printer_slicer.errors import OutputError
from printer_slicer.exports import has_uneven_heights, write_slc
from printer_slicer.model import LayerPlan
from tests.exports.readers import read_slc
from tests.exports.stacks import closed_area, frame, of, uneven
from tests.strategies import box


def test_a_tiny_part_is_these_bytes() -> None:
    data = write_slc(of([[box(0, 0, 1, 2)]], [0.25]))
    head = (
        b"-SLCVER 2.0 -UNIT MM -TYPE PART -PACKAGE printer-slicer float32"
        b" -EXTENTS 0.000000,1.000000 0.000000,2.000000 0.000000,0.250000\r\n\x1a"
    )

    assert data[: len(head)] == head
    assert data[len(head) :] == b"".join(
        [
            bytes(256),
            struct.pack("<B4f", 1, 0.0, 0.25, 0.0, 0.0),
            struct.pack("<fI", 0.0, 1),
            struct.pack("<II", 5, 0),
            struct.pack("<10f", 0, 0, 1, 0, 1, 2, 0, 2, 0, 0),
            struct.pack("<fI", 0.25, 0xFFFFFFFF),
        ]
    )


def test_the_table_has_one_entry_for_each_run_of_equal_layers_from_its_lowest_z() -> None:
    table = np.array(read_slc(write_slc(uneven())).table)

    np.testing.assert_allclose(table, [[0, 0.3, 0, 0], [0.3, 0.2, 0, 0], [0.7, 0.1, 0, 0]], atol=1e-7)


def test_layers_have_the_z_of_their_bottoms_and_the_end_that_of_the_top() -> None:
    file = read_slc(write_slc(uneven()))

    np.testing.assert_allclose([z for z, _ in file.layers], [0, 0.3, 0.5, 0.7, 0.8], atol=1e-7)
    assert file.top == pytest.approx(0.9)
    assert file.table[0][0] == file.layers[0][0]
    assert file.gaps == 0


def test_solids_run_counter_clockwise_and_holes_clockwise() -> None:
    rings = read_slc(write_slc(of([frame()], [0.2]))).layers[0][1]

    assert [closed_area([ring]) for ring in rings] == [100, -16, 4]


def test_the_header_tells_version_unit_kind_and_box() -> None:
    header = read_slc(write_slc(uneven())).header

    assert header["SLCVER"] == "2.0"
    assert header["UNIT"] == "MM"
    assert header["TYPE"] == "PART"
    assert "float32" in header["PACKAGE"]
    assert len(header["PACKAGE"]) <= 32
    extents = [float(n) for pair in header["EXTENTS"].split() for n in pair.split(",")]
    np.testing.assert_allclose(extents, [-20, 10, -30, 10, 0, 0.9])


def test_a_plan_with_more_runs_than_the_table_holds_is_refused_with_advice() -> None:
    tops = np.cumsum(np.tile([0.1, 0.2], 128)).tolist()
    assert len(read_slc(write_slc(of([frame()] * 255, tops[:255]))).table) == 255

    with pytest.raises(OutputError, match="255 runs") as caught:
        write_slc(of([frame()] * 256, tops))

    assert "`layer_heights`" in str(caught.value)


def test_layers_that_32_bit_floats_cannot_tell_apart_are_refused() -> None:
    with pytest.raises(OutputError, match="layer 2"):
        write_slc(of([frame(), frame()], [1000.0, 1000.00001]))


@pytest.mark.parametrize(
    ("steps", "uneven_ones"),
    [([0.1, 0.2, 0.3], False), ([0.1, 0.25], True), ([0.3, 0.2], True), ([0.2] * 3, False)],
)
def test_thicknesses_that_are_no_multiples_of_the_thinnest_are_noticed(
    steps: list[float], uneven_ones: bool
) -> None:
    assert has_uneven_heights(LayerPlan.from_tops(np.cumsum(steps))) == uneven_ones
