"""Sparse regions: lines of a pattern with as much plastic as the density says.

Lines lie equally far apart on layers of all heights, so that they stand on each other. What makes the density right is
the bead: its cross-section is its height times a spacing that is the same for all heights.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from printer_slicer import bead
from printer_slicer.arrays import Float, Int, distinct
from printer_slicer.geometry import Areas, Polylines, anchor, difference, offset
from printer_slicer.infill.own import insist_on_density
from printer_slicer.infill.perimeter_overlap import extend_ends
from printer_slicer.infill.task import Pattern, Task
from printer_slicer.infill.thick import fillings
from printer_slicer.model import Regions, Toolpaths
from printer_slicer.profile import Profile
from printer_slicer.roles import Role

__all__ = ["PatternLayout", "bare_lines", "laid_out", "sparse_paths"]

_TRIED = 24  # entries from which the spacing is found
_WIDEST_STEP = 1.25  # times the spacing of lines without anchors
_REACHES = (1.0, 0.5, 0.25, 0.125, 0.0)  # of the longest anchors, until they leave room for lines
_SHORTEST = 0.7  # beads: what is hardly longer than the half circles at its ends
_BEAD_CHANGE = 0.2  # share by which the bead may make up for the rest


@dataclass(frozen=True, slots=True, eq=False)
class PatternLayout:
    """Where the lines of a pattern lie, whatever of them is laid.

    Attributes:
        task: what the pattern was drawn for, with the spacing for the whole part; trees grow in its regions.
        pattern: makes the lines.
        reach: share of the longest anchors that leaves room for lines.
        measured: whether the density is a share of the volume; else it is the pattern's affair.
        groups: (L,) the first of those layers with which each one's sparse infill is printed.
        insisting_on: name of a pattern that must have the density; empty: it may miss it where it has no room.
    """

    task: Task
    pattern: Pattern
    reach: float
    measured: bool
    groups: Int
    insisting_on: str = ""


def laid_out(
    regions: Regions, groups: Int, pattern: Pattern, profile: Profile, *, measured: bool
) -> PatternLayout:
    """The spacing with which lines and anchors in the sparse regions together have the density asked for.

    Args:
        regions: what is inside the walls.
        groups: (L,) the first of those layers with which each one's sparse infill is printed.
        pattern: makes the lines.
        profile: density and anchors.
        measured: whether the density is a share of the volume; else it is the pattern's affair.
    """
    task, reach = _task(regions, regions.sparse, groups, profile), 1.0
    if measured:
        task, reach = _spaced(task, pattern, _volume(task, regions.sparse, profile), profile)
    return PatternLayout(task, pattern, reach, measured, groups)


def bare_lines(layout: PatternLayout, layers: Int) -> Polylines:
    """The lines that are printed on some of the layers, without the joints between them; on the layers of the part."""
    task = layout.task
    some = replace(task, area=task.area.of_layers(np.isin(task.layer, layers)))
    lines, _ = _drawn(some, layout.pattern)
    # Loops as open lines that end where they begin.
    points = np.insert(
        np.arange(len(lines.xy)), lines.start[1:][lines.closed], lines.start[:-1][lines.closed]
    )
    layer = task.layer[lines.layer]
    order = np.argsort(layer, kind="stable")
    return Polylines.of(lines.xy[points], lines.size + lines.closed, layer).take(order)


def sparse_paths(layout: PatternLayout, regions: Regions, profile: Profile) -> Toolpaths:
    """The lines of the pattern, joined, in sparse areas within those they were laid out for.

    Args:
        layout: of the lines.
        regions: to be filled, and what lies beside them.
        profile: density, anchors, and width of the beads.
    """
    own = _task(layout.task.regions, regions.sparse, layout.groups, profile)
    # A share of the mean of both spacings, which are equal here.
    overlap = profile.quality.internal_infill_overlap * own.bead if profile.quality.perimeters else 0.0
    # Lines reach into the walls to hold on to them; the ends of bridges are there already and would lie under them.
    around = own.bead / 2 + overlap
    bridges = offset(regions.bridge.merge(regions.internal_bridge), around).for_each(own.layer)
    task = replace(own, spacing=layout.task.spacing, area=difference(own.area, bridges))
    bare, more = _drawn(task, layout.pattern)
    lines = _anchored(task, bare, profile, layout.reach)
    if overlap:
        lines = extend_ends(lines, bare, task.area, overlap, task.bead)
    share = np.ones_like(more)
    if layout.measured:
        laid, volume = _laid(task, lines, more), _volume(own, regions.sparse, profile)
        share = _share(laid, volume)
        if layout.insisting_on:
            insist_on_density(layout.insisting_on, float((laid * share).sum()), float(volume.sum()), profile)
    return _toolpaths(task, lines, task.bead * share / more)


def _task(regions: Regions, sparse: Areas, groups: Int, profile: Profile) -> Task:
    """The task of filling sparse areas, within those of the regions, with lines as usual."""
    quality, width = profile.quality, profile.extrusion_width
    filled = fillings(sparse, regions.plan, groups, width)
    highest = float(filled.height[filled.area.used].max(initial=0.0))
    # The highest bead is as wide as asked for, lower ones are narrower: all with the same spacing.
    across = float(bead.spacing(width, highest))
    return Task(
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


def _volume(task: Task, sparse: Areas, profile: Profile) -> Float:
    """(E,) mm³ that the density asks for."""
    density, inset = profile.quality.infill_density, task.inset
    volume = density * _around(task.area, inset) * task.height
    if task.area.n_layers > sparse.n_layers:
        # Between the outlines of layers filled together, strips stay empty that no bead fits in: the others make up.
        each = density * _around(offset(sparse, -inset), inset) * task.regions.plan.height
        volume *= each.sum() / max(float(volume.sum()), 1e-9)
    return np.asarray(volume)


def _around(area: Areas, inset: float) -> Float:
    """(E,) mm² of the area in whose middle, `inset` from its border, the centre lines lie; where there are any."""
    return np.asarray(area.area() + inset * area.length())


def _drawn(task: Task, pattern: Pattern) -> tuple[Polylines, Float]:
    """The pattern's lines, and how much more than asked for there is of them at each entry's z."""
    lines, more = pattern(task)
    # Between walls that nearly touch, lines shrink to dots that carry nothing and cost a stop each.
    return lines.take(np.flatnonzero(lines.length() >= _SHORTEST * task.bead)), more


def _anchored(task: Task, lines: Polylines, profile: Profile, reach: float) -> Polylines:
    """The lines joined along the walls, by ways of that share of the longest allowed."""
    longest = reach * profile.quality.infill_anchor_max
    hook = min(reach * profile.quality.infill_anchor, longest)
    return anchor(task.area, lines, longest=longest, hook=hook, apart=task.bead)


def _spaced(task: Task, pattern: Pattern, volume: Float, profile: Profile) -> tuple[Task, float]:
    """The task with the lines farther apart, so that lines and anchors together are as much as asked for.

    Where rooms are so small that anchors would be most of it they become shorter; the second value says by how much.

    Anchors follow the walls: their length hardly depends on the spacing, that of the lines is inverse to it. Both are
    measured on some of the entries; one spacing for the whole part keeps the lines above each other.
    """
    used = np.flatnonzero(task.area.used)
    if not len(used):
        return task, 1.0
    tried = used[distinct(np.linspace(0, len(used) - 1, _TRIED).astype(np.int64))]
    some, wanted = replace(task, area=task.area.of_layers(tried)), float(volume[tried].sum())
    drawn = _drawn(some, pattern)
    lines, left, reach = float(_laid(some, *drawn).sum()), 0.0, 0.0
    for reach in _REACHES:
        left = wanted - (_with_anchors(some, drawn, profile, reach) - lines)
        if left * _WIDEST_STEP * (1 + _BEAD_CHANGE) >= lines:
            break
    step = lines / left if left * _WIDEST_STEP > lines else _WIDEST_STEP
    spacing = task.spacing * max(step, 1 / _WIDEST_STEP) if lines else task.spacing
    # With few lines in a room the anchors of the new ones may be quite others.
    some = replace(some, spacing=spacing)
    drawn = _drawn(some, pattern)
    for shorter in _REACHES:
        laid = _with_anchors(some, drawn, profile, min(shorter, reach))
        if laid * (1 - _BEAD_CHANGE) <= wanted:
            break
    return replace(task, spacing=spacing), min(shorter, reach)


def _with_anchors(task: Task, drawn: tuple[Polylines, Float], profile: Profile, reach: float) -> float:
    """Mm³ of the usual bead in lines and anchors."""
    return float(_laid(task, _anchored(task, drawn[0], profile, reach), drawn[1]).sum())


def _laid(task: Task, lines: Polylines, more: Float) -> Float:
    """(E,) mm³ of the usual bead in lines."""
    length = np.bincount(lines.layer, lines.length(), minlength=len(more))
    return np.asarray(length / more * task.height * task.bead)


def _share(laid: Float, volume: Float) -> Float:
    """(E,) by how much beads are wider or narrower: first so that each entry, then so that the part has its plastic."""
    low, high = 1 - _BEAD_CHANGE, 1 + _BEAD_CHANGE
    each = np.clip(np.divide(volume, laid, out=np.ones_like(laid), where=laid > 0), low, high)
    there = float((each * laid).sum())
    return np.asarray(np.clip(each * float(volume.sum()) / there, low, high) if there else each)


def _toolpaths(task: Task, lines: Polylines, across: Float) -> Toolpaths:
    """The lines as paths, on the layers on which they are printed; `across` (E,) is the spacing of their beads, mm."""
    width = np.maximum(np.round(bead.width_for_spacing(across, task.height), 4), task.height)
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
