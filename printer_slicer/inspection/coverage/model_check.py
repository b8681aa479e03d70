"""Check G-code of any slicer against its model: find where the model is and measure the coverage."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import numpy as np

from printer_slicer.arguments import PATH, check_arguments
from printer_slicer.arrays import Int
from printer_slicer.commands import read_text, reject_binary_gcode
from printer_slicer.diagnostics import Diagnostic
from printer_slicer.errors import PartError, UsageError
from printer_slicer.geometry import Areas, offset_open
from printer_slicer.healing import repair
from printer_slicer.inspection.coverage.gcode_extrusions import GcodeExtrusions, extrusions_of_gcode
from printer_slicer.inspection.coverage.limits import CoverageLimits, findings
from printer_slicer.inspection.coverage.matching import Match, find_detached_extrusions
from printer_slicer.inspection.coverage.measurement import Coverage, CoverageRules, coverage_of
from printer_slicer.inspection.coverage.model_match import (
    MIN_MATCH_SHARE,
    RESOLUTION,
    MatchedPart,
    match_part,
)
from printer_slicer.inspection.coverage.object_layers import has_thick_perimeters, join_equal_layers
from printer_slicer.inspection.coverage.stack import Stack, stack_extrusions
from printer_slicer.inspection.deposition.marks import Purpose
from printer_slicer.mesh_io import load_mesh
from printer_slicer.model import LayerPlan, Mesh
from printer_slicer.placing import Placement
from printer_slicer.progress import Report, quiet
from printer_slicer.slicing import cut
from printer_slicer.values import Struct, field

__all__ = ["Check", "CheckOptions", "check_gcode", "place_sections", "read_gcode_extrusions"]

_ROUNDING: Final = 0.01  # mm; files round heights by up to this
_MIN_MISSING_AREA: Final = (
    1.0  # mm², printable area of all missing layers together; a smaller tip may be missing
)
_MIN_NEEDLE_AREA: Final = 1.0  # mm²; slicers print tips of this area, even if narrower than a usual line


class Check(Struct, frozen=True, eq=False):
    """The result of checking a G-code file against its model.

    Attributes:
        name: name of the file.
        coverage: the measured coverage.
        match: position of the part relative to the mesh, and the quality of the fit.
        matched: whether the position was searched for; otherwise it was given.
        z: mm, height of the part above the z position of its mesh.
        part_top: z of the top of the part, mm.
        findings: diagnostics, the worst first.
        problems: problems of the whole file, as text.
        notes: assumptions, as text.
        deposit: extrusions of the file.
    """

    name: str
    coverage: Coverage
    match: Match
    matched: bool
    z: float
    part_top: float
    findings: tuple[Diagnostic, ...]
    problems: tuple[str, ...]
    notes: tuple[str, ...]
    deposit: GcodeExtrusions

    @property
    def ok(self) -> bool:
        """Whether the check found no problems."""
        return not (self.findings or self.problems)


class CheckOptions(Struct, frozen=True):
    """Options of a check: parameters of the measurement, limits, and facts about the file.

    Attributes:
        rules: parameters of the measurement.
        limits: limits that cause findings.
        filament_diameter: mm; None takes the value in the file.
        placement: position of the part; None searches for it.
    """

    rules: CoverageRules = field(default_factory=CoverageRules)
    limits: CoverageLimits = field(default_factory=CoverageLimits)
    filament_diameter: float | None = None
    placement: Placement | None = None


USUAL: Final = CheckOptions()


@check_arguments(text=(bytes, *PATH), mesh=(Mesh, *PATH), asked=CheckOptions)
def check_gcode(
    text: bytes | str | os.PathLike[str],
    mesh: Mesh | str | os.PathLike[str],
    asked: CheckOptions = USUAL,
    *,
    name: str = "",
    report: Report = quiet,
) -> Check:
    """Check G-code against the part that it should print.

    Args:
        text: G-code of any slicer, or the path of its file.
        mesh: the part, repaired, scaled and rotated, at any position; or the path of a model file, which is repaired.
        asked: options of the check.
        name: name of the file, for messages; empty: that of the path.
        report: function that is called with the name of each stage.

    Raises:
        UsageError: a file cannot be read, or the G-code extrudes nothing or is binary.
        PartError: the part cannot be cut.
    """
    report("reading")
    name = name or ("G-code" if isinstance(text, bytes) else Path(text).name)
    text = text if isinstance(text, bytes) else read_text(Path(text))
    mesh = mesh if isinstance(mesh, Mesh) else repair(load_mesh(mesh))[0]
    deposit, stack = read_gcode_extrusions(text, asked.filament_diameter, name)
    report("matching")
    matched = match_part(mesh, deposit.beads, stack, asked.placement)
    report("measuring")
    stack, sections = matched.stack, matched.sections
    beside = find_detached_extrusions(stack, sections)
    coverage = coverage_of(stack, sections, asked.rules, beside, matched.parts)
    return Check(
        name,
        coverage,
        matched.match,
        asked.placement is None,
        float(matched.bounds[0, 2] - mesh.bounds[0, 2]),
        float(matched.bounds[1, 2]),
        findings(coverage, asked.limits),
        tuple(_find_problems(coverage, matched)),
        tuple(_list_notes(deposit, coverage)),
        deposit,
    )


def read_gcode_extrusions(
    text: bytes, filament_diameter: float | None, name: str
) -> tuple[GcodeExtrusions, Stack]:
    """Return the extrusions of a G-code text, and the layers of the part in them.

    Args:
        text: G-code of any slicer.
        filament_diameter: mm; None takes the value in the file.
        name: name of the file, for messages.

    Raises:
        UsageError: the text extrudes nothing, or is binary.
    """
    reject_binary_gcode(text, name)
    deposit = extrusions_of_gcode(text, filament_diameter=filament_diameter)
    stack = stack_extrusions(deposit.beads)
    if not stack.n_layers:
        raise UsageError(f"{name}: no extrusion of a part found", remedy="Check that the file has E values")
    return deposit, stack


def place_sections(
    mesh: Mesh, deposit: GcodeExtrusions, stack: Stack, placement: Placement | None = None
) -> tuple[Stack, Areas, Match]:
    """Place a part at its position in a file; return its layers, its sections, and how well they fit.

    Args:
        mesh: the part, repaired, scaled and rotated, at any position.
        deposit: extrusions of the file.
        stack: layers of the file.
        placement: position of the part; None searches for it.

    Returns:
        The layers of the part, which may be fewer than those of the file; a section for each layer; and the shift from
        the position of the mesh. Layers of different objects with the same top are one layer.

    Raises:
        PartError: the part cannot be cut.
    """
    matched = match_part(mesh, deposit.beads, stack, placement)
    return *join_equal_layers(matched.stack, matched.sections), matched.match


def _find_problems(coverage: Coverage, matched: MatchedPart) -> Iterator[str]:
    """Yield messages about problems of the whole file."""
    stack, match = coverage.stack, matched.match
    if match.share < MIN_MATCH_SHARE:
        yield (
            f"only {match.share:.0%} of the external perimeters match this model: "
            "check model, scale and rotation"
        )
    if coverage.astray.any():
        lines = stack.beads.line[coverage.astray]
        many = f"{len(lines)} extrusions are" if len(lines) > 1 else "1 extrusion is"
        yield f"{many} far from the part, the first in line {lines[0]}"
    for number, part in enumerate(matched.parts):
        yield from _find_height_problems(coverage, part, np.flatnonzero(stack.group == number))


def _find_height_problems(coverage: Coverage, part: Mesh, layers: Int) -> Iterator[str]:
    """Yield a message if a part does not end at the top of its layers, given by their indices in the stack."""
    if not len(layers):
        yield f"nothing of {part.name} is printed"
        return
    stack = coverage.stack
    z, height = float(stack.top[layers[-1]]), float(stack.height[layers[-1]])
    missing_height = part.height - z
    if -missing_height > height + _ROUNDING or _has_missing_top(part, coverage, z, height):
        where = "below" if missing_height > 0 else "above"
        of_what = f"of {part.name}" if stack.group.any() else "of the part"
        yield (f"the last layer ends at z {z:.3g} mm, {abs(missing_height):.3g} mm {where} the top {of_what}")


def _has_missing_top(part: Mesh, coverage: Coverage, z: float, height: float) -> bool:
    """Return whether printable layers are missing above the last layer, at z; thin tips do not count."""
    missing_height = part.height - z
    if missing_height <= height / 2 + _ROUNDING:
        return False
    count = max(int(missing_height / height + 0.5), 1)
    top = z + height * np.arange(1.0, count + 1, dtype=np.float64)
    try:
        above = cut(part, LayerPlan(top, top - height / 2), RESOLUTION).solid
    except PartError:  # the missing top is too thin to have a section
        return False
    width = coverage.stack.beads.take(np.flatnonzero(coverage.of_part)).usual_width
    is_printable = offset_open(above, width / 2).area().sum() > _MIN_MISSING_AREA
    return bool(
        is_printable or (missing_height > height + _ROUNDING and above.area().sum() > _MIN_NEEDLE_AREA)
    )


def _list_notes(deposit: GcodeExtrusions, coverage: Coverage) -> Iterator[str]:
    """Yield notes for users: what was assumed, and how much material does not belong to the part."""
    stack = coverage.stack
    if not deposit.diameter_known:
        diameter = f"{deposit.diameter[0]:g} mm is assumed (set it with `filament_diameter`)"
        yield f"the file does not name the filament diameter: {diameter}"
    if (deposit.beads.purpose[coverage.of_part] == Purpose.UNKNOWN).all():
        depth = "a shell of two lines is assumed (set it with `shell`)"
        yield f"the file does not name roles: {depth}"
    if stack.is_spiral:
        yield "spiral vase: every turn counts as a layer; the first and the last are not checked"
    if stack.group.any():
        yield f"objects or features have layers of their own: {stack.n_layers} at {stack.number[-1]} heights"
    elif has_thick_perimeters(deposit.beads, stack):
        yield (
            "objects or features have layers of their own, but are compared on common layers: position, outline and "
            "shell are not reliable. Slice with planner.stacks = one to check the model"
        )
    volume = stack.beads.volume
    beside = float(volume[~coverage.of_part & (stack.beads.purpose != Purpose.SUPPORT_MATERIAL)].sum())
    if beside > 0.1:
        yield f"{beside:.1f} mm³ beside the part (skirt, brim, priming)"
    support = float(volume[stack.beads.purpose == Purpose.SUPPORT_MATERIAL].sum())
    if support > 0:
        yield f"{support:.1f} mm³ of supports"
    if deposit.standing > 0.1:
        yield f"{deposit.standing:.1f} mm³ extruded without motion"
