"""Prints that would never end: the rehearsal ends all the same, and says where it did not go on."""

from __future__ import annotations

from itertools import product
from pathlib import Path
from random import Random  # noqa: TID251 - seeded

import pytest

from printer_slicer.inspection.dry_run.runner import dry_run
from printer_slicer.profile import load_profile
from printer_slicer.sim.faults import Fault, Faults
from printer_slicer.slice_jobs import job_from
from tests.effort import crossed

PROFILE = load_profile("marlin_220", "pla", "standard", {})


@pytest.mark.parametrize(
    ("every_byte", "job"),
    crossed(
        [False, True],
        [
            (["G28", "G4 S99999999999", "M104 S0"], 2),
            (["G28", "G1 X200 F6000", "M203 X0.002", "G1 X0", "M400"], 5),
            (["M0 S999999999"], 1),
        ],
    ),
)
def test_what_is_not_done_after_a_day_is_given_up(
    every_byte: bool, job: tuple[list[str], int], tmp_path: Path
) -> None:
    lines, at = job
    path = tmp_path / "job.gcode"
    path.write_text("\n".join(lines) + "\n")
    verdict = dry_run(job_from(path, PROFILE), PROFILE, every_byte=every_byte)

    assert not verdict.ok
    assert any(f"line {at} takes longer" in problem for problem in verdict.problems)
    assert verdict.executed == at


def test_waits_of_less_than_a_day_add_up_to_a_month_at_most(tmp_path: Path) -> None:
    path = tmp_path / "job.gcode"
    path.write_text("M113 S60\n" + "M0 S80000\n" * 100)
    verdict = dry_run(job_from(path, PROFILE), PROFILE)

    assert verdict.executed == 34  # 30 days hold 32.4 of them
    assert "longer than 30" in verdict.problems[0]


@pytest.mark.parametrize(
    ("heater", "off"),
    [
        # The host asks for a day, as it does in the test above.
        *(pytest.param(heater, -5.0, marks=pytest.mark.thorough) for heater in ("bed", "E0")),
        *product(["bed", "E0"], [-0.5, 0.0, 0.5, 5.0]),
    ],
)
def test_a_sensor_stuck_near_its_target_ends_in_a_verdict(heater: str, off: float, tmp_path: Path) -> None:
    path = tmp_path / "job.gcode"
    path.write_text("M113 S60\nM140 S60\nM104 S200\nM190 S60\nM109 S200\nM104 S0\nM140 S0\n")
    reads = {"bed": 60.0, "E0": 200.0}[heater] + off
    fault = Fault("sensor", heater=heater, temperature=reads, line=2)
    faults = Faults([fault], Random(0))
    verdict = dry_run(job_from(path, PROFILE), PROFILE, faults=faults)

    # Firmware takes what it reads for true; a reading that never comes nearer is waited for.
    assert (verdict.executed == 7) == (off > -5.0)
