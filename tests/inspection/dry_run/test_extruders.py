"""Files for several extruders, and the tool that a profile prints with."""

from __future__ import annotations

from pathlib import Path

import pytest

from printer_slicer.cli import main
from printer_slicer.inspection.dry_run.judging import Verdict
from printer_slicer.inspection.dry_run.runner import dry_run
from printer_slicer.profile import load_profile, profile_with
from printer_slicer.slice_jobs import job_from, job_of
from tests.parts import box

PROFILE = load_profile("marlin_220", "pla", "standard", {})
TWO = [
    *("G28", "M104 T0 S200", "M104 T1 S210", "M109 T0 S200", "M109 T1 S210", "M83", "G1 Z0.2 F600"),
    *("T0", "G1 X50 Y50 F3000", "G1 X90 Y50 E1.5 F1200", "T1", "G1 X50 Y51 F3000", "G1 X90 Y51 E1.5 F1200"),
    *("M104 T0 S0", "M104 T1 S0"),
]


def rehearsed(folder: Path, lines: list[str], **how: int) -> Verdict:
    """The verdict on some lines."""
    path = folder / "job.gcode"
    path.write_text("\n".join(lines) + "\n")
    return dry_run(job_from(path, PROFILE), PROFILE, **how)


def test_a_file_for_two_extruders_is_good_where_there_are_two(tmp_path: Path) -> None:
    assert rehearsed(tmp_path, TWO, extruders=2).problems == ()
    assert {fault.code for fault in rehearsed(tmp_path, TWO).faults} == {"tool"}


@pytest.mark.parametrize(
    ("place", "line", "kind"),
    [(3, "M104 T1 S400", "temperature"), (3, "M104 T1 S0", "cold"), (3, "M104 T2 S200", "tool")],
)
def test_faults_of_the_second_extruder_are_judged(place: int, line: str, kind: str, tmp_path: Path) -> None:
    lines = list(TWO)
    lines[place:place] = [line]
    if kind == "cold":
        lines.remove("M109 T1 S210")
    faults = rehearsed(tmp_path, lines, extruders=2).faults

    assert [fault.code for fault in faults if fault.is_error] == [kind]


def test_a_second_hotend_that_stays_on_is_a_fault(tmp_path: Path) -> None:
    faults = rehearsed(tmp_path, [line for line in TWO if line != "M104 T0 S0"], extruders=2).faults

    assert [fault.message for fault in faults] == ["the nozzle stays on at 200 °C at the end"]


def test_extruders_may_share_a_hotend(tmp_path: Path) -> None:
    lines = [line.replace(" T0 ", " ").replace(" T1 ", " ") for line in TWO]

    assert rehearsed(tmp_path, lines, extruders=2, one_hotend=True).problems == ()
    assert rehearsed(tmp_path, lines, extruders=2).problems != ()


@pytest.mark.parametrize("place", [12, 60])
def test_a_tool_that_is_not_there_is_found_at_its_line_among_many(place: int, tmp_path: Path) -> None:
    moves = [f"G1 X{100 + at % 7} Y{100 + at % 3} E0.05" for at in range(100)]
    lines = [*TWO[:9], *moves, *TWO[-2:]]
    lines.insert(place, "M104 T3 S200")
    faults = [fault for fault in rehearsed(tmp_path, lines, extruders=2).faults if fault.code == "tool"]

    assert [fault.line for fault in faults] == [place + 1]


def test_the_tool_of_the_profile_is_there() -> None:
    profile = profile_with(PROFILE, {"printer.tool": 1})

    assert dry_run(job_of(box((10.0, 10.0, 2.0)), profile), profile).problems == ()


def test_extruders_can_be_said_on_the_command_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "two.gcode"
    path.write_text("\n".join(TWO) + "\n")

    assert main(["dry-run", str(path), "--extruders", "2"]) == 0
    assert main(["dry-run", str(path)]) == 7
    assert "no such extruder" in capsys.readouterr().err
