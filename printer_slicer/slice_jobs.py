"""Make print jobs from models: slice, write G-code, and lint it like a file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Final

from printer_slicer.gcode_text import gcode_of
from printer_slicer.inspection.lint.scan import lint_file, lint_text
from printer_slicer.jobs import Job, is_gcode
from printer_slicer.mesh_io import load_mesh
from printer_slicer.model import Mesh
from printer_slicer.pipeline import slice_stages
from printer_slicer.placing import IN_THE_MIDDLE, Placement
from printer_slicer.profile import Profile
from printer_slicer.progress import Report, quiet
from printer_slicer.stages import Stages
from printer_slicer.strategies import OURS, Strategies

__all__ = ["job_from", "job_of"]

_ALLOWED: Final = frozenset({"wait"})  # pauses come from the settings


def job_from(path: Path, profile: Profile, *, report: Report = quiet, strict: bool = False) -> Job:
    """Make a job from a file: slice a model, or read a G-code file unchanged.

    Args:
        path: model or G-code file.
        profile: printer, material and quality.
        report: called with the name of each stage when it starts.
        strict: raise an error if the mesh needs repair.

    Raises:
        PrinterSlicerError: the file cannot be read, sliced or sent.
    """
    if is_gcode(path):
        report("reading")
        return lint_file(path, profile)
    report("loading")
    return job_of(load_mesh(path), profile, name=path.name, report=report, strict=strict)


def job_of(  # noqa: PLR0913 - all options have defaults
    part: Mesh | Stages,
    profile: Profile,
    *,
    name: str = "",
    placement: Placement = IN_THE_MIDDLE,
    report: Report = quiet,
    strict: bool = False,
    strategies: Strategies = OURS,
) -> Job:
    """Make a job from a part.

    Args:
        part: a mesh to slice, or the result of `slice_stages`; then `placement` and `strict` have no effect.
        profile: the profile to slice with.
        name: name of the job; empty: that of the part.
        placement: position of the part.
        report: called with the name of each stage when it starts.
        strict: raise an error if the mesh needs repair.
        strategies: user functions that replace built-in ones.

    Raises:
        PrinterSlicerError: the part cannot be sliced.
    """
    stages = (
        part
        if isinstance(part, Stages)
        else slice_stages(
            part, profile, placement=placement, report=report, strict=strict, strategies=strategies
        )
    )
    report("writing")
    text = gcode_of(stages.program, profile, part=stages.part, labels=stages.labels, strategies=strategies)
    job = lint_text(name or stages.part.name, text, profile, dialect=strategies.flavour)
    return replace(job, program=stages.program, allowed=_ALLOWED, repairs=stages.repairs)
