"""Start G-code that raises the nozzle a little on its way to homing."""

from __future__ import annotations

import pytest

from printer_slicer.inspection.dry_run.runner import dry_run
from printer_slicer.inspection.lint.scan import scan
from printer_slicer.profile import load_profile
from printer_slicer.slice_jobs import job_of
from tests.parts import box

PART = box((10.0, 10.0, 1.0))


def refused(printer: str, move: str) -> tuple[bool, bool]:
    """Whether dry run and check refuse a file that begins with a move and homes then."""
    start = f"{move}\nG28\nM104 S200\nM109 S200\n"
    profile = load_profile(printer, quality="standard", changes={"start_gcode": start})
    job = job_of(PART, profile)
    verdict = dry_run(job, profile)
    by_check = any(one.is_error for one in scan(job.commands, profile, whole=True))
    if verdict.ok:
        assert [note for note in verdict.notes if "before homing" in note], verdict.notes
    return not verdict.ok, by_check


@pytest.mark.parametrize("move", ["G1 Z3 F300", "G91\nG1 Z5 F300\nG90"])
def test_a_small_lift_is_told_and_not_refused(move: str) -> None:
    assert refused("marlin_220", move) == (False, False)


@pytest.mark.parametrize("move", ["G1 X3 Z3 F300", "G1 Z50 F300", "G91\nG1 Z-3 F300\nG90", "G1 Y5 F300"])
def test_every_other_move_is_refused(move: str) -> None:
    assert refused("marlin_220", move) == (True, True)


def test_klipper_refuses_lifts_too() -> None:
    assert refused("corexy_klipper", "G1 Z3 F300") == (True, True)
