"""Check G-code of any slicer against its model: find the position of the model and measure the coverage."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from printer_slicer.arrays import Bool
from printer_slicer.diagnostics import Diagnostic
from printer_slicer.errors import PartError, UsageError
from printer_slicer.geometry import Areas, difference, offset_open
from printer_slicer.inspection.coverage.extrusions import Extrusions
from printer_slicer.inspection.coverage.gcode_extrusions import GcodeExtrusions, extrusions_of_gcode
from printer_slicer.inspection.coverage.limits import CoverageLimits, findings
from printer_slicer.inspection.coverage.matching import (
    Match,
    find_detached,
    fit_sections,
    guess_shift,
    shift_areas,
)
from printer_slicer.inspection.coverage.measurement import Coverage, CoverageRules, coverage_of
from printer_slicer.inspection.coverage.stack import Stack, stack_extrusions
from printer_slicer.inspection.coverage.zones import footprint
from printer_slicer.inspection.deposition.marks import NOT_PART, Purpose
from printer_slicer.model import LayerPlan, Mesh
from printer_slicer.placing import Placement
from printer_slicer.progress import Report, quiet
from printer_slicer.slicing import cut

__all__ = ["Check", "CheckOptions", "check_gcode", "placed_sections", "read_gcode_extrusions"]

_RESOLUTION: Final = 0.005  # mm; sections are measured with, so they are finer than what is printed
_BESIDE: Final = 0.002  # mm over and under the middle of a layer: a flat there may be printed with either
_DIFFERENT: Final = 1.0  # mm² by which those two differ where there is a flat
_NEAR: Final = 3.0  # mm around the part: beads farther away make no layers
_ROUNDED: Final = 0.01  # mm of heights in files
_SEEN: Final = 1.0  # mm² printable in all missing layers together; a smaller tip may be missing
_NEEDLE: Final = 1.0  # mm²; slicers print tips of this area, even if narrower than a usual line
_FITS: Final = 0.5  # of the length of the outer perimeters: with less the file is of another part


@dataclass(frozen=True, slots=True, eq=False)
class Check:
    """The result of checking a G-code file against its model.

    Attributes:
        name: of the file.
        coverage: of its material.
        match: position of the model relative to the mesh, and how well it fits.
        matched: whether the position was searched; otherwise it was given.
        z: mm that the model stands over where its mesh was.
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
        """Whether nothing is beyond its limit."""
        return not (self.findings or self.problems)


@dataclass(frozen=True, slots=True)
class CheckOptions:
    """How to check: what is measured and let pass, and what is known about the file.

    Attributes:
        rules: of the coverage.
        limits: what is let pass.
        filament_diameter: mm; None: as the file says.
        placement: where the part is; None looks for it.
    """

    rules: CoverageRules = field(default_factory=CoverageRules)
    limits: CoverageLimits = field(default_factory=CoverageLimits)
    filament_diameter: float | None = None
    placement: Placement | None = None


USUAL: Final = CheckOptions()


def check_gcode(
    text: bytes, mesh: Mesh, asked: CheckOptions = USUAL, *, name: str = "G-code", report: Report = quiet
) -> Check:
    """Check G-code against the part that it should print.

    Args:
        text: of any slicer.
        mesh: the part, repaired, scaled and turned, anywhere.
        asked: how.
        name: of the file, for messages.
        report: is called with the name of each stage.

    Raises:
        UsageError: the file extrudes nothing, or is binary.
        PartError: the part cannot be cut.
    """
    report("reading")
    deposit, stack = read_gcode_extrusions(text, asked.filament_diameter, name)
    report("matching")
    part, stack, sections, match = _matched(mesh, deposit.beads, stack, asked.placement)
    report("measuring")
    coverage = coverage_of(stack, sections, asked.rules, find_detached(stack, sections))
    return Check(
        name,
        coverage,
        match,
        asked.placement is None,
        float(part.bounds[0, 2] - mesh.bounds[0, 2]),
        part.height,
        findings(coverage, asked.limits),
        tuple(_problems(coverage, match, part)),
        tuple(_notes(deposit, coverage)),
        deposit,
    )


def read_gcode_extrusions(
    text: bytes, filament_diameter: float | None, name: str
) -> tuple[GcodeExtrusions, Stack]:
    """Return the extrusions of G-code, and the layers of the part in it.

    Args:
        text: of any slicer.
        filament_diameter: mm; None: as the file says.
        name: of the file, for messages.

    Raises:
        UsageError: the text lays nothing, or is no text.
    """
    if text.startswith(b"GCDE"):
        raise UsageError(
            f"{name}: this is binary G-code", remedy="Export plain G-code, or convert it with bgcode"
        )
    deposit = extrusions_of_gcode(text, filament_diameter=filament_diameter)
    stack = stack_extrusions(deposit.beads)
    if not stack.n_layers:
        raise UsageError(f"{name}: no extrusion of a part found", remedy="Check that the file has E values")
    return deposit, stack


def placed_sections(
    mesh: Mesh, deposit: GcodeExtrusions, stack: Stack, placement: Placement | None = None
) -> tuple[Stack, Areas, Match]:
    """Return the sections of a part at its position in a file, and how well they fit.

    Args:
        mesh: the part, repaired, scaled and turned, anywhere.
        deposit: the beads.
        stack: the layers they are in.
        placement: where the part is; None looks for it.

    Returns:
        The layers that the beads of the part have, which may be fewer than those of the file; a section for each; and
        the shift from where the mesh was.

    Raises:
        PartError: the part cannot be cut.
    """
    _, stack, sections, match = _matched(mesh, deposit.beads, stack, placement)
    return stack, sections, match


def _matched(
    mesh: Mesh, beads: Extrusions, stack: Stack, placement: Placement | None
) -> tuple[Mesh, Stack, Areas, Match]:
    """Return the part in its position, its layers there, its section in each, and how well they match."""
    part = _put(mesh, stack, placement)
    pair = _cut_twice(part, stack)
    match = _fit(stack, pair[0], look=placement is None)
    part = part.moved((*match.shift, 0.0))
    own = _near_part(part, beads)
    again = stack_extrusions(beads, own)
    if own.any() and not np.array_equal(again.top, stack.top):
        # Extrusions beside the part made layers of their own, such as a line that primes the nozzle.
        stack, pair = again, _cut_twice(part, again)
    else:
        pair = (shift_areas(pair[0], match.shift), shift_areas(pair[1], match.shift))
    x, y = (part.bounds[0] - mesh.bounds[0])[:2].tolist()
    return part, stack, _choose_section(stack, *pair), replace(match, shift=(x, y))


def _put(mesh: Mesh, stack: Stack, placement: Placement | None) -> Mesh:
    """Return the part in the requested position, or on the raft or bed with its corner at the origin."""
    low, high = mesh.bounds
    by = -low
    if placement is not None and placement.as_placed:
        by[:2] = 0.0
    elif placement is not None and placement.center is not None:
        by[:2] = np.asarray(placement.center) - (low + high)[:2] / 2
    if placement is not None and not placement.drop:
        by[2] = 0.0
    else:
        by[2] += stack.bottom[0]
    return mesh.moved(by)


def _cut_twice(part: Mesh, stack: Stack) -> tuple[Areas, Areas]:
    """Return the sections just below and just above the middle of each layer."""
    middle = (stack.top + stack.bottom) / 2
    low, high = (
        cut(part, LayerPlan(stack.top, middle + by), _RESOLUTION).solid for by in (-_BESIDE, _BESIDE)
    )
    return low, high


def _fit(stack: Stack, sections: Areas, *, look: bool) -> Match:
    """Find the position of sections, or measure how well they match where they are."""
    if not look:
        return replace(fit_sections(stack, sections, rounds=0), shift=(0.0, 0.0))
    guess = guess_shift(stack, sections)
    match = fit_sections(stack, shift_areas(sections, guess))
    return replace(match, shift=(guess[0] + match.shift[0], guess[1] + match.shift[1]))


def _near_part(part: Mesh, beads: Extrusions) -> Bool:
    """Return a mask (B,) of extrusions that start near the bounding box of a part."""
    low, high = part.bounds[:, :2]
    near = ((beads.begin > low - _NEAR) & (beads.begin < high + _NEAR)).all(axis=1)
    return np.asarray(near) & ~np.isin(beads.purpose, NOT_PART)


def _choose_section(stack: Stack, low: Areas, high: Areas) -> Areas:
    """Choose between the sections below and above a flat surface the one more similar to the print.

    A flat in the very middle of a layer may be printed either way.
    """
    doubtful = difference(low, high).area() + difference(high, low).area() > _DIFFERENT
    if not doubtful.any():
        return low
    chosen = doubtful[stack.layer] & (stack.layer >= 0)
    chosen &= ~np.isin(stack.beads.purpose, NOT_PART)
    printed = footprint(stack, chosen)
    wrong = [difference(one, printed).area() + difference(printed, one).area() for one in (low, high)]
    upper = doubtful & (wrong[1] < wrong[0])
    return low.of_layers(~upper).merge(high.of_layers(upper))


def _problems(coverage: Coverage, match: Match, part: Mesh) -> Iterator[str]:
    """Yield problems of the whole file."""
    stack = coverage.stack
    if match.share < _FITS:
        yield (
            f"only {match.share:.0%} of the external perimeters match this model: "
            "check model, scale and rotation"
        )
    if coverage.astray.any():
        lines = stack.beads.line[coverage.astray]
        many = f"{len(lines)} extrusions are" if len(lines) > 1 else "1 extrusion is"
        yield f"{many} far from the part, the first in line {lines[0]}"
    over, height = part.height - float(stack.top[-1]), float(stack.height[-1])
    if -over > height + _ROUNDED or _left_out(part, coverage, over):
        where = "below" if over > 0 else "above"
        yield f"the last layer ends at z {stack.top[-1]:.3g} mm, {abs(over):.3g} mm {where} the top of the part"


def _left_out(part: Mesh, coverage: Coverage, over: float) -> bool:
    """Return whether printable layers are missing above the last one; tips of needles are not printable."""
    stack = coverage.stack
    height = float(stack.height[-1])
    if over <= height / 2 + _ROUNDED:
        return False
    count = max(int(over / height + 0.5), 1)
    top = float(stack.top[-1]) + height * np.arange(1.0, count + 1, dtype=np.float64)
    try:
        above = cut(part, LayerPlan(top, top - height / 2), _RESOLUTION).solid
    except PartError:  # the tip is too slender to have a section
        return False
    width = coverage.stack.beads.take(np.flatnonzero(coverage.of_part)).usual_width
    room = offset_open(above, width / 2).area().sum() > _SEEN
    return bool(room or (over > height + _ROUNDED and above.area().sum() > _NEEDLE))


def _notes(deposit: GcodeExtrusions, coverage: Coverage) -> Iterator[str]:
    """Yield assumptions, and volumes that are not of the part."""
    stack = coverage.stack
    if not deposit.diameter_known:
        diameter = f"{deposit.diameter[0]:g} mm is assumed (set it with `filament_diameter`)"
        yield f"the file does not name the filament diameter: {diameter}"
    if (deposit.beads.purpose[coverage.of_part] == Purpose.UNKNOWN).all():
        depth = "a shell of two lines is assumed (set it with `shell`)"
        yield f"the file does not name roles: {depth}"
    if stack.spiral:
        yield "spiral vase: every turn counts as a layer; the first and the last are not checked"
    volume = stack.beads.volume
    beside = float(volume[~coverage.of_part & (stack.beads.purpose != Purpose.SUPPORT_MATERIAL)].sum())
    if beside > 0.1:
        yield f"{beside:.1f} mm³ beside the part (skirt, brim, priming)"
    support = float(volume[stack.beads.purpose == Purpose.SUPPORT_MATERIAL].sum())
    if support > 0:
        yield f"{support:.1f} mm³ of supports"
    if deposit.standing > 0.1:
        yield f"{deposit.standing:.1f} mm³ extruded without motion"
