"""Slice parts with adaptive layer heights, write G-code, print it over USB serial, or print it on a simulated printer.

    import printer_slicer as ps

    job = ps.slice("part.stl", printer="Ender 3", material="petg", layer_height=0.2)
    job.save("part.gcode")

The result of each stage is available too:

    profile = ps.load_profile("Ender 3", "petg")
    stages = ps.slice_stages(ps.load_mesh("part.stl"), profile)
    job = ps.job_of(stages, profile)

Names are imported on first use, so importing the package is fast.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from printer_slicer import repr_svg
from printer_slicer.lazy_names import lazy_names as _lazy_names
from printer_slicer.version import VERSION as _VERSION

if TYPE_CHECKING:
    from printer_slicer.batching.api import batch
    from printer_slicer.batching.tasks import BatchResult, SlicedFile
    from printer_slicer.drawing import Picture, draw, draw_plan
    from printer_slicer.errors import PrinterSlicerError, StrategyError
    from printer_slicer.extrusion import move_seconds
    from printer_slicer.firmware import FLAVOURS, Dialect
    from printer_slicer.gcode_text import gcode_of
    from printer_slicer.geometry import Areas, Polylines
    from printer_slicer.healing import repair
    from printer_slicer.importing.familiar import load_profile, profile_with
    from printer_slicer.infill import Infill, InfillTask
    from printer_slicer.inspection.coverage.model_check import Check, check_gcode
    from printer_slicer.inspection.dry_run.judging import Verdict
    from printer_slicer.inspection.dry_run.runner import dry_run
    from printer_slicer.jobs import Job
    from printer_slicer.mesh_io import LIMITS, Limits, Model, export_stl, load_mesh, load_model
    from printer_slicer.model import (
        LayerPlan,
        Mesh,
        Overhangs,
        Program,
        Regions,
        Repairs,
        Sections,
        Toolpaths,
        Travels,
        Volumes,
        Walls,
    )
    from printer_slicer.orientation import find_orientations, orient
    from printer_slicer.orienting import Orientation, Orientations
    from printer_slicer.pipeline import overhangs, plan_part, slice_part, slice_stages
    from printer_slicer.placing import Placement, join, place, transform
    from printer_slicer.plates import arrange
    from printer_slicer.printing import Controls, PrintResult, print_job
    from printer_slicer.profile import Profile
    from printer_slicer.profile.tables import find_settings
    from printer_slicer.roles import Role
    from printer_slicer.slice_jobs import job_from, job_of, slice  # noqa: A004 - called as ps.slice
    from printer_slicer.stages import Stages
    from printer_slicer.strategies import Strategies
    from printer_slicer.surface import Certificate, certify, read_surface

_HOMES = {
    "FLAVOURS": "firmware",
    "LIMITS": "mesh_io",
    "Areas": "geometry",
    "BatchResult": "batching.tasks",
    "Certificate": "surface",
    "Check": "inspection.coverage.model_check",
    "Controls": "printing",
    "Dialect": "firmware",
    "PrintResult": "printing",
    "Infill": "infill",
    "InfillTask": "infill",
    "Job": "jobs",
    "LayerPlan": "model",
    "Limits": "mesh_io",
    "Mesh": "model",
    "Model": "mesh_io",
    "Orientation": "orienting",
    "Orientations": "orienting",
    "Overhangs": "model",
    "Picture": "drawing",
    "Placement": "placing",
    "Polylines": "geometry",
    "PrinterSlicerError": "errors",
    "Profile": "profile",
    "Program": "model",
    "Regions": "model",
    "Repairs": "model",
    "Role": "roles",
    "Sections": "model",
    "SlicedFile": "batching.tasks",
    "Stages": "stages",
    "Strategies": "strategies",
    "StrategyError": "errors",
    "Toolpaths": "model",
    "Travels": "model",
    "Verdict": "inspection.dry_run.judging",
    "Volumes": "model",
    "Walls": "model",
    "arrange": "plates",
    "batch": "batching.api",
    "certify": "surface",
    "check_gcode": "inspection.coverage.model_check",
    "draw": "drawing",
    "draw_plan": "drawing",
    "dry_run": "inspection.dry_run.runner",
    "export_stl": "mesh_io",
    "find_orientations": "orientation",
    "find_settings": "profile.tables",
    "gcode_of": "gcode_text",
    "job_from": "slice_jobs",
    "job_of": "slice_jobs",
    "join": "placing",
    "load_mesh": "mesh_io",
    "load_model": "mesh_io",
    "load_profile": "importing.familiar",
    "move_seconds": "extrusion",
    "orient": "orientation",
    "overhangs": "pipeline",
    "place": "placing",
    "plan_part": "pipeline",
    "print_job": "printing",
    "profile_with": "importing.familiar",
    "read_surface": "surface",
    "repair": "healing",
    "slice": "slice_jobs",
    "slice_part": "pipeline",
    "slice_stages": "pipeline",
    "transform": "placing",
}

__all__ = [
    "FLAVOURS",
    "LIMITS",
    "Areas",
    "BatchResult",
    "Certificate",
    "Check",
    "Controls",
    "Dialect",
    "Infill",
    "InfillTask",
    "Job",
    "LayerPlan",
    "Limits",
    "Mesh",
    "Model",
    "Orientation",
    "Orientations",
    "Overhangs",
    "Picture",
    "Placement",
    "Polylines",
    "PrintResult",
    "PrinterSlicerError",
    "Profile",
    "Program",
    "Regions",
    "Repairs",
    "Role",
    "Sections",
    "SlicedFile",
    "Stages",
    "Strategies",
    "StrategyError",
    "Toolpaths",
    "Travels",
    "Verdict",
    "Volumes",
    "Walls",
    "arrange",
    "batch",
    "certify",
    "check_gcode",
    "draw",
    "draw_plan",
    "dry_run",
    "export_stl",
    "find_orientations",
    "find_settings",
    "gcode_of",
    "job_from",
    "job_of",
    "join",
    "load_mesh",
    "load_model",
    "load_profile",
    "move_seconds",
    "orient",
    "overhangs",
    "place",
    "plan_part",
    "print_job",
    "profile_with",
    "read_surface",
    "repair",
    "slice",
    "slice_part",
    "slice_stages",
    "transform",
]


__version__ = _VERSION

__getattr__ = _lazy_names(
    __name__, _HOMES, {"Done": "PrintResult", "joined": "join", "transformed": "transform"}
)


def __dir__() -> list[str]:
    return __all__


def _draw_svg(value: object) -> str:
    """Return the drawing of a value as an SVG document, for notebooks."""
    from printer_slicer.drawing import draw  # noqa: PLC0415 - import the drawing package only when needed

    return draw(value).svg()


repr_svg.set_svg_renderer(_draw_svg)
