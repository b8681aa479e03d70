"""Models as jobs: sliced, written, and judged like a file."""

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

_ASKED_FOR: Final = frozenset({"wait"})  # its pauses are the settings'


def job_from(path: Path, profile: Profile, *, report: Report = quiet, strict: bool = False) -> Job:
    """The job that prints a model (sliced now) or a G-code file (as it is).

    Args:
        path: of the file.
        profile: printer, material and quality.
        report: is told the name of each stage as it begins.
        strict: whether a mesh that needs repair is refused.

    Raises:
        PrinterSlicerError: the file cannot be read, sliced or sent.
    """
    if is_gcode(path):
        report("reading")
        return lint_file(path, profile)
    report("loading")
    return job_of(load_mesh(path), profile, name=path.name, report=report, strict=strict)


def job_of(  # noqa: PLR0913 - every choice has a usual value
    part: Mesh | Stages,
    profile: Profile,
    *,
    name: str = "",
    placement: Placement = IN_THE_MIDDLE,
    report: Report = quiet,
    strict: bool = False,
    strategies: Strategies = OURS,
) -> Job:
    """The job that prints a part, sliced now or before.

    Args:
        part: as a mesh, or what `slice_stages` made of it; then `placement`, `report` and `strict` had their time.
        profile: what it is sliced with.
        name: what to call the job; empty: as the part.
        placement: where the part is put.
        report: is told the name of each stage as it begins.
        strict: whether a mesh that needs repair is refused.
        strategies: functions from outside in place of ours.

    Raises:
        PrinterSlicerError: it cannot be sliced.
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
    job = lint_text(name or stages.part.name, text, profile, flavour=strategies.flavour)
    return replace(job, program=stages.program, allowed=_ASKED_FOR, repairs=stages.repairs)
