"""The layer of a planted fault is the layer of the verdict."""

from __future__ import annotations

import re
from pathlib import Path
from random import Random  # noqa: TID251 - seeded

from printer_slicer.inspection.dry_run.runner import dry_run
from printer_slicer.jobs import Job
from printer_slicer.profile import load_profile
from printer_slicer.sim.faults import Fault, Faults
from printer_slicer.slice_jobs import job_from, job_of
from tests.parts import box

PROFILE = load_profile("marlin_220", "pla", "standard", {"layer_height": 0.2, "planner.kind": "uniform"})
GREETING = 2
"""Numbered lines before the first of the job."""


def struck(job: Job, layer: int) -> int:
    """Index of the command that was begun last when a fault of this layer struck."""
    faults = Faults([Fault("hang", layer=layer, seconds=0.1)], Random(0))
    dry_run(job, PROFILE, faults=faults)
    (happened,) = faults.events
    return happened.line - GREETING - 1


def test_a_prime_line_at_a_height_of_its_own_is_no_layer(tmp_path: Path) -> None:
    job = job_of(box((10.0, 10.0, 4.0)), PROFILE)

    assert len(dry_run(job, PROFILE).primed) == 1
    assert next(command for command, layer in job.marks.items() if layer == 5) == struck(job, 5)
    # Without comments there are heights to count, and nothing else.
    path = tmp_path / "bare.gcode"
    path.write_bytes(re.sub(rb";[^\n]*", b"", job.text))
    assert job.layer_of(struck(job_from(path, PROFILE), 5)) == 4
