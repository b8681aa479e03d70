"""Measure the coverage: the extrusions of all layers against the sections of the part."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from printer_slicer import bead
from printer_slicer.arrays import Bool, Float, frozen_array
from printer_slicer.geometry import Areas, difference, offset, offset_open, union
from printer_slicer.inspection.coverage.extrusions import Extrusions, Purpose
from printer_slicer.inspection.coverage.fill import LayerFill, measure_fill, overlap_cells
from printer_slicer.inspection.coverage.outline import OutlineError, outline_error
from printer_slicer.inspection.coverage.stack import Stack, split_thick_extrusions
from printer_slicer.inspection.coverage.zones import (
    exposed_areas,
    footprint,
    printed_body,
    remove_narrow_gaps,
    shell_depth,
)
from printer_slicer.inspection.deposition.marks import NOT_PART, Marks
from printer_slicer.inspection.deposition.unsupported import Unsupported, UnsupportedTracker

__all__ = ["Coverage", "CoverageRules", "coverage_of", "overlapping"]

_DOTS: Final = 3.0  # squares of the extrusion width: smaller islands may be missing


_FAR: Final = 50.0  # mm
_LEVEL: Final = 0.02  # mm: heights that differ by less are one
_INNER: Final = 1.25  # extrusion widths: walls thicker than twice this have inner perimeters


@dataclass(frozen=True, slots=True)
class CoverageRules:
    """Parameters of the measurement.

    Attributes:
        shell: mm from the outline that must be filled; None: as deep as the file's own perimeters reach.
        surface_depth: mm under and over air that must be filled; 0: the layer that is next to it.
        min_gap: mm; narrower gaps between beads do not count as uncovered.
        outside_tolerance: mm; what sticks out of the section by less does not count as outside.
        overlap_ratio: times the material a place needs, from which on it overlaps.
    """

    shell: float | None = None
    surface_depth: float = 0.0
    min_gap: float = 0.1
    outside_tolerance: float = 0.1
    overlap_ratio: float = 1.3


@dataclass(frozen=True, slots=True, eq=False)
class Coverage:
    """The extruded material compared with the part; areas in mm², volumes in mm³, lengths in mm.

    Attributes:
        rules: by which it was measured.
        stack: all beads in their layers.
        of_part: (B,) which of them make up the part; the rest are supports, what lies beside it, and what is astray.
        astray: (B,) which should make it up, but lie far from it; they are measured no further.
        sections: of the part, one for each layer of the stack.
        shell: where there must be no gap.
        shell_depth: mm from the outline, as it was given or found.
        covered: what the beads of the part cover.
        uncovered: of the shell, but for slits.
        outside: covered, but beyond the section.
        outline: the distance of the outlines.
        fill: overlap, and material in the shell.
        unsupported: extrusion with nothing under it, by height; commands are the beads, counted from 1.
        volume: (L,) laid for the part; of beads that fill several layers, in each what fills it.
        section_volume: (L,) of the sections as high as their layers.
        by_purpose: (P,) laid for each `Purpose`.
    """

    rules: CoverageRules
    stack: Stack
    of_part: Bool
    astray: Bool
    sections: Areas
    shell: Areas
    shell_depth: float
    covered: Areas
    uncovered: Areas
    outside: Areas
    outline: OutlineError
    fill: LayerFill
    unsupported: tuple[Unsupported, ...]
    volume: Float
    section_volume: Float
    by_purpose: Float

    def __post_init__(self) -> None:
        n = self.stack.n_layers
        for name in ("of_part", "astray"):
            flags = frozen_array(getattr(self, name), np.bool_, (self.stack.beads.n_beads,))
            object.__setattr__(self, name, flags)
        for name in ("volume", "section_volume"):
            object.__setattr__(self, name, frozen_array(getattr(self, name), np.float64, (n,)))
        object.__setattr__(self, "by_purpose", frozen_array(self.by_purpose, np.float64, (len(Purpose),)))

    @property
    def unsupported_length(self) -> Float:
        """(L,) mm of unsupported extrusion."""
        length = np.zeros(self.stack.n_layers)
        for one in self.unsupported:
            length[self.layer_at(one.z)] += one.length
        return length

    def layer_at(self, z: float) -> int:
        """Return the index of the layer whose top is at a height, mm, or next above it."""
        return min(int(np.searchsorted(self.stack.top, z - _LEVEL)), self.stack.n_layers - 1)


def coverage_of(
    stack: Stack, sections: Areas, rules: CoverageRules = CoverageRules(), beside: Bool | None = None
) -> Coverage:
    """Measure the coverage of extrusions against the sections of a part.

    Args:
        stack: the beads.
        sections: where the part lies among them, one layer for each of the stack's.
        rules: what is measured.
        beside: (B,) beads that are known to be no part of it, besides those whose purpose says so.

    Raises:
        ValueError: the stacks have different numbers of layers.
    """
    if sections.n_layers != stack.n_layers:
        raise ValueError(f"{stack.n_layers} layers of beads, {sections.n_layers} sections")
    of_part, astray = _classify(stack, sections, beside)
    depth = shell_depth(stack, sections) if rules.shell is None else rules.shell
    open_to_air = exposed_areas(sections, stack.top, stack.bottom, rules.surface_depth)
    # A spiral is a wall without skins, and without an inside.
    open_to_air = open_to_air.of_layers(~stack.rising)
    core = difference(offset(sections, -depth), open_to_air)
    shell = difference(sections, core)
    slabs, source = split_thick_extrusions(stack)
    covered = footprint(slabs, of_part[source])
    body = printed_body(
        covered, difference(offset(sections, -0.75 * depth), open_to_air), sections, depth / 4
    )
    inner, wanted = _inside_shell(sections, stack, depth, open_to_air)
    own, laid = of_part[source], slabs.beads.volume
    return Coverage(
        rules=rules,
        stack=stack,
        of_part=of_part,
        astray=astray,
        sections=sections,
        shell=shell,
        shell_depth=depth,
        covered=covered,
        uncovered=offset_open(difference(shell, covered), rules.min_gap / 2),
        outside=difference(covered, offset(sections, rules.outside_tolerance)),
        outline=_outline(sections, body, stack, rules),
        fill=measure_fill(stack, of_part, inner, wanted, rules.overlap_ratio),
        unsupported=_unsupported(stack, sections),
        volume=np.bincount(slabs.layer[own], laid[own], stack.n_layers).astype(np.float64),
        section_volume=sections.area() * stack.height,
        by_purpose=np.bincount(slabs.beads.purpose, laid, len(Purpose)).astype(np.float64),
    )


def _unsupported(stack: Stack, sections: Areas) -> tuple[Unsupported, ...]:
    """Find unsupported extrusion as `slice`, `print` and a dry run do; far from the part nothing is looked at."""
    beads, n_beads = stack.beads, stack.beads.n_beads
    # What is printed before the first layer of the part primes the nozzle.
    part = np.flatnonzero((stack.layer >= 0) & ~np.isin(beads.purpose, NOT_PART))
    if not sections.n_rings or not len(part):
        return ()
    changes = np.flatnonzero(np.diff(beads.purpose, prepend=-1)) if beads.purpose.any() else part[:0]
    marks = Marks(
        layers=part[:1] + 1,
        roles=changes + 1,
        names=beads.purpose[changes],
        removable=frozenset({int(Purpose.SUPPORT_MATERIAL)}),
    )
    (left, front), (right, back) = (
        (sections.xy.min(axis=0) - _FAR).tolist(),
        (sections.xy.max(axis=0) + _FAR).tolist(),
    )
    tracker = UnsupportedTracker(((left, front), (right, back)), 1.0, marks)
    start = np.column_stack([beads.begin, beads.z_top - beads.rise])
    end = np.column_stack([beads.end, beads.z_top])
    tracker.feed(np.arange(n_beads) + 1, start, end, beads.volume)
    return tracker.close()


def _outline(sections: Areas, body: Areas, stack: Stack, rules: CoverageRules) -> OutlineError:
    """Measure the distance between the outlines of the part and of the print."""
    part, printed = (remove_narrow_gaps(one, rules.min_gap) for one in (sections, body))
    return outline_error(part, printed, _DOTS * stack.beads.usual_width**2)


def _inside_shell(sections: Areas, stack: Stack, depth: float, open_to_air: Areas) -> tuple[Areas, Float]:
    """Return the areas inside the shell, and the area that the shell should fill in each layer, (L,) mm²."""
    # Rounded sides make extrusions smaller than their outline. Inner perimeters compensate for this.
    inner = difference(offset(sections, bead.side_loss(stack.height) - depth), open_to_air)
    wanted = np.maximum(_to_be_full(sections, stack, depth).area() - inner.area(), 0.0)
    return inner.of_layers(~stack.rising), wanted


def _to_be_full(sections: Areas, stack: Stack, depth: float) -> Areas:
    """Return the part of each section that should be filled: all of it where inner perimeters fill the rounded sides.

    Walls of one or two perimeters have no inner ones: there the gaps beside the rounded sides remain.
    """
    inside_sides = offset(sections, -bead.side_loss(stack.height))
    width = stack.beads.usual_width
    if depth < _INNER * width or stack.spiral:
        return inside_sides
    return union(inside_sides, offset_open(sections, _INNER * width))


def _classify(stack: Stack, sections: Areas, beside: Bool | None) -> tuple[Bool, Bool]:
    """Return masks (B,) of the extrusions of the part, and of those that should be but lie far from it."""
    mine = ~np.isin(stack.beads.purpose, NOT_PART) & (stack.layer >= 0)
    mine &= True if beside is None else ~beside
    astray = mine & _far_off(stack.beads, sections)
    return mine & ~astray, astray


def _far_off(beads: Extrusions, sections: Areas) -> Bool:
    """Return a mask (B,) of extrusions that start or end far from every section; none if there are no sections."""
    if not sections.n_rings:
        return np.zeros(beads.n_beads, np.bool_)
    low, high = sections.xy.min(axis=0) - _FAR, sections.xy.max(axis=0) + _FAR
    far = [((ends < low) | (ends > high)).any(axis=1) for ends in (beads.begin, beads.end)]
    return np.asarray(far[0] | far[1])


def overlapping(coverage: Coverage, layer: int) -> Areas:
    """Return where the extrusions of a layer overlap, to one cell, as areas of one layer."""
    own = np.flatnonzero(coverage.of_part & (coverage.stack.layer == layer))
    height = float(coverage.stack.height[layer])
    return overlap_cells(
        coverage.stack.beads.take(own), height, coverage.rules.overlap_ratio, coverage.fill.cell
    )
