"""Sparse regions: lines of a pattern with as much plastic as the density says.

Lines lie equally far apart on layers of all heights, so that they stand on each other. What makes the density right is
the bead: its cross-section is its height times a spacing that is the same for all heights.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from printer_slicer import bead
from printer_slicer.geometry import Areas, Float, Polylines, anchor, offset
from printer_slicer.infill.task import Pattern, Task
from printer_slicer.infill.thick import Fillings, fillings
from printer_slicer.model import Regions, Role, Toolpaths
from printer_slicer.profile import Profile

__all__ = ["sparse_paths"]

_NOZZLE_SHARE = 0.8  # of the nozzle's diameter: the highest bead it presses down
_TRIED = 24  # entries from which the spacing is found
_WIDEST_STEP = 1.25  # times the spacing of lines without anchors
_BEAD_CHANGE = 0.1  # share by which the bead may make up for the rest


def sparse_paths(regions: Regions, profile: Profile, pattern: Pattern, *, measured: bool = True) -> Toolpaths:
    """Lines of the pattern in the sparse regions.

    Args:
        regions: what is inside the walls.
        profile: density, anchors, and how many layers are filled together.
        pattern: makes the lines.
        measured: whether the density is a share of the volume; else it is the pattern's affair.
    """
    quality, plan = profile.quality, regions.plan
    width = profile.extrusion_width
    limit = min(quality.sparse_every, _NOZZLE_SHARE * profile.printer.nozzle_diameter, width)
    filled = fillings(regions.sparse, plan, limit, width)
    used = np.unique(filled.area.ring_layer)
    highest = float(filled.height[used].max(initial=0.0))
    # The highest bead is as wide as asked for, lower ones are narrower: all with the same spacing.
    across = float(bead.spacing(width, highest))
    inset = across / 2 - (quality.sparse_overlap * width if quality.perimeters else 0.0)
    task = _task(regions, profile, filled, offset(filled.area, -inset), across)
    wanted = _length_wanted(task, filled, inset, quality.infill_density)
    if measured:
        task = _spaced(task, pattern, wanted, profile)
    bare, more = pattern(task)
    lines = _anchored(task, bare, profile)
    share = _share(lines, more, filled, wanted) if measured else 1.0
    return _toolpaths(regions, filled, lines, across * share / more)


def _task(regions: Regions, profile: Profile, filled: Fillings, area: Areas, across: float) -> Task:
    quality = profile.quality
    return Task(
        area,
        spacing=across / quality.infill_density,
        bead=across,
        angle=float(np.deg2rad(quality.infill_angle_deg)),
        z=regions.plan.top[filled.layer] - filled.height / 2,
        turn=filled.turn,
        layer=filled.layer,
        regions=regions,
        slope=float(np.tan(np.deg2rad(quality.lightning_angle_deg))),
    )


def _length_wanted(task: Task, filled: Fillings, inset: float, density: float) -> Float:
    """(E,) mm of usual bead in each entry: its share of the area around the centre lines, where there is any."""
    around = np.bincount(task.area.ring_layer, task.area.ring_length(), minlength=len(filled.layer))
    return np.asarray(density * (task.area.area() + inset * around) / task.bead)


def _anchored(task: Task, lines: Polylines, profile: Profile) -> Polylines:
    """The lines joined along the walls, without those that carry nothing."""
    quality = profile.quality
    # Between walls that nearly touch, lines shrink to dots that cost a stop each.
    lines = lines.take(np.flatnonzero(lines.length() >= task.bead))
    hook = min(quality.infill_anchor, quality.infill_anchor_max)
    return anchor(task.area, lines, longest=quality.infill_anchor_max, hook=hook)


def _spaced(task: Task, pattern: Pattern, wanted: Float, profile: Profile) -> Task:
    """The task with the lines farther apart, so that lines and anchors together are as much as asked for.

    Anchors follow the walls: their length hardly depends on the spacing, that of the lines is inverse to it. Both are
    measured on some of the entries; one spacing for the whole part keeps the lines above each other.
    """
    used = np.unique(task.area.ring_layer)
    if not len(used):
        return task
    tried = used[np.unique(np.linspace(0, len(used) - 1, _TRIED).astype(np.int64))]
    some = replace(task, area=task.area.select(np.isin(task.area.ring_layer, tried)))
    bare, more = pattern(some)
    both = _anchored(some, bare, profile)
    of_lines, of_all = (float((one.length() / more[one.layer]).sum()) for one in (bare, both))
    target = float(wanted[tried].sum())
    left = target - (of_all - of_lines)
    step = of_lines / left if left * _WIDEST_STEP > of_lines else _WIDEST_STEP
    return replace(task, spacing=task.spacing * max(step, 1 / _WIDEST_STEP) if of_lines else task.spacing)


def _share(lines: Polylines, more: Float, filled: Fillings, wanted: Float) -> float:
    """By how much beads are wider or narrower so that the part has the plastic that it should have."""
    laid = np.bincount(lines.layer, lines.length(), minlength=len(more)) / more
    volume, target = float((laid * filled.height).sum()), float((wanted * filled.height).sum())
    return float(np.clip(target / volume, 1 - _BEAD_CHANGE, 1 + _BEAD_CHANGE)) if volume else 1.0


def _toolpaths(regions: Regions, filled: Fillings, lines: Polylines, across: Float) -> Toolpaths:
    """The lines as paths, on the layers on which they are printed."""
    width = np.maximum(np.round(bead.width_for_spacing(across, filled.height), 4), filled.height)
    entry = lines.layer
    return Toolpaths.gathered(
        regions.plan,
        xy=lines.xy,
        size=lines.size,
        layer=filled.layer[entry],
        role=np.full(len(entry), Role.SPARSE),
        width=width[entry],
        closed=lines.closed,
        height=filled.height[entry],
    )
