"""Fill internal infill regions with the lines of a pattern at the density that the profile sets.

The distance between lines is the same on layers of all heights, so that lines stand on each other. The extrusion width
sets the density: the cross-section is the layer height times a spacing that is the same for all heights.
"""

from __future__ import annotations

import numpy as np

from printer_slicer import bead
from printer_slicer.arrays import Float, Int, distinct
from printer_slicer.geometry import Areas, Polylines, anchor, difference, offset
from printer_slicer.infill.combined_infill import combine_infill_areas
from printer_slicer.infill.custom_pattern import check_density
from printer_slicer.infill.infill_task import InfillTask, Pattern
from printer_slicer.infill.perimeter_overlap import extend_ends
from printer_slicer.model import Regions, Toolpaths
from printer_slicer.profile import Profile
from printer_slicer.roles import Role
from printer_slicer.values import Struct, replace

__all__ = ["PatternLayout", "internal_infill_paths", "lay_out_pattern", "lines_on_layers"]

_N_TRIED = 24  # entries used to find the spacing
_WIDEST_STEP = 1.25  # times the spacing of lines without anchors
_ANCHOR_RATIOS = (1.0, 0.5, 0.25, 0.125, 0.0)  # of the longest anchors, tried until they leave room for lines
_SHORTEST_LINE = 0.7  # extrusion widths: shorter lines consist of their round ends
_MAX_WIDTH_CHANGE = 0.2  # largest change of the extrusion width to correct the density


class PatternLayout(Struct, frozen=True, eq=False):
    """Layout of the lines of a pattern for the whole part.

    Attributes:
        task: the task, with the spacing for the whole part.
        pattern: function that makes the lines.
        anchor_ratio: share of the longest anchors that leaves room for lines.
        measured: whether the density is measured and corrected; otherwise the pattern determines it.
        groups: (L,) first layer of the group whose infill is printed together.
        strict_name: name of the pattern if it must have the density everywhere; empty if small areas may differ.
    """

    task: InfillTask
    pattern: Pattern
    anchor_ratio: float
    measured: bool
    groups: Int
    strict_name: str = ""


def lay_out_pattern(
    regions: Regions, groups: Int, pattern: Pattern, profile: Profile, *, measured: bool
) -> PatternLayout:
    """Find the line spacing at which lines and anchors together reach the density of the profile.

    Args:
        regions: the area inside the perimeters.
        groups: (L,) first layer of the group whose infill is printed together.
        pattern: function that makes the lines.
        profile: density and anchors.
        measured: whether to measure and correct the density.
    """
    task, reach = _make_task(regions, regions.internal_infill, groups, profile), 1.0
    if measured:
        task, reach = _fit_spacing(
            task, pattern, _wanted_volumes(task, regions.internal_infill, profile), profile
        )
    return PatternLayout(task, pattern, reach, measured, groups)


def lines_on_layers(layout: PatternLayout, layers: Int) -> Polylines:
    """Return the lines of some layers without the connections between them, on the layers of the part."""
    task = layout.task
    some = replace(task, area=task.area.of_layers(np.isin(task.layer, layers)))
    lines, _ = _draw_pattern(some, layout.pattern)
    # Turn loops into open lines that end at their first point.
    points = np.insert(
        np.arange(len(lines.xy)), lines.start[1:][lines.closed], lines.start[:-1][lines.closed]
    )
    layer = task.layer[lines.layer]
    order = np.argsort(layer, kind="stable")
    return Polylines.of(lines.xy[points], lines.size + lines.closed, layer).take(order)


def internal_infill_paths(layout: PatternLayout, regions: Regions, profile: Profile) -> Toolpaths:
    """Return paths along the connected lines of a pattern in internal infill regions.

    Args:
        layout: layout of the lines; its regions include the regions to fill.
        regions: the regions to fill, and those beside them.
        profile: density, anchors and extrusion width.
    """
    own = _make_task(layout.task.regions, regions.internal_infill, layout.groups, profile)
    # The overlap is a share of the mean of both spacings, which are equal here.
    overlap = profile.quality.internal_infill_overlap * own.bead if profile.quality.perimeters else 0.0
    # Lines overlap the perimeters to bond to them, except where the ends of bridges are already.
    around = own.bead / 2 + overlap
    bridges = offset(regions.bridge.merge(regions.internal_bridge), around).copy_layers(own.layer)
    task = replace(own, spacing=layout.task.spacing, area=difference(own.area, bridges))
    bare, length_ratio = _draw_pattern(task, layout.pattern)
    lines = _add_anchors(task, bare, profile, layout.anchor_ratio)
    if overlap:
        lines = extend_ends(lines, bare, task.area, overlap, task.bead)
    share = np.ones_like(length_ratio)
    if layout.measured:
        laid, volume = (
            _line_volumes(task, lines, length_ratio),
            _wanted_volumes(own, regions.internal_infill, profile),
        )
        share = _width_factors(laid, volume)
        if layout.strict_name:
            check_density(layout.strict_name, float((laid * share).sum()), float(volume.sum()), profile)
    return _make_toolpaths(task, lines, task.bead * share / length_ratio)


def _make_task(regions: Regions, infill: Areas, groups: Int, profile: Profile) -> InfillTask:
    """Make the task to fill internal infill areas, with the usual spacing."""
    quality, width = profile.quality, profile.extrusion_width
    filled = combine_infill_areas(infill, regions.plan, groups, width)
    highest = float(filled.height[filled.area.used].max(initial=0.0))
    # The highest extrusion has the wanted width; lower ones are narrower, with the same spacing.
    across = float(bead.spacing(width, highest))
    return InfillTask(
        offset(filled.area, -across / 2),
        spacing=across / quality.infill_density,
        bead=across,
        inset=across / 2,
        angle=float(np.deg2rad(quality.infill_angle_deg)),
        z=regions.plan.top[filled.layer] - filled.height / 2,
        height=filled.height,
        turn=filled.turn,
        layer=filled.layer,
        regions=regions,
        slope=float(np.tan(np.deg2rad(quality.lightning_angle_deg))),
    )


def _wanted_volumes(task: InfillTask, infill: Areas, profile: Profile) -> Float:
    """Return the volume (E,) of infill that the density requires in each entry, mm³."""
    density, inset = profile.quality.infill_density, task.inset
    volume = density * _grown_areas(task.area, inset) * task.height
    if task.area.n_layers > infill.n_layers:
        # Strips between the outlines of combined layers stay empty; the other extrusions make up for them.
        each = density * _grown_areas(offset(infill, -inset), inset) * task.regions.plan.height
        volume *= each.sum() / max(float(volume.sum()), 1e-9)
    return np.asarray(volume)


def _grown_areas(area: Areas, inset: float) -> Float:
    """Return the approximate area (E,) of entries after an offset outward by `inset` mm, mm²."""
    return np.asarray(area.area() + inset * area.length())


def _draw_pattern(task: InfillTask, pattern: Pattern) -> tuple[Polylines, Float]:
    """Return the lines of the pattern without very short lines, and the length ratio (E,); see `Pattern`."""
    lines, length_ratio = pattern(task)
    # Lines between perimeters that nearly touch shrink to dots; each would cost a stop.
    return lines.take(np.flatnonzero(lines.length() >= _SHORTEST_LINE * task.bead)), length_ratio


def _add_anchors(task: InfillTask, lines: Polylines, profile: Profile, anchor_ratio: float) -> Polylines:
    """Connect lines along the perimeters; `anchor_ratio` is the anchor length as a fraction of the profile's."""
    longest = anchor_ratio * profile.quality.infill_anchor_max
    hook = min(anchor_ratio * profile.quality.infill_anchor, longest)
    return anchor(task.area, lines, longest=longest, hook=hook, apart=task.bead)


def _fit_spacing(
    task: InfillTask, pattern: Pattern, volume: Float, profile: Profile
) -> tuple[InfillTask, float]:
    """Fit the spacing so that lines and anchors together have the required volume.

    In small areas, where anchors would make up most of the volume, they become shorter. The second result is the
    share of the longest anchors to use.

    The length of anchors hardly depends on the spacing; the length of lines is inverse to it. Both are measured on
    some entries. One spacing for the whole part keeps lines above each other.
    """
    used = np.flatnonzero(task.area.used)
    if not len(used):
        return task, 1.0
    tried = used[distinct(np.linspace(0, len(used) - 1, _N_TRIED).astype(np.int64))]
    some, wanted = replace(task, area=task.area.of_layers(tried)), float(volume[tried].sum())
    drawn = _draw_pattern(some, pattern)
    lines, left, reach = float(_line_volumes(some, *drawn).sum()), 0.0, 0.0
    for reach in _ANCHOR_RATIOS:
        left = wanted - (_measure_with_anchors(some, drawn, profile, reach) - lines)
        if left * _WIDEST_STEP * (1 + _MAX_WIDTH_CHANGE) >= lines:
            break
    step = lines / left if left * _WIDEST_STEP > lines else _WIDEST_STEP
    spacing = task.spacing * max(step, 1 / _WIDEST_STEP) if lines else task.spacing
    # In small areas a new spacing can change the anchors completely, so they are checked again.
    some = replace(some, spacing=spacing)
    drawn = _draw_pattern(some, pattern)
    for shorter in _ANCHOR_RATIOS:
        laid = _measure_with_anchors(some, drawn, profile, min(shorter, reach))
        if laid * (1 - _MAX_WIDTH_CHANGE) <= wanted:
            break
    return replace(task, spacing=spacing), min(shorter, reach)


def _measure_with_anchors(
    task: InfillTask, drawn: tuple[Polylines, Float], profile: Profile, anchor_ratio: float
) -> float:
    """Return the volume of lines and anchors at the usual width, mm³."""
    return float(_line_volumes(task, _add_anchors(task, drawn[0], profile, anchor_ratio), drawn[1]).sum())


def _line_volumes(task: InfillTask, lines: Polylines, length_ratio: Float) -> Float:
    """Return the volume of lines at the usual width, (E,) mm³."""
    length = np.bincount(lines.layer, lines.length(), minlength=len(length_ratio))
    return np.asarray(length / length_ratio * task.height * task.bead)


def _width_factors(measured: Float, wanted: Float) -> Float:
    """Return the width factors (E,) that correct the volume of each entry, then the volume of the part."""
    low, high = 1 - _MAX_WIDTH_CHANGE, 1 + _MAX_WIDTH_CHANGE
    each = np.clip(np.divide(wanted, measured, out=np.ones_like(measured), where=measured > 0), low, high)
    there = float((each * measured).sum())
    return np.asarray(np.clip(each * float(wanted.sum()) / there, low, high) if there else each)


def _make_toolpaths(task: InfillTask, lines: Polylines, spacing: Float) -> Toolpaths:
    """Return the lines as paths on the layers that print them; `spacing` (E,) is the extrusion spacing, mm."""
    width = np.maximum(np.round(bead.width_for_spacing(spacing, task.height), 4), task.height)
    entry = lines.layer
    return Toolpaths.gathered(
        task.regions.plan,
        xy=lines.xy,
        size=lines.size,
        layer=task.layer[entry],
        role=np.full(len(entry), Role.INTERNAL_INFILL),
        width=width[entry],
        closed=lines.closed,
        height=task.height[entry],
    )
