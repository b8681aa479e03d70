"""Beds that do not begin at the origin, and nozzles that reach beside them."""

from __future__ import annotations

import pytest

from printer_slicer import dry_run, job_of, load_mesh, load_profile, profile_with
from printer_slicer.inspection.dry_run.machines import machine_of

HEATED = "G28\nM104 S215\nM140 S60\nM190 S60\nM109 S215\nM200 D0\nM300 S440 P10\n"
BESIDE = {"printer.start_gcode": f"{HEATED}G1 X-8 Y10 Z2 F3000\n"}


def test_a_bed_lies_where_its_left_and_front_edge_are() -> None:
    usual = load_profile()
    moved = profile_with(usual, {"printer.bed_left": 5, "printer.bed_front": -3})
    centred = profile_with(usual, {"printer.origin": "centre", "printer.bed_left": 5})

    assert moved.printer.corners == ((5, -3), (225, 217))
    assert centred.printer.corners == ((-105, -110), (115, 110))


def test_a_part_lies_in_the_middle_of_a_bed_that_begins_elsewhere() -> None:
    profile = profile_with(load_profile(quality="standard"), {"printer.bed_left": 50})
    program = job_of(load_mesh("sample_parts/box.stl"), profile).program
    assert program is not None

    assert program.xyz[:, 0].min() + program.xyz[:, 0].max() == pytest.approx(2 * 160, abs=1)


@pytest.mark.parametrize("reach", [0, 8])
def test_the_nozzle_goes_beside_the_bed_as_far_as_it_reaches(reach: float) -> None:
    profile = profile_with(load_profile(quality="standard"), BESIDE | {"printer.reach": reach})
    verdict = dry_run(job_of(load_mesh("sample_parts/box.stl"), profile), profile)

    assert machine_of(profile.printer).box_min[0] == -reach
    assert verdict.ok is (reach == 8)
    assert all("out of the machine: X -8" in problem for problem in verdict.problems)
