"""`orient` and `find_orientations`: the careful search, and arguments that are wrong."""

from __future__ import annotations

import numpy as np
import pytest

import printer_slicer as ps
from tests.parts import box
from tests.supports.shapes import tee

PROFILE = ps.load_profile("marlin_220", quality="standard")


def test_the_careful_search_measures_the_best_rows_and_the_part_as_given() -> None:
    stages: list[str] = []
    found = ps.find_orientations(tee(), PROFILE, search="careful", report=stages.append)
    sliced = [row for row in found.rows if row.is_sliced]

    assert found.original.is_sliced
    assert len(sliced) == 4
    assert found.rows[: len(sliced)] == tuple(sliced)
    assert [row.cost for row in sliced] == pytest.approx(sorted(row.cost for row in sliced), rel=0.01)
    assert found.original.support_g > 1
    assert found.chosen.support_g == 0
    assert stages[0] == "orienting"
    assert stages[-1] == "slicing orientation 4 of 4"


def test_measured_minutes_are_those_of_slicing() -> None:
    part = box((20, 20, 8))
    found = ps.find_orientations(part, PROFILE, search="careful")
    program = ps.slice_part(part, PROFILE)

    assert found.original.minutes == pytest.approx(ps.move_seconds(program, PROFILE).sum() / 60, rel=1e-6)


def test_a_mesh_without_facets_is_refused() -> None:
    with pytest.raises(ps.PrinterSlicerError, match="no facets"):
        ps.orient(ps.Mesh(np.zeros((0, 3, 3))), PROFILE)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [({"search": "best"}, "no such search"), ({"keep_up": 200}, "180"), ({"keep_up": -1}, "0 to 180")],
)
def test_wrong_arguments_are_refused(arguments: dict[str, object], message: str) -> None:
    with pytest.raises(ps.PrinterSlicerError, match=message):
        ps.find_orientations(box(), PROFILE, **arguments)  # type: ignore[arg-type]


def test_slice_says_how_to_turn_a_part() -> None:
    with pytest.raises(ps.PrinterSlicerError, match="orient"):
        ps.slice(box(), orient="fast")


def test_facets_without_area_are_refused() -> None:
    line = ps.Mesh(np.array([[(0, 0, 0), (1, 1, 1), (2, 2, 2)]], np.float64), "line")

    with pytest.raises(ps.PrinterSlicerError, match="line: the facets have no area"):
        ps.orient(line, PROFILE)


def test_a_long_sliver_takes_no_time() -> None:
    sliver = ps.Mesh(np.array([[(0, 0, 0), (100, 0, 0), (0, 1e-6, 0)]], np.float64), "sliver")

    assert ps.find_orientations(sliver, PROFILE).rows


def test_a_sheet_without_volume_does_not_fail() -> None:
    sheet = ps.Mesh(np.array([[(0, 0, 0), (10, 0, 0), (0, 10, 0)]], np.float64), "sheet")

    assert ps.find_orientations(sheet, PROFILE).rows
