"""Measure how well the extrusions of each layer cover the section of the part in this layer."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from printer_slicer import bead
from printer_slicer.arrays import Bool, Float, frozen_array
from printer_slicer.deprecation import accept_former_fields, renamed_attribute
from printer_slicer.geometry import Areas, difference, offset, offset_open, union
from printer_slicer.inspection.coverage.extrusions import Extrusions, Purpose
from printer_slicer.inspection.coverage.fill import LayerFill, measure_fill, overlap_cells
from printer_slicer.inspection.coverage.outline import OutlineDistances, measure_outline_distances
from printer_slicer.inspection.coverage.stack import Stack, split_thick_extrusions
from printer_slicer.inspection.coverage.surface_distance import SurfaceErrors, measure_surface_errors
from printer_slicer.inspection.coverage.zones import (
    exposed_areas,
    footprint,
    printed_body,
    remove_narrow_gaps,
    shell_depth,
)
from printer_slicer.inspection.deposition.marks import NOT_PART, Marks
from printer_slicer.inspection.deposition.support_gaps import SupportGaps
from printer_slicer.inspection.deposition.unsupported import UnsupportedExtrusion, UnsupportedTracker
from printer_slicer.model import Mesh
from printer_slicer.values import Struct, force_setattr

__all__ = ["Coverage", "CoverageRules", "coverage_of", "find_overlaps"]

_MAX_ISLAND_SQUARES: Final = 3.0  # squares of the extrusion width; an island of this area may be missing


_MAX_DISTANCE: Final = 50.0  # mm from the part; extrusions farther away are ignored
_SAME_HEIGHT: Final = 0.02  # mm; heights that differ by less are one layer
_MIN_INNER_DEPTH: Final = 1.25  # multiples of the extrusion width; a deeper shell has inner perimeters


@accept_former_fields(
    skin="surface_depth", slit="min_gap", beyond="outside_tolerance", too_often="overlap_ratio"
)
class CoverageRules(Struct, frozen=True):
    """Parameters of the coverage measurement.

    Attributes:
        shell: mm, depth of the shell that must be filled; None: the depth of the file's own perimeters.
        surface_depth: mm below and above air that must be filled; 0: only the layer next to air.
        min_gap: mm; narrower gaps between extrusions do not count as uncovered.
        outside_tolerance: mm; extrusions that protrude from the section by less do not count as outside.
        overlap_ratio: ratio of the material to the material needed, above which extrusions overlap.
        gaps: of supports, which are no unsupported places.
    """

    shell: float | None = None
    surface_depth: float = 0.0
    min_gap: float = 0.1
    outside_tolerance: float = 0.1
    overlap_ratio: float = 1.3
    gaps: SupportGaps = SupportGaps()


class Coverage(Struct, frozen=True, eq=False):
    """How the extruded material covers the part; areas in mm², volumes in mm³, lengths in mm.

    Attributes:
        rules: parameters of the measurement.
        stack: all extrusions in their layers.
        of_part: (B,) mask of the extrusions of the part; the others are supports, skirts, priming, or `astray`.
        astray: (B,) mask of extrusions with a role of the part that are far from it; they are not measured.
        sections: sections of the part, one for each layer of the stack.
        shell: area that must have no gap.
        shell_depth: mm from the outline, given or measured.
        covered: area that the extrusions of the part cover.
        uncovered: gaps in the shell, without narrow slits.
        outside: covered area outside the section.
        outline: distances between the outlines.
        fill: overlap, and material in the shell.
        unsupported: unsupported extrusion, by height; commands are the numbers of extrusions, counted from 1.
        volume: (L,) volume of the part's extrusions; those that fill several layers are split.
        section_volume: (L,) volume of the sections with the heights of their layers, without what is above contoured
            extrusions.
        by_purpose: (P,) extruded volume of each `Purpose`.
        surface: distances of contoured extrusions from the surface; None if the surface is not given.
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
    outline: OutlineDistances
    fill: LayerFill
    unsupported: tuple[UnsupportedExtrusion, ...]
    volume: Float
    section_volume: Float
    by_purpose: Float
    surface: SurfaceErrors | None = None

    def __post_init__(self) -> None:
        n = self.stack.n_layers
        for name in ("of_part", "astray"):
            flags = frozen_array(getattr(self, name), np.bool_, (self.stack.beads.n_beads,))
            force_setattr(self, name, flags)
        for name in ("volume", "section_volume"):
            force_setattr(self, name, frozen_array(getattr(self, name), np.float64, (n,)))
        force_setattr(self, "by_purpose", frozen_array(self.by_purpose, np.float64, (len(Purpose),)))

    @property
    def unsupported_length(self) -> Float:
        """Length (L,) of unsupported extrusion in each layer, mm."""
        length = np.zeros(self.stack.n_layers)
        for one in self.unsupported:
            length[self.layer_of_unsupported(one)] += one.length
        return length

    hanging = renamed_attribute("Coverage.hanging", "Coverage.unsupported_length")

    def layer_at(self, z: float) -> int:
        """Return the index of the lowest layer with its top at or above a height, mm."""
        return min(int(np.searchsorted(self.stack.top, z - _SAME_HEIGHT)), self.stack.n_layers - 1)

    def layer_of_unsupported(self, one: UnsupportedExtrusion) -> int:
        """Return the index of the layer of an unsupported extrusion; of several groups, that of its own group."""
        layer = int(self.stack.layer[one.command - 1])
        return layer if layer >= 0 and self.stack.group.any() else self.layer_at(one.z)


def coverage_of(
    stack: Stack,
    sections: Areas,
    rules: CoverageRules = CoverageRules(),
    beside: Bool | None = None,
    parts: Sequence[Mesh] = (),
) -> Coverage:
    """Measure the coverage of extrusions against the sections of a part.

    Args:
        stack: the extrusions in their layers.
        sections: sections of the part in its position in the file, one for each layer of the stack.
        rules: parameters of the measurement.
        beside: (B,) mask of further extrusions that do not belong to the part, whatever their purpose.
        parts: the part in its position in the file, one for each group of the stack; without it, the heights of
            contoured extrusions are not compared.

    Raises:
        ValueError: the stacks have different numbers of layers.
    """
    if sections.n_layers != stack.n_layers:
        raise ValueError(f"the stack has {stack.n_layers} layers, but there are {sections.n_layers} sections")
    of_part, astray = _classify_extrusions(stack, sections, beside)
    depth = shell_depth(stack, sections) if rules.shell is None else rules.shell
    open_to_air = _find_exposed_areas(stack, sections, rules.surface_depth)
    shell = difference(sections, difference(offset(sections, -depth), open_to_air))
    split_stack, source = split_thick_extrusions(stack)
    covered = footprint(split_stack, of_part[source])
    inside = difference(offset(sections, -0.75 * depth), open_to_air)
    body = printed_body(covered, inside, sections, depth / 4)
    inner, area_to_fill = _areas_inside_shell(sections, stack, depth, open_to_air)
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
        outline=_measure_outline(sections, body, stack, rules),
        fill=measure_fill(stack, of_part, inner, area_to_fill, rules.overlap_ratio),
        unsupported=_find_unsupported(stack, sections, rules.gaps),
        volume=_sum_by_layer(split_stack, of_part[source]),
        section_volume=sections.area() * stack.height - _volume_above_contours(stack, of_part),
        by_purpose=_sum_by_purpose(split_stack.beads),
        surface=measure_surface_errors(parts, stack, of_part) if parts else None,
    )


def _sum_by_layer(stack: Stack, of_part: Bool) -> Float:
    """Return the volume (L,) of the extrusions of the part in each layer, mm³."""
    volume = np.bincount(stack.layer[of_part], stack.beads.volume[of_part], stack.n_layers)
    return np.asarray(volume, np.float64)


def _sum_by_purpose(beads: Extrusions) -> Float:
    """Return the volume (P,) of the extrusions of each purpose, mm³."""
    return np.bincount(beads.purpose, beads.volume, len(Purpose)).astype(np.float64)


def _volume_above_contours(stack: Stack, of_part: Bool) -> Float:
    """Return the volume (L,) between contoured extrusions and the tops of their layers, mm³."""
    beads = stack.beads
    chosen = np.flatnonzero(of_part & beads.is_contoured)
    some, layer = beads.take(chosen), stack.layer[chosen]
    spacing = some.area / some.height
    volume = some.length * spacing * (stack.top[layer] - some.middle_z)
    return np.asarray(np.bincount(layer, volume, stack.n_layers), np.float64)


def _find_exposed_areas(stack: Stack, sections: Areas, surface_depth: float) -> Areas:
    """Return the parts of each section near air, above or below it."""
    exposed = list[Areas]()
    for own in stack.layers_of_groups():
        below, above = stack.list_adjacent_layers(own)
        # All layers of other groups below are one layer, and those above are one that is thick enough.
        before, after = int(len(below) > 0), int(len(above) > 0)
        here = before + np.arange(len(own))
        number = np.concatenate([np.zeros_like(below), here, np.full_like(above, before + len(own))])
        around = sections.copy_layers(np.concatenate([below, own, above]))
        low, high = stack.bottom[own[:1]], stack.top[own[-1:]]
        top = np.concatenate([low[:before], stack.top[own], high[:after] + surface_depth + 1.0])
        bottom = np.concatenate([low[:before], stack.bottom[own], high[:after]])
        areas = exposed_areas(around.on_layers(number, len(top)), top, bottom, surface_depth)
        exposed.append(areas.copy_layers(here).on_layers(own, stack.n_layers))
    # A turn of a spiral vase is only a wall, without top, bottom and infill.
    return Areas.merged(exposed).of_layers(~stack.has_rising_z)


def _find_unsupported(stack: Stack, sections: Areas, gaps: SupportGaps) -> tuple[UnsupportedExtrusion, ...]:
    """Find unsupported extrusion near the part, with the rules of `slice`, `print` and a dry run."""
    beads, n_beads = stack.beads, stack.beads.n_beads
    # Extrusion before the first layer of the part primes the nozzle.
    part = np.flatnonzero((stack.layer >= 0) & ~np.isin(beads.purpose, NOT_PART))
    if not sections.n_rings or not len(part):
        return ()
    changes = np.flatnonzero(np.diff(beads.purpose, prepend=-1)) if beads.purpose.any() else part[:0]
    marks = Marks(
        layers=part[:1] + 1,
        roles=changes + 1,
        names=beads.purpose[changes],
        removable=frozenset({int(Purpose.SUPPORT_MATERIAL)}),
        gaps=gaps,
    )
    (left, front), (right, back) = (
        (sections.xy.min(axis=0) - _MAX_DISTANCE).tolist(),
        (sections.xy.max(axis=0) + _MAX_DISTANCE).tolist(),
    )
    tracker = UnsupportedTracker(((left, front), (right, back)), 1.0, marks)
    start = np.column_stack([beads.begin, beads.z_top - beads.rise])
    end = np.column_stack([beads.end, beads.z_top])
    tracker.add_moves(np.arange(n_beads) + 1, start, end, beads.volume)
    return tracker.close()


def _measure_outline(sections: Areas, body: Areas, stack: Stack, rules: CoverageRules) -> OutlineDistances:
    """Measure the distances between the outline of the part and the outline of the print."""
    part, printed = (remove_narrow_gaps(one, rules.min_gap) for one in (sections, body))
    return measure_outline_distances(part, printed, _MAX_ISLAND_SQUARES * stack.beads.usual_width**2)


def _areas_inside_shell(
    sections: Areas, stack: Stack, depth: float, open_to_air: Areas
) -> tuple[Areas, Float]:
    """Return the areas inside the shell, and how much area the shell should fill in each layer (L,), mm²."""
    # Extrusions with rounded sides do not fill their outline completely; inner perimeters fill the rest.
    inner = difference(offset(sections, bead.compute_side_extension(stack.height) - depth), open_to_air)
    area_to_fill = np.maximum(_areas_to_fill(sections, stack, depth).area() - inner.area(), 0.0)
    return inner.of_layers(~stack.has_rising_z), area_to_fill


def _areas_to_fill(sections: Areas, stack: Stack, depth: float) -> Areas:
    """Return the areas of each section that extrusions should fill.

    Inner perimeters fill the gaps beside the rounded sides of external perimeters. Walls of one or two perimeters have
    no inner ones, so there these gaps remain.
    """
    inside_sides = offset(sections, -bead.compute_side_extension(stack.height))
    width = stack.beads.usual_width
    if depth < _MIN_INNER_DEPTH * width or stack.is_spiral:
        return inside_sides
    return union(inside_sides, offset_open(sections, _MIN_INNER_DEPTH * width))


def _classify_extrusions(stack: Stack, sections: Areas, beside: Bool | None) -> tuple[Bool, Bool]:
    """Return masks (B,) of the part's extrusions, and of extrusions far from it with a part's role."""
    of_part = ~np.isin(stack.beads.purpose, NOT_PART) & (stack.layer >= 0)
    of_part &= True if beside is None else ~beside
    astray = of_part & _find_distant_extrusions(stack.beads, sections)
    return of_part & ~astray, astray


def _find_distant_extrusions(beads: Extrusions, sections: Areas) -> Bool:
    """Return a mask (B,) of extrusions that start or end far from all sections; False without sections."""
    if not sections.n_rings:
        return np.zeros(beads.n_beads, np.bool_)
    low, high = sections.xy.min(axis=0) - _MAX_DISTANCE, sections.xy.max(axis=0) + _MAX_DISTANCE
    far = [((ends < low) | (ends > high)).any(axis=1) for ends in (beads.begin, beads.end)]
    return np.asarray(far[0] | far[1])


def find_overlaps(coverage: Coverage, layer: int) -> Areas:
    """Return the areas where the extrusions of a layer overlap, rounded to raster cells."""
    own = np.flatnonzero(coverage.of_part & (coverage.stack.layer == layer))
    height = float(coverage.stack.height[layer])
    return overlap_cells(
        coverage.stack.beads.take(own), height, coverage.rules.overlap_ratio, coverage.fill.cell
    )
