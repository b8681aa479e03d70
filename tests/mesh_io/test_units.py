"""Which unit a file was probably meant in."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tiny_files import CORNERS, binary_stl, glb_box, item, mesh_xml, model_xml, three_mf, write

from printer_slicer.cli import arguments
from printer_slicer.mesh_io import UNITS, likely_unit, load_model, unit_advice

ROOM = np.array([220.0, 220.0, 250.0])


@pytest.mark.parametrize(
    ("largest", "unit", "guess"),
    [
        (0.04, "mm", "m"),
        (0.2, "mm", "m"),
        (0.3, "mm", "inch"),
        (0.5, "mm", "inch"),
        (0.0001, "mm", ""),
        (2.0, "mm", "inch"),
        (3.0, "mm", "inch"),
        (3.01, "mm", ""),
        (60.0, "mm", ""),
        (220.0, "mm", ""),
        (3000.0, "mm", "micron"),
        (60_000.0, "mm", "micron"),
        (1e6, "mm", ""),
        (60_000.0, "m", "mm"),
        (3000.0, "m", "mm"),
        (2540.0, "inch", "mm"),
        (300.0, "cm", "mm"),
        (0.06, "micron", "mm"),
    ],
)
def test_the_guess_makes_the_part_printable(largest: float, unit: str, guess: str) -> None:
    size = np.array([largest, largest / 2, largest / 3])

    assert likely_unit(size, unit, ROOM) == guess


@given(st.floats(1e-6, 1e7), st.floats(0.01, 1), st.sampled_from(sorted(UNITS)))
def test_a_guess_is_another_unit_in_which_the_part_fits(largest: float, ratio: float, unit: str) -> None:
    size = np.array([largest, largest * ratio, largest])
    guess = likely_unit(size, unit, ROOM)

    if guess:
        assert guess != unit
        assert (size * UNITS[guess] / UNITS[unit] <= ROOM + 1e-6).all()
        assert (size * UNITS[guess] / UNITS[unit] >= 0.1 - 1e-9).all()
        assert f'`units="{guess}"`' in unit_advice(size, unit, ROOM)
    if 3 < largest <= 220:
        assert guess == ""


def test_no_guess_makes_an_edge_too_thin_to_print() -> None:
    assert likely_unit(np.array([3000.0, 10.0, 10.0]), "mm", ROOM) == ""
    assert likely_unit(np.array([3000.0, 100.0, 100.0]), "mm", ROOM) == "micron"
    assert likely_unit(np.array([0.04, 0.03, 1e-6]), "mm", ROOM) == ""
    assert "`scale`" in unit_advice(np.array([0.04, 0.03, 1e-6]), "mm", ROOM)


def test_without_a_printer_two_metres_are_too_much() -> None:
    assert likely_unit(np.array([2001.0, 500, 500]), "m") == "mm"
    assert likely_unit(np.array([1999.0, 500, 500]), "m") == ""


def test_a_small_part_without_a_guess_is_told_to_be_scaled() -> None:
    assert "`scale`" in unit_advice(np.array([1e-5, 1e-5, 1e-5]), "mm")


def test_a_model_says_what_makes_it_doubtful(tmp_path: Path) -> None:
    small = load_model(
        write(tmp_path, binary_stl(0.01 * CORNERS[[[0, 2, 1], [0, 1, 4], [0, 4, 2], [1, 2, 4]]]), "a.stl")
    )
    large = load_model(write(tmp_path, glb_box(), "b.glb"))
    usual = load_model(write(tmp_path, three_mf(model_xml({1: mesh_xml(5 * CORNERS)}, item(1))), "c.3mf"))

    assert "a.stl: the part is only 0.02 x 0.03 x 0.04 mm; if the file is in metres," in small.size_warning()
    assert '`units="m"` makes the part 20 x 30 x 40 mm' in small.size_warning()
    assert "b.glb: the part is 2000 x 4000 x 3000 mm" in large.size_warning(ROOM)
    assert 'millimetres, `units="mm"` makes the part 2 x 4 x 3 mm' in large.size_warning(ROOM)
    assert usual.size_warning() == ""


def test_the_command_line_knows_the_same_units() -> None:
    assert tuple(UNITS) == arguments.UNITS
