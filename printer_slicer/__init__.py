"""Slice a part with adaptive layer heights, export G-code, print it over USB serial, or dry-run it.

    import printer_slicer as ps

    profile = ps.load_profile(quality="adaptive")
    stages = ps.slice_stages(ps.load_mesh("part.stl"), profile)
    text = ps.gcode_of(stages.program, profile)

Names are imported when they are first used, so importing the package costs nothing.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from printer_slicer.checking import Check, check_gcode
    from printer_slicer.deviation import Deviation, measure_deviation
    from printer_slicer.drawing import draw_layer, draw_plan, layer_picture, material_picture, picture_bytes
    from printer_slicer.errors import PrinterSlicerError
    from printer_slicer.extrusion import move_seconds
    from printer_slicer.healing import repair
    from printer_slicer.jobs import Job, job_from, job_of
    from printer_slicer.mesh_io import LIMITS, Limits, Model, export_stl, load_mesh, load_model
    from printer_slicer.model import LayerPlan, Mesh, Program, Repairs, Sections
    from printer_slicer.pipeline import Stages, gcode_of, plan_part, slice_part, slice_stages
    from printer_slicer.placing import Placement, joined, place, transformed
    from printer_slicer.planning import plan_layers
    from printer_slicer.printing import print_job
    from printer_slicer.profile import Profile, load_profile, profile_with
    from printer_slicer.slicing import contours, cut
    from printer_slicer.surface import Certificate, certify, read_surface
    from printer_slicer.verdict import Verdict, dry_run

_HOMES = {
    "LIMITS": "mesh_io",
    "Certificate": "surface",
    "Check": "checking",
    "Deviation": "deviation",
    "Job": "jobs",
    "LayerPlan": "model",
    "Limits": "mesh_io",
    "Mesh": "model",
    "Model": "mesh_io",
    "Placement": "placing",
    "PrinterSlicerError": "errors",
    "Profile": "profile",
    "Program": "model",
    "Repairs": "model",
    "Sections": "model",
    "Stages": "pipeline",
    "Verdict": "verdict",
    "certify": "surface",
    "check_gcode": "checking",
    "contours": "slicing",
    "cut": "slicing",
    "draw_layer": "drawing",
    "draw_plan": "drawing",
    "dry_run": "verdict",
    "export_stl": "mesh_io",
    "gcode_of": "pipeline",
    "job_from": "jobs",
    "job_of": "jobs",
    "joined": "placing",
    "layer_picture": "drawing",
    "load_mesh": "mesh_io",
    "load_model": "mesh_io",
    "load_profile": "profile",
    "material_picture": "drawing",
    "measure_deviation": "deviation",
    "move_seconds": "extrusion",
    "picture_bytes": "drawing",
    "place": "placing",
    "plan_layers": "planning",
    "plan_part": "pipeline",
    "print_job": "printing",
    "profile_with": "profile",
    "read_surface": "surface",
    "repair": "healing",
    "slice_part": "pipeline",
    "slice_stages": "pipeline",
    "transformed": "placing",
}

__all__ = [
    "LIMITS",
    "Certificate",
    "Check",
    "Deviation",
    "Job",
    "LayerPlan",
    "Limits",
    "Mesh",
    "Model",
    "Placement",
    "PrinterSlicerError",
    "Profile",
    "Program",
    "Repairs",
    "Sections",
    "Stages",
    "Verdict",
    "certify",
    "check_gcode",
    "contours",
    "cut",
    "draw_layer",
    "draw_plan",
    "dry_run",
    "export_stl",
    "gcode_of",
    "job_from",
    "job_of",
    "joined",
    "layer_picture",
    "load_mesh",
    "load_model",
    "load_profile",
    "material_picture",
    "measure_deviation",
    "move_seconds",
    "picture_bytes",
    "place",
    "plan_layers",
    "plan_part",
    "print_job",
    "profile_with",
    "read_surface",
    "repair",
    "slice_part",
    "slice_stages",
    "transformed",
]


def __getattr__(name: str) -> object:
    """A public name, imported now."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f"printer_slicer.{_HOMES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return __all__
