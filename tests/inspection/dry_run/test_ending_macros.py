"""Heaters at the end of a file whose last word is a macro of the printer's own."""

from __future__ import annotations

import pytest

from printer_slicer.inspection.dry_run.runner import dry_run
from printer_slicer.profile import load_profile
from printer_slicer.slice_jobs import job_of
from tests.parts import box

PART = box((10.0, 10.0, 1.0))


@pytest.mark.parametrize("macro", ["PRINT_END", "print_end", "END_PRINT PARK=1", "M107\n_MY_END_OF_PRINT"])
def test_a_macro_that_ends_prints_may_switch_heaters_off_which_is_said(macro: str) -> None:
    profile = load_profile("corexy_klipper", quality="standard", changes={"end_gcode": f"{macro}\n"})
    verdict = dry_run(job_of(PART, profile), profile)

    assert verdict.ok, verdict.problems
    told = [note for note in verdict.notes if "stays on" in note]
    assert len(told) == 2, verdict.notes
    assert all(macro.rsplit("\n", maxsplit=1)[-1].split(maxsplit=1)[0] in note for note in told)


@pytest.mark.parametrize("macro", ["PRINT_START", "M107", "SET_FAN_SPEED FAN=end SPEED=0", ""])
def test_other_commands_do_not(macro: str) -> None:
    profile = load_profile("corexy_klipper", quality="standard", changes={"end_gcode": f"{macro}\n"})
    verdict = dry_run(job_of(PART, profile), profile)

    assert not verdict.ok
    assert sum("stays on" in problem for problem in verdict.problems) == 2


def test_klippers_own_command_does() -> None:
    profile = load_profile("corexy_klipper", quality="standard", changes={"end_gcode": "TURN_OFF_HEATERS\n"})
    verdict = dry_run(job_of(PART, profile), profile)

    assert verdict.ok
    assert not [note for note in verdict.notes if "stays on" in note]


def test_firmware_without_macros_is_not_believed_to_have_one() -> None:
    profile = load_profile("marlin_220", quality="standard", changes={"end_gcode": "PRINT_END\n"})
    verdict = dry_run(job_of(PART, profile), profile)

    assert not verdict.ok
    assert sum("stays on" in problem for problem in verdict.problems) == 2
