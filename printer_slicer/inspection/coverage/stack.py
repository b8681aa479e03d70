"""Find the layers of a file from its extrusions, and the height of each extrusion."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import pi
from typing import Final

import numpy as np

from printer_slicer import bead
from printer_slicer.arrays import Bool, Float, Int, consecutive, frozen_array
from printer_slicer.inspection.coverage.extrusions import (
    Extrusions,
    Purpose,
    extrusions_of_program,
    median_of,
)
from printer_slicer.inspection.deposition.marks import NOT_PART
from printer_slicer.model import Program

__all__ = ["Stack", "split_thick_extrusions", "stack_extrusions", "stack_of_program"]

_STEADY: Final = 0.1  # mm
_HAIR: Final = 0.02  # of a turn
_UNEVEN: Final = 0.2  # of a turn, that one may begin higher or lower than if all were as high
_LEVEL: Final = (
    0.004  # mm: heights of the nozzle closer than this are one layer; files round z to 0.001 or 0.01
)
_DEEPEST: Final = 8  # layers that one bead may reach down through
_WIDE: Final = 1.3  # of the usual width: wider beads are thicker than their layer, if they may be
_AGREES: Final = 0.01  # mm between a height that a comment tells and one that the moves allow
_THINNEST_BEAD: Final = 1e-3  # mm, so that widths are finite
_THINNEST: Final = 0.04  # mm: no layer on a raft is thinner
_CONTACT: Final = 0.3  # mm that slicers leave between raft and part, at most
_FLAT: Final = 1e-4  # mm of z along a bead
_SHORT: Final = 5.0  # mm
_UNKNOWN: Final = 0.2  # mm: how thick beads are where there is no layer to tell
_WALLS: Final = (Purpose.EXTERNAL_PERIMETER, Purpose.PERIMETER)
_MAY_BE_THICK: Final = (
    Purpose.UNKNOWN,
    Purpose.BRIDGE,
    Purpose.INTERNAL_INFILL,
    Purpose.SUPPORT_MATERIAL,
    Purpose.OVERHANG_PERIMETER,
)
_FILL_SEVERAL: Final = (
    Purpose.PERIMETER,
    Purpose.INTERNAL_INFILL,
)  # layers, where they are thick; threads hang


@dataclass(frozen=True, slots=True, eq=False)
class Stack:
    """Beads in layers.

    Attributes:
        beads: with their heights.
        layer: (B,) of each; -1 for beads beside the part and supports between its layers.
        top: (L,) mm, ascending.
        bottom: (L,) mm, where what lies below each layer ends.
    """

    beads: Extrusions
    layer: Int
    top: Float
    bottom: Float

    def __post_init__(self) -> None:
        for name, dtype, shape in (
            ("layer", np.int64, (self.beads.n_beads,)),
            ("top", np.float64, (-1,)),
            ("bottom", np.float64, (len(self.top),)),
        ):
            object.__setattr__(self, name, frozen_array(getattr(self, name), dtype, shape))

    @property
    def n_layers(self) -> int:
        """Number of layers."""
        return len(self.top)

    @property
    def height(self) -> Float:
        """(L,) mm."""
        return self.top - self.bottom

    @property
    def rising(self) -> Bool:
        """(L,) layers printed mostly while z rises, as in spiral vase mode; in a spiral, all layers above too."""
        own = self.layer >= 0
        length = self.beads.length * np.where(np.abs(self.beads.rise) >= _FLAT, 1.0, -0.9)
        found = np.bincount(self.layer[own], length[own], self.n_layers) > 0
        if 2 * int(found.sum()) > self.n_layers:
            found[int(found.argmax()) :] = True
        return np.asarray(found)

    @property
    def spiral(self) -> bool:
        """Whether the print is a spiral vase."""
        return 2 * int(self.rising.sum()) > self.n_layers

    @property
    def ramps(self) -> Bool:
        """(L,) the first and the last turn of a spiral, where the extrusion height grows from or ends with 0."""
        result = np.zeros(self.n_layers, np.bool_)
        if self.spiral:
            result[np.flatnonzero(self.rising)[[0, -1]]] = True
        return result


def split_thick_extrusions(stack: Stack) -> tuple[Stack, Int]:
    """Split extrusions that fill several layers; return the new stack, and (B,) the original extrusion of each.

    Inner perimeters and sparse infill may be laid so, and everything of an object whose layers are not those of others.
    The parts of a layer stand in the order of their beads.
    """
    beads, own = stack.beads, np.maximum(stack.layer, 0)
    deep = stack.layer > 0
    deep &= beads.height > stack.height[own] + _AGREES if stack.n_layers else False
    outermost = deep & (beads.purpose == Purpose.EXTERNAL_PERIMETER)
    find_detached = np.isin(stack.layer, stack.layer[outermost]) & (beads.purpose != Purpose.BRIDGE)
    deep &= np.isin(beads.purpose, _FILL_SEVERAL) | find_detached
    if not deep.any():
        return stack, np.arange(beads.n_beads)
    lowest = np.searchsorted(stack.bottom, stack.top[own] - beads.height - _LEVEL)
    first = np.where(deep, np.minimum(lowest, own), stack.layer)
    count = stack.layer - first + 1
    source, layer = np.repeat(np.arange(beads.n_beads), count), consecutive(first, count)
    order = np.argsort(layer, kind="stable")
    source, layer = source[order], layer[order]
    cut, parts = deep[source], beads.take(source)
    height = np.where(cut, stack.height[np.maximum(layer, 0)], parts.height)
    parts = replace(
        parts,
        z_top=np.where(cut, stack.top[np.maximum(layer, 0)], parts.z_top),
        height=height,
        area=np.where(cut, parts.area * height / parts.height, parts.area),
    )
    return Stack(parts, layer, stack.top, stack.bottom), source


def stack_of_program(program: Program, filament_diameter: float) -> Stack:
    """Return the extrusions of a program in the layers of its plan, including empty layers.

    Args:
        program: the moves.
        filament_diameter: mm.
    """
    beads, move = extrusions_of_program(program, filament_diameter)
    plan = program.plan
    return Stack(beads, program.layer[move], plan.top, plan.bottom)


def stack_extrusions(beads: Extrusions, part: Bool | None = None) -> Stack:
    """Assign extrusions to layers.

    A layer is a z at which beads lie flat. Where z rises while beads are laid, a turn of the spiral is one. A layer is
    as high as the step from what lies below, whatever comments say.

    Args:
        beads: in the order in which they are laid.
        part: (B,) which beads are of the part; the rest makes no layers. None: all but supports and what lies beside.
    """
    own = ~np.isin(beads.purpose, NOT_PART) if part is None else part
    own = own & (beads.z_top > _LEVEL)  # what is laid on the bed itself, or under it, has no height
    flat = _lie_flat(beads, own)
    levels = _levels(beads.z_top[own & flat])
    rim = _is_rim(levels, beads, own & ~flat)
    levels = levels[:-1] if rim else levels
    above = beads.z_top > levels.max(initial=0.0) + _LEVEL
    edges = _turns(beads.take(np.flatnonzero(own & ~flat & above)), levels)
    free = np.flatnonzero(own & (~flat | rim) & above)
    turns = (edges[1:] + edges[:-1]) / 2
    top = np.concatenate([levels, turns])
    bottom = np.concatenate([np.zeros(1), top[:-1]])[: len(top)]
    bottom[len(levels) : len(levels) + 1] = turns[:1] - np.diff(edges)[:1]
    if len(levels):
        # On a raft, what lies below the first layer of the part is the raft, or a little air over it.
        raft = (beads.purpose == Purpose.SUPPORT_MATERIAL) & (beads.z_top < top[0] - _THINNEST)
        below = float(beads.z_top[raft].max(initial=0.0))
        comment_height = beads.height[own & (np.abs(beads.z_top - top[0]) < _LEVEL)]
        comment_height = comment_height[~np.isnan(comment_height)]
        usual = top[0] - (
            float(np.median(comment_height))
            if len(comment_height)
            else float(np.diff(top[:2]).sum() or np.inf)
        )
        bottom[0] = np.clip(usual, below, below + _CONTACT) if raft.any() else 0.0
    layer = np.searchsorted(levels, beads.z_top - _LEVEL)
    middle = beads.z_top[free] - beads.rise[free] / 2
    layer[free] = len(levels) + np.searchsorted(edges[1:-1], middle, side="right")
    away = np.abs(np.append(top, np.inf)[np.minimum(layer, len(top))] - beads.z_top) > 2 * _LEVEL
    layer = np.where((away & ~own) | (layer >= len(top)), -1, layer)
    return Stack(replace(beads, height=_heights(beads, layer, top, bottom, len(levels))), layer, top, bottom)


def _lie_flat(beads: Extrusions, own: Bool) -> Bool:
    """Return a mask (B,) of extrusions that stay at one height.

    In spirals z is rounded, so short beads seem flat between others that rise; flat runs so short are no layers.
    """
    flat = np.abs(beads.rise) < _FLAT
    index = np.flatnonzero(own)
    if flat[index].all() or not len(index):
        return flat
    run = np.append(0, np.cumsum(np.diff(flat[index]) != 0))
    long = np.bincount(run, weights=beads.length[index]) > _SHORT
    result = flat.copy()
    result[index] &= long[run]
    return result


def _levels(z: Float) -> Float:
    """Return the distinct heights of extrusions; of heights that differ by rounding, the highest."""
    values = np.unique(np.round(z, 4))
    return np.asarray(values[np.append(np.diff(values) > _LEVEL, True)[: len(values)]])


def _is_rim(levels: Float, beads: Extrusions, sloped: Bool) -> bool:
    """Return whether the highest level is the flat last turn of a spiral and not a layer."""
    if len(levels) < 2:
        return False
    between = sloped & (beads.z_top > levels[-2] + _LEVEL)
    climbed = float(np.maximum(beads.rise[between], 0.0).sum())
    usual = float(np.diff(levels[:-1], prepend=0.0).max())
    return bool(levels[-1] - levels[-2] > 2.5 * usual and climbed > 0.9 * (levels[-1] - levels[-2]))


def _turns(free: Extrusions, levels: Float) -> Float:
    """Return the heights (T + 1,) at which the T turns of a spiral start and end, mm."""
    rise = float(np.maximum(free.rise, 0.0).sum())
    if not rise > 0:
        return np.zeros(1)
    # Once around any loop that does not cross itself, the heading turns once. That of very short beads is rounding.
    low = float((free.z_top - free.rise).min())
    free = free.take(np.flatnonzero(free.length >= min(_STEADY, float(free.length.max()))))
    way = free.end - free.begin
    heading = np.arctan2(way[:, 1], way[:, 0])
    turned = (np.diff(heading, prepend=heading[:1]) + pi) % (2 * pi) - pi
    turned = np.cumsum(turned) * np.sign(turned.sum() or 1.0) / (2 * pi)
    step = rise / max(float(turned[-1]), 1.0)
    n_turns = max(round(rise / step), 1)
    even = low + np.arange(n_turns + 1) * step
    # Where layers differ in height, so do turns.
    begins = np.searchsorted(np.maximum.accumulate(turned), np.arange(1, n_turns) - _HAIR)
    passed = (free.z_top - free.rise)[np.minimum(begins, free.n_beads - 1)]
    if (np.abs(passed - even[1:-1]) > _UNEVEN * step).any():
        return np.concatenate([even[:1], passed, np.array([low + rise])])
    usual = float(levels[-1] - levels[-2]) if len(levels) > 1 else 0.0
    if abs(step - usual) < usual / 10:
        even = low + np.arange(max(round(rise / usual), 1) + 1) * usual
    return np.asarray(even, np.float64)


def _heights(beads: Extrusions, layer: Int, top: Float, bottom: Float, n_flat: int) -> Float:
    """Return the height (B,) of each extrusion, mm.

    As thick as its layer, unless it may reach deeper and would be unusually wide otherwise. What comments tell counts
    where the moves allow it. Outermost perimeters are thicker than their layer only where objects have layers of their
    own; there all beads are as thick as comments tell.
    """
    comment_height = beads.height
    if not len(top):
        return np.maximum(np.where(np.isnan(comment_height), _UNKNOWN, comment_height), _THINNEST_BEAD)
    own = (top - bottom)[layer]
    sloped = (np.abs(beads.rise) >= _FLAT) & (layer < n_flat) & (layer >= 0)
    own = np.where(sloped, np.clip(beads.z_top - beads.rise / 2 - bottom[layer], own / 10, own), own)
    width = bead.width_for_section(beads.area, own)
    walls = np.isin(beads.purpose, _WALLS)
    thin = walls & ~(np.abs(comment_height - own) > _AGREES)
    usual = median_of(width, beads.length * (thin if thin.any() else walls if walls.any() else layer >= 0))
    height, may = own.copy(), np.isin(beads.purpose, _MAY_BE_THICK) & (layer >= 0)
    wide = may & (width > _WIDE * usual)
    may |= (beads.purpose == Purpose.PERIMETER) & (layer >= 0)  # if a comment says so; else they are wide
    for deep in range(1, _DEEPEST):
        reach = top[layer] - bottom[np.maximum(layer - deep, 0)]
        width = bead.width_for_section(beads.area, reach)
        wide &= layer >= deep
        agrees = may & (layer >= deep) & (np.abs(reach - comment_height) < _AGREES) & (width * _WIDE > usual)
        by_comment = (
            (layer >= deep)
            & (np.abs(reach - comment_height) < _AGREES)
            & (np.abs(comment_height - own) > _AGREES)
        )
        agrees |= by_comment & np.isin(
            layer, layer[by_comment & (beads.purpose == Purpose.EXTERNAL_PERIMETER)]
        )
        height[wide | agrees] = reach[wide | agrees]
        wide &= ~agrees & (width > _WIDE * usual)
    # Threads across a gap hang freely, as thick as they leave the nozzle.
    thread = (beads.purpose == Purpose.BRIDGE) & (comment_height > own + _AGREES)
    height = np.where(
        thread, np.maximum(np.minimum(comment_height, np.sqrt(4 * beads.area / pi)), own), height
    )
    beside = (layer < 0) & ~np.isnan(comment_height)
    return np.maximum(np.where(beside, comment_height, height), _THINNEST_BEAD)
