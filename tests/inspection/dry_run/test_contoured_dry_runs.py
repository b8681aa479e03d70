"""A dry run of contoured files tells what the nozzle presses, and z moves that are too fast."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from printer_slicer.inspection.dry_run.runner import Verdict, dry_run
from printer_slicer.inspection.lint.scan import lint_text
from printer_slicer.profile import load_profile
from printer_slicer.slice_jobs import job_from
from tests.contoured_gcode import HEIGHT, KINDS, PARTS, Line, Rule, contour, example, level, printable

PROFILE = load_profile("marlin_220", "pla", "standard", {})
USUAL = Rule()


def dry_run_of(name: str, folder: Path, rule: Rule = USUAL, **changes: object) -> Verdict:
    part = PARTS[name]()
    path = folder / "part.gcode"
    path.write_bytes(printable(contour(level(part, widened=True, **changes), part, rule)))
    return dry_run(job_from(path, PROFILE), PROFILE)


def found(verdict: Verdict) -> set[str]:
    return {one.code for one in verdict.faults} - {"limits", "feed"}


@pytest.mark.parametrize("name", ["wedge 10", "wedge 20", "dome"])
def test_walls_from_low_to_high_are_not_pressed(name: str, tmp_path: Path) -> None:
    assert found(dry_run_of(name, tmp_path, external_perimeter_first=True)) == set()


def test_walls_from_high_to_low_are_pressed_by_their_difference_in_height(tmp_path: Path) -> None:
    verdict = dry_run_of("wedge 10", tmp_path)
    (pressed,) = [one for one in verdict.faults if one.code == "pressed"]

    # The next wall is one spacing higher up the slope; cells of 0.25 mm add up to half of one.
    assert pressed.times > 10
    assert "presses 0.1" in pressed.message


def test_a_level_file_is_not_pressed(tmp_path: Path) -> None:
    assert found(dry_run_of("wedge 10", tmp_path, Rule(change=level_again))) == set()


def level_again(one: Line) -> Line:
    """The end of an extrusion at the top of its layer."""
    return one | {"z": one["top"], "e": one["e"] * HEIGHT / max(one["z"] - one["top"] + HEIGHT, 0.05)}


@pytest.mark.parametrize(("degrees", "too_fast"), [(5, False), (20, True)])
def test_a_slope_along_a_path_that_is_faster_than_the_z_axis_is_told(degrees: int, *, too_fast: bool) -> None:
    steep = np.tan(np.radians(degrees))
    rows = [f"G1 X{50 + k:.3f} Y50 Z{1.2 - 0.01 * (k % 2) * steep * 100:.4f} E0.05 F2400" for k in range(30)]
    findings = lint_text("slope", printable("\n".join(rows), middle=0.0), PROFILE).findings
    told = [one for one in findings if one.code == "feed" and one.message.startswith("z moves at")]

    assert bool(told) == too_fast


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", ["wedge 5", "wedge 20", "dome"])
def test_bare_checks_find_no_errors(name: str, kind: str) -> None:
    findings = lint_text(name, printable(example(name, kind)[1]), PROFILE).findings

    assert [one.message for one in findings if one.is_error] == []
