"""The whole slicer on one page: Mesh -> LayerPlan -> Sections -> Walls -> Regions -> Toolpaths -> Program -> lines."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from printer_slicer.adhesion import adhesion_paths
from printer_slicer.errors import PartError
from printer_slicer.extrusion import extrude, move_seconds
from printer_slicer.gcode import write_gcode
from printer_slicer.infill import infill_paths
from printer_slicer.model import LayerPlan, Mesh, Program, Regions, Sections, Toolpaths, Walls
from printer_slicer.ordering import order
from printer_slicer.perimeters import lay_walls, perimeter_paths
from printer_slicer.placing import place
from printer_slicer.planning import plan_layers
from printer_slicer.profile import Profile
from printer_slicer.regions import classify
from printer_slicer.slicing import cut

__all__ = ["Report", "Stages", "gcode_of", "quiet", "slice_part", "slice_stages"]

Report = Callable[[str], None]


def quiet(stage: str) -> None:
    """A `report` that says nothing."""


@dataclass(frozen=True, slots=True, eq=False)
class Stages:
    """Every value on the way from a part to its moves."""

    part: Mesh
    sections: Sections
    walls: Walls
    regions: Regions
    toolpaths: Toolpaths
    program: Program


def slice_stages(
    mesh: Mesh, profile: Profile, *, plan: LayerPlan | None = None, report: Report = quiet
) -> Stages:
    """Slice a part and keep the value of each stage.

    Args:
        mesh: the part, anywhere; it is put on the middle of the bed.
        profile: printer, material and quality.
        plan: the layers, if not the profile's planner shall choose them.
        report: is told the name of each stage as it begins.

    Raises:
        PartError: the part does not fit, is open, or cannot be divided into layers.
    """
    report("placing")
    part = place(mesh, profile.printer)
    report("planning")
    plan = plan or plan_layers(part, profile)
    report("slicing")
    sections = cut(part, plan, profile.quality.resolution)
    report("perimeters")
    walls = lay_walls(sections, profile)
    report("regions")
    regions = classify(sections, walls, profile)
    report("toolpaths")
    paths = [adhesion_paths(sections, profile), perimeter_paths(walls), infill_paths(regions, profile)]
    if paths[1].n_paths + paths[2].n_paths == 0:
        raise PartError(
            f"{mesh.name}: no bead of {profile.extrusion_width:g} mm fits into the part",
            remedy="is the part in another unit? otherwise choose a thinner nozzle, more perimeters or denser infill",
        )
    report("ordering")
    toolpaths = order(Toolpaths.joined(plan, paths), sections, profile)
    report("extrusion")
    program = extrude(toolpaths, sections, profile)
    return Stages(part, sections, walls, regions, toolpaths, program)


def slice_part(
    mesh: Mesh, profile: Profile, *, plan: LayerPlan | None = None, report: Report = quiet
) -> Program:
    """The moves that print a part; arguments and errors are those of `slice_stages`."""
    return slice_stages(mesh, profile, plan=plan, report=report).program


def gcode_of(program: Program, profile: Profile, *, seconds: float | None = None) -> bytes:
    """The text of a program in the printer's dialect; the same program and profile give the same bytes.

    Args:
        program: the moves.
        profile: what they were made with.
        seconds: modelled time of the moves where it is known already.

    Raises:
        ProfileError: a placeholder in the start or end G-code that does not exist.
    """
    if seconds is None:
        seconds = float(move_seconds(program, profile).sum())
    return write_gcode(program, profile, seconds)
