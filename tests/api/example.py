"""Use most names of the public API. This program must pass mypy --strict, and it runs as a test."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

import printer_slicer as ps


def coarse(part: ps.Mesh, profile: ps.Profile) -> ps.LayerPlan:
    """A planner: as few layers as the printer may print."""
    step = profile.printer.z_step
    count = int(np.ceil(part.height / profile.printer.max_layer))
    return ps.LayerPlan.from_tops(np.round(np.linspace(0, part.height, count + 1)[1:] / step) * step)


def slow(program: ps.Program) -> ps.Program:
    """A post-processor: no move over 30 mm/s."""
    return replace(program, speed=np.minimum(program.speed, 30.0))


def signed(lines: list[str]) -> list[str]:
    """A post-processor of lines."""
    return ["; made by me", *lines]


def run(model: Path, folder: Path) -> ps.Verdict:
    """From a part to what its print would come to."""
    profile: ps.Profile = ps.load_profile("marlin_220", "petg", changes={"perimeters": 3})
    chosen = ps.Strategies(planner=coarse, on_program=[slow], on_lines=[signed])
    stages: ps.Stages = ps.slice_stages(ps.load_mesh(model), profile, strategies=chosen)
    areas = stages.regions.internal_infill.area()
    certificate = ps.certify(ps.read_surface(stages.part), stages.plan)
    told = f"{stages.plan.n_layers} layers, {areas.sum():.0f} mm2, wrong by {certificate.max_error:.3f} mm"
    (folder / "told.txt").write_text(told)
    ps.draw(stages.program, layer=2).save(folder / "layer.svg")
    job: ps.Job = ps.job_of(stages, profile, strategies=chosen)
    job.save(folder / "part.gcode")
    return ps.dry_run(job, profile, on_event=lambda event: None)
