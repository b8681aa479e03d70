"""Files that a macro of the printer's own makes ready: what dry run and check believe of it."""

from __future__ import annotations

import pytest

from printer_slicer.inspection.dry_run.runner import dry_run
from printer_slicer.inspection.lint.scan import scan
from printer_slicer.profile import load_profile
from printer_slicer.sim.firmwares import KLIPPER
from printer_slicer.slice_jobs import job_of
from tests.parts import box

PART = box((10.0, 10.0, 1.0))


@pytest.mark.parametrize(
    "macro",
    [
        "print_start EXTRUDER=215 BED=55",
        "START_PRINT EXTRUDER_TEMP=205 BED_TEMP=68 CHAMBER_TEMP=40",
        "PRINT_START",
        "_MY_START_PRINT TOOL=0",
    ],
)
def test_a_macro_that_starts_prints_homes_and_heats_which_is_said(macro: str) -> None:
    profile = load_profile("corexy_klipper", quality="standard", changes={"start_gcode": f"{macro}\n"})
    job = job_of(PART, profile)
    verdict = dry_run(job, profile)

    assert verdict.ok, verdict.problems
    name = macro.split(maxsplit=1)[0]
    assert [note for note in verdict.notes if name in note and "home" in note], verdict.notes
    assert verdict.deposition is not None
    assert verdict.deposition.length > 0


def test_it_heats_to_what_it_is_told() -> None:
    start = "START_PRINT EXTRUDER_TEMP=205 BED_TEMP=68\n"
    profile = load_profile("corexy_klipper", quality="standard", changes={"start_gcode": start})
    told = [note for note in dry_run(job_of(PART, profile), profile).notes if "stays on" in note]
    assert not told  # the profile's end G-code switches both off
    ended = load_profile(
        "corexy_klipper", quality="standard", changes={"start_gcode": start, "end_gcode": "PRINT_END\n"}
    )
    told = [note for note in dry_run(job_of(PART, ended), ended).notes if "stays on" in note]
    assert any("bed stays on at 68" in note for note in told), told


@pytest.mark.parametrize(
    "macro", ["EXCLUDE_OBJECT_START NAME=a", "TIMELAPSE_START", "PRINT_END", "M117 START_PRINT"]
)
def test_other_commands_do_not(macro: str) -> None:
    profile = load_profile("corexy_klipper", quality="standard", changes={"start_gcode": f"{macro}\n"})
    job = job_of(PART, profile)

    assert any("homing" in problem for problem in dry_run(job, profile).problems)
    assert {"homing", "cold"} <= {one.code for one in scan(job.commands, profile, whole=True)}


def test_the_simulated_klipper_has_such_a_macro_too() -> None:
    profile = load_profile(
        "corexy_klipper",
        quality="standard",
        changes={"start_gcode": "PRINT_START BED=60 EXTRUDER=210\n", "end_gcode": "print_end\n"},
    )
    verdict = dry_run(job_of(PART, profile), profile, firmware=KLIPPER)

    assert verdict.ok, verdict.problems


def test_firmware_without_macros_is_not_believed_to_have_one() -> None:
    profile = load_profile("marlin_220", quality="standard", changes={"start_gcode": "PRINT_START\n"})
    problems = dry_run(job_of(PART, profile), profile).problems

    assert any("before homing" in problem for problem in problems)
    assert any("unknown command" in problem for problem in problems)
