"""The nozzle in a slab of parallel beads: where it goes too low, and how deep, wherever it goes."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pytest

from printer_slicer.diagnostics import Diagnostic
from printer_slicer.inspection.dry_run.judging import Verdict
from printer_slicer.inspection.dry_run.runner import dry_run
from printer_slicer.profile import load_profile
from printer_slicer.slice_jobs import job_from

PROFILE = load_profile("marlin_220", "pla", "standard")
LAYERS, HEIGHT, WIDTH = 15, 0.2, 0.45
TOP = LAYERS * HEIGHT


def slab() -> list[str]:
    """Beads from x 50 to 70, side by side from y 50 to 68."""
    lines = ["G28", "M109 S210", "G90", "M83", "G1 Z5 F240"]
    for layer in range(1, LAYERS + 1):
        lines += [";LAYER_CHANGE", "G1 X50 Y50 F6000", f"G1 Z{layer * HEIGHT:.2f} F240"]
        for row in range(40):
            ends = (50, 70) if row % 2 == 0 else (70, 50)
            lines += [f"G1 X{ends[0]} Y{50 + WIDTH * row:.2f} F6000", f"G1 X{ends[1]} E0.75 F1800"]
    return lines


def rehearsed(lines: Sequence[str], folder: Path) -> Verdict:
    """What a dry run of these lines says."""
    path = folder / "slab.gcode"
    path.write_text("\n".join(lines))
    return dry_run(job_from(path, PROFILE), PROFILE)


def crash(moves: Sequence[str], folder: Path) -> tuple[Diagnostic, str]:
    """The only fault of a slab after which the nozzle moves so, and the line that is to blame."""
    lines = [*slab(), "G1 Z5 F240", "G1 X45 Y55 F6000", *moves, "G1 Z5 F240", "M104 S0", "M140 S0"]
    (fault,) = rehearsed(lines, folder).faults
    assert fault.code == "crash"
    return fault, lines[fault.line - 1]


@pytest.mark.parametrize("y", [54.95, 55.0, 55.175, 55.3])
@pytest.mark.parametrize("depth", [0.25, 0.45, 1.5])
def test_it_is_found_on_beads_and_between_them(y: float, depth: float, tmp_path: Path) -> None:
    fault, line = crash([f"G1 Y{y}", f"G1 Z{TOP - depth:.2f} F240", "G1 X75 F3000"], tmp_path)

    assert line == "G1 X75 F3000"
    assert f"{depth:.2f} mm deep" in fault.message


def test_it_is_as_deep_as_it_is_in_steps(tmp_path: Path) -> None:
    steps = [f"G1 Z{TOP - depth:.2f} F240" for depth in (0.0, 0.4, 0.8, 1.2, 1.6, 2.0)]
    fault, line = crash(["G1 Z3.1", "G1 X60", *steps], tmp_path)

    assert line == "G1 Z2.20 F240"
    assert "2.00 mm deep" in fault.message


def test_deep_down_the_side_of_the_nozzle_counts(tmp_path: Path) -> None:
    """0.3 mm beside the outermost centre line, that is 0.08 mm beside the bead."""
    fault, line = crash(["G1 Y49.7", "G1 Z1.4 F240", "G1 X75 F3000"], tmp_path)

    assert line == "G1 X75 F3000"
    assert "1.60 mm deep" in fault.message


@pytest.mark.parametrize("z", [TOP, TOP - 0.05])
def test_over_the_slab_is_no_crash(z: float, tmp_path: Path) -> None:
    lines = [*slab(), f"G1 Y55 Z{z} F6000", "G1 X75", "G1 X45", "G1 Z5", "M104 S0", "M140 S0"]

    assert rehearsed(lines, tmp_path).ok
