"""Find the layers of a file from its extrusions, and the height of each extrusion."""

from __future__ import annotations

from math import pi
from typing import Final

import numpy as np

from printer_slicer import bead
from printer_slicer.arrays import Bool, Float, Int, consecutive, frozen_array
from printer_slicer.inspection.coverage.contours import mark_contoured
from printer_slicer.inspection.coverage.extrusions import (
    Extrusions,
    Purpose,
    extrusions_of_program,
    weighted_median,
)
from printer_slicer.inspection.deposition.marks import NOT_PART
from printer_slicer.model import Program
from printer_slicer.values import Struct, force_setattr, replace

__all__ = ["Stack", "split_thick_extrusions", "stack_extrusions", "stack_of_program"]

_MIN_HEADING_LENGTH: Final = 0.1  # mm; the direction of shorter extrusions is not exact
_TURN_TOLERANCE: Final = 0.02  # turns
_MAX_UNEVENNESS: Final = 0.2  # of the height of a turn; more means that turns differ in height
_SAME_HEIGHT: Final = 0.004  # mm; closer nozzle heights are one layer; files round z to 0.001 or 0.01
_MAX_DEPTH: Final = 8  # maximum number of layers that one extrusion fills
_WIDE_RATIO: Final = (
    1.3  # times the usual width; wider extrusions are higher than their layer, if their role allows
)
_HEIGHT_TOLERANCE: Final = 0.01  # mm; tolerance for the heights in comments
_MIN_HEIGHT: Final = 1e-3  # mm, for finite widths
_MIN_RAFT_STEP: Final = 0.04  # mm; no layer on a raft is thinner
_MAX_RAFT_GAP: Final = 0.3  # mm, largest gap that slicers leave between raft and part
_MAX_FLAT_RISE: Final = 1e-4  # mm, change of z along a flat extrusion
_MIN_FLAT_LENGTH: Final = 5.0  # mm; shorter flat runs in a spiral come from rounding
_DEFAULT_HEIGHT: Final = 0.2  # mm; assumed height of extrusions without a layer
_ONE_GROUP: Final = frozen_array([], np.int64, (0,))  # of all layers
_GROUP_HEIGHT: Final = 1e4  # mm; no part is higher
_WALLS: Final = (Purpose.EXTERNAL_PERIMETER, Purpose.PERIMETER)
_MAY_BE_THICK: Final = (
    Purpose.UNKNOWN,
    Purpose.BRIDGE,
    Purpose.INTERNAL_INFILL,
    Purpose.SUPPORT_MATERIAL,
    Purpose.OVERHANG_PERIMETER,
)
_FILL_SEVERAL_LAYERS: Final = (Purpose.PERIMETER, Purpose.INTERNAL_INFILL)


class Stack(Struct, frozen=True, eq=False):
    """Extrusions, and the layers to which they belong.

    Attributes:
        beads: the extrusions, with their heights.
        layer: (B,) layer of each; -1 for extrusions beside the part and for supports between its layers.
        top: (L,) mm, ascending; layers of different groups may have the same top.
        bottom: (L,) mm, top of the material of the same group below each layer.
        group: (L,) number of the group of objects that has each layer; 0 if all objects have the same layers. Nothing
            given means this.
    """

    beads: Extrusions
    layer: Int
    top: Float
    bottom: Float
    group: Int = _ONE_GROUP

    def __post_init__(self) -> None:
        if not len(self.group):
            force_setattr(self, "group", np.zeros(len(self.top), np.int64))
        for name, dtype, shape in (
            ("layer", np.int64, (self.beads.n_beads,)),
            ("top", np.float64, (-1,)),
            ("bottom", np.float64, (len(self.top),)),
            ("group", np.int64, (len(self.top),)),
        ):
            force_setattr(self, name, frozen_array(getattr(self, name), dtype, shape))

    @property
    def n_layers(self) -> int:
        """Number of layers."""
        return len(self.top)

    @property
    def number(self) -> Int:
        """Number (L,) of each layer in the file, from 1; layers of different groups with the same top share it."""
        return np.asarray(np.cumsum(np.diff(self.top, prepend=-1.0) > _SAME_HEIGHT))

    @property
    def by_group(self) -> Int:
        """Layer indices (L,): the layers of the first group in ascending order, then those of the next group."""
        return np.asarray(np.argsort(self.group, kind="stable"))

    def layers_of_groups(self) -> list[Int]:
        """Return the layer indices of each group, ascending."""
        return [np.flatnonzero(self.group == one) for one in np.unique(self.group)]

    def list_adjacent_layers(self, layers: Int) -> tuple[Int, Int]:
        """Return the layers of other groups directly below the first layer of a group, and directly above its last.

        Args:
            layers: indices of all layers of the group, ascending.
        """
        is_other = self.group != self.group[layers[0]]
        below = is_other & (np.abs(self.top - self.bottom[layers[0]]) < _HEIGHT_TOLERANCE)
        above = is_other & (np.abs(self.bottom - self.top[layers[-1]]) < _HEIGHT_TOLERANCE)
        return np.flatnonzero(below), np.flatnonzero(above)

    @property
    def height(self) -> Float:
        """Layer heights (L,), mm."""
        return self.top - self.bottom

    @property
    def has_rising_z(self) -> Bool:
        """Mask (L,) of layers printed mostly while z rises, and in a spiral vase of all layers above."""
        own = self.layer >= 0
        rises = (np.abs(self.beads.rise) >= _MAX_FLAT_RISE) & ~self.beads.is_contoured
        length = self.beads.length * np.where(rises, 1.0, -0.9)
        found = np.bincount(self.layer[own], length[own], self.n_layers) > 0
        if 2 * int(found.sum()) > self.n_layers:
            found[int(found.argmax()) :] = True
        return np.asarray(found)

    @property
    def is_spiral(self) -> bool:
        """Whether the print is a spiral vase."""
        return 2 * int(self.has_rising_z.sum()) > self.n_layers

    @property
    def is_spiral_end(self) -> Bool:
        """Mask (L,) of the first and last turn of a spiral vase, whose height starts or ends at 0."""
        result = np.zeros(self.n_layers, np.bool_)
        if self.is_spiral:
            result[np.flatnonzero(self.has_rising_z)[[0, -1]]] = True
        return result


def split_thick_extrusions(stack: Stack) -> tuple[Stack, Int]:
    """Split extrusions that fill several layers; return the new stack, and each extrusion's old index (B,).

    Inner perimeters and sparse infill may fill several layers, and so may all extrusions of an object whose layers
    differ from those of other objects. The parts of a layer are in the order of their extrusions.
    """
    beads, own = stack.beads, np.maximum(stack.layer, 0)
    deep = stack.layer > 0
    deep &= beads.height > stack.height[own] + _HEIGHT_TOLERANCE if stack.n_layers else False
    deep &= ~beads.is_contoured
    outermost = deep & (beads.purpose == Purpose.EXTERNAL_PERIMETER)
    is_separate = np.isin(stack.layer, stack.layer[outermost]) & (beads.purpose != Purpose.BRIDGE)
    deep &= np.isin(beads.purpose, _FILL_SEVERAL_LAYERS) | is_separate
    if not deep.any():
        return stack, np.arange(beads.n_beads)
    place, first = _find_lowest_filled(stack, own, beads.height)
    first = np.where(deep, first, place)
    count = place - first + 1
    source, layer = np.repeat(np.arange(beads.n_beads), count), stack.by_group[consecutive(first, count)]
    layer = np.where(stack.layer[source] < 0, -1, layer)
    order = np.argsort(layer, kind="stable")
    source, layer = source[order], layer[order]
    is_split, parts = deep[source], beads.take(source)
    height = np.where(is_split, stack.height[np.maximum(layer, 0)], parts.height)
    parts = replace(
        parts,
        z_top=np.where(is_split, stack.top[np.maximum(layer, 0)], parts.z_top),
        height=height,
        area=np.where(is_split, parts.area * height / parts.height, parts.area),
    )
    return Stack(parts, layer, stack.top, stack.bottom, stack.group), source


def _find_lowest_filled(stack: Stack, layer: Int, height: Float) -> tuple[Int, Int]:
    """Return the place (B,) of layers in the order `by_group`, and that of the lowest layer within a height, mm."""
    by_group = stack.by_group
    place = np.argsort(by_group)[layer]
    above = _GROUP_HEIGHT * stack.group
    low = stack.top[layer] - height - _SAME_HEIGHT
    lowest = np.searchsorted((above + stack.bottom)[by_group], above[layer] + low)
    return place, np.minimum(lowest, place)


def stack_of_program(program: Program, filament_diameter: float) -> Stack:
    """Return the extrusions of a program, and the layers of its layer plan, including empty layers.

    Args:
        program: the moves.
        filament_diameter: mm.
    """
    beads, move = extrusions_of_program(program, filament_diameter)
    plan, layer = program.plan, program.layer[move]
    beads = mark_contoured(beads, layer + 1, plan.top[layer])
    local = np.maximum(beads.middle_z - plan.bottom[layer], _MIN_HEIGHT)
    beads = replace(beads, height=np.where(beads.is_contoured, local, beads.height))
    return Stack(beads, layer, plan.top, plan.bottom)


def stack_extrusions(beads: Extrusions, part: Bool | None = None, lowest: float | None = None) -> Stack:
    """Assign extrusions to layers.

    A layer is a z with flat extrusions. Where z rises during extrusion, each turn of the spiral is a layer. Contoured
    extrusions belong to the layer of their `layer_top`. The height of a layer is its distance from the material below,
    regardless of comments.

    Args:
        beads: the extrusions, in printing order.
        part: (B,) mask of extrusions that make layers; None: all but supports, skirts and priming.
        lowest: bottom of the first layer, mm; None: the bed, or the top of a raft and perhaps a gap above it.
    """
    of_part = ~np.isin(beads.purpose, NOT_PART) if part is None else part
    level = beads.level
    of_part = of_part & (level > _SAME_HEIGHT)  # extrusions at or below z = 0 have no height
    flat = _find_flat_extrusions(beads, of_part)
    levels = _distinct_heights(level[of_part & flat])
    has_rim = _ends_with_flat_turn(levels, beads, of_part & ~flat)
    levels = levels[:-1] if has_rim else levels
    above = level > levels.max(initial=0.0) + _SAME_HEIGHT
    edges = _turn_heights(beads.take(np.flatnonzero(of_part & ~flat & above)), levels)
    free = np.flatnonzero(of_part & (~flat | has_rim) & above)
    turns = (edges[1:] + edges[:-1]) / 2
    top = np.concatenate([levels, turns])
    bottom = np.concatenate([np.zeros(1), top[:-1]])[: len(top)]
    bottom[len(levels) : len(levels) + 1] = turns[:1] - np.diff(edges)[:1]
    if len(levels) and lowest is not None:
        bottom[0] = lowest
    elif len(levels):
        # On a raft, the raft or a small gap above it is below the first layer of the part.
        raft = (beads.purpose == Purpose.SUPPORT_MATERIAL) & (beads.z_top < top[0] - _MIN_RAFT_STEP)
        below = float(beads.z_top[raft].max(initial=0.0))
        comment_height = beads.height[of_part & (np.abs(level - top[0]) < _SAME_HEIGHT)]
        comment_height = comment_height[~np.isnan(comment_height)]
        usual = top[0] - (
            float(np.median(comment_height))
            if len(comment_height)
            else float(np.diff(top[:2]).sum() or np.inf)
        )
        bottom[0] = np.clip(usual, below, below + _MAX_RAFT_GAP) if raft.any() else 0.0
    layer = np.searchsorted(levels, level - _SAME_HEIGHT)
    middle = beads.middle_z[free]
    layer[free] = len(levels) + np.searchsorted(edges[1:-1], middle, side="right")
    is_away = np.abs(np.append(top, np.inf)[np.minimum(layer, len(top))] - level) > 2 * _SAME_HEIGHT
    layer = np.where((is_away & ~of_part) | (layer >= len(top)), -1, layer)
    return Stack(
        replace(beads, height=_extrusion_heights(beads, layer, top, bottom, len(levels))), layer, top, bottom
    )


def _find_flat_extrusions(beads: Extrusions, of_part: Bool) -> Bool:
    """Return a mask (B,) of extrusions at constant z, and of contoured ones.

    In spirals z is rounded, so short extrusions between rising ones seem flat. Such short flat runs are no layers.
    """
    flat = (np.abs(beads.rise) < _MAX_FLAT_RISE) | beads.is_contoured
    index = np.flatnonzero(of_part)
    if flat[index].all() or not len(index):
        return flat
    run = np.append(0, np.cumsum(np.diff(flat[index]) != 0))
    long = np.bincount(run, weights=beads.length[index]) > _MIN_FLAT_LENGTH
    result = flat.copy()
    result[index] &= long[run]
    return result


def _distinct_heights(z: Float) -> Float:
    """Return the distinct heights of extrusions; merge heights that differ by rounding to the highest."""
    values = np.unique(np.round(z, 4))
    return np.asarray(values[np.append(np.diff(values) > _SAME_HEIGHT, True)[: len(values)]])


def _ends_with_flat_turn(levels: Float, beads: Extrusions, sloped: Bool) -> bool:
    """Return whether the highest level is the flat last turn of a spiral, and not a layer."""
    if len(levels) < 2:
        return False
    between = sloped & (beads.z_top > levels[-2] + _SAME_HEIGHT)
    climbed = float(np.maximum(beads.rise[between], 0.0).sum())
    usual = float(np.diff(levels[:-1], prepend=0.0).max())
    return bool(levels[-1] - levels[-2] > 2.5 * usual and climbed > 0.9 * (levels[-1] - levels[-2]))


def _turn_heights(sloped: Extrusions, levels: Float) -> Float:
    """Return the heights (T + 1,) at which the T turns of a spiral start and end, mm."""
    rise = float(np.maximum(sloped.rise, 0.0).sum())
    if not rise > 0:
        return np.zeros(1)
    # Around any simple loop, the heading turns once. The heading of very short extrusions is not exact.
    low = float((sloped.z_top - sloped.rise).min())
    sloped = sloped.take(
        np.flatnonzero(sloped.length >= min(_MIN_HEADING_LENGTH, float(sloped.length.max())))
    )
    way = sloped.end - sloped.begin
    heading = np.arctan2(way[:, 1], way[:, 0])
    turned = (np.diff(heading, prepend=heading[:1]) + pi) % (2 * pi) - pi
    turned = np.cumsum(turned) * np.sign(turned.sum() or 1.0) / (2 * pi)
    step = rise / max(float(turned[-1]), 1.0)
    n_turns = max(round(rise / step), 1)
    even = low + np.arange(n_turns + 1) * step
    # If the layers differ in height, so do the turns.
    begins = np.searchsorted(np.maximum.accumulate(turned), np.arange(1, n_turns) - _TURN_TOLERANCE)
    passed = (sloped.z_top - sloped.rise)[np.minimum(begins, sloped.n_beads - 1)]
    if (np.abs(passed - even[1:-1]) > _MAX_UNEVENNESS * step).any():
        return np.concatenate([even[:1], passed, np.array([low + rise])])
    usual = float(levels[-1] - levels[-2]) if len(levels) > 1 else 0.0
    if abs(step - usual) < usual / 10:
        even = low + np.arange(max(round(rise / usual), 1) + 1) * usual
    return np.asarray(even, np.float64)


def _extrusion_heights(beads: Extrusions, layer: Int, top: Float, bottom: Float, n_flat: int) -> Float:
    """Return the height (B,) of each extrusion, mm.

    An extrusion is as high as its layer, unless its role allows more and it would be unusually wide otherwise. Heights
    in comments count if the moves allow them. External perimeters are higher than their layer only if objects have
    layers of their own; then all extrusions of these layers have the heights in the comments.
    """
    comment_height = beads.height
    if not len(top):
        return np.maximum(np.where(np.isnan(comment_height), _DEFAULT_HEIGHT, comment_height), _MIN_HEIGHT)
    layer_height = (top - bottom)[layer]
    sloped = ((np.abs(beads.rise) >= _MAX_FLAT_RISE) | beads.is_contoured) & (layer < n_flat) & (layer >= 0)
    most = np.where(
        beads.is_contoured, np.inf, layer_height
    )  # a contoured extrusion may be higher than its layer
    layer_height = np.where(
        sloped, np.clip(beads.middle_z - bottom[layer], layer_height / 10, most), layer_height
    )
    width = bead.width_for_section(beads.area, layer_height)
    walls = np.isin(beads.purpose, _WALLS)
    thin = walls & ~(np.abs(comment_height - layer_height) > _HEIGHT_TOLERANCE)
    usual = weighted_median(
        width, beads.length * (thin if thin.any() else walls if walls.any() else layer >= 0)
    )
    may_be_thick = np.isin(beads.purpose, _MAY_BE_THICK) & (layer >= 0) & ~beads.is_contoured
    height = layer_height.copy()
    wide = may_be_thick & (width > _WIDE_RATIO * usual)
    # Perimeters are only thick if a comment says so.
    may_be_thick |= (beads.purpose == Purpose.PERIMETER) & (layer >= 0) & ~beads.is_contoured
    for deep in range(1, _MAX_DEPTH):
        reach = top[layer] - bottom[np.maximum(layer - deep, 0)]
        width = bead.width_for_section(beads.area, reach)
        wide &= layer >= deep
        matching = (layer >= deep) & (np.abs(reach - comment_height) < _HEIGHT_TOLERANCE)
        agrees = may_be_thick & matching & (width * _WIDE_RATIO > usual)
        by_comment = matching & (np.abs(comment_height - layer_height) > _HEIGHT_TOLERANCE)
        by_comment &= ~beads.is_contoured
        external = by_comment & (beads.purpose == Purpose.EXTERNAL_PERIMETER)
        agrees |= by_comment & np.isin(layer, layer[external])
        height[wide | agrees] = reach[wide | agrees]
        wide &= ~agrees & (width > _WIDE_RATIO * usual)
    height = _fill_many_layers(beads, layer, (top, bottom), height, usual)
    # Extrusions across a gap are as thick as the strand that leaves the nozzle.
    thread = (beads.purpose == Purpose.BRIDGE) & (comment_height > layer_height + _HEIGHT_TOLERANCE)
    thread &= ~beads.is_contoured
    height = np.where(
        thread, np.maximum(np.minimum(comment_height, np.sqrt(4 * beads.area / pi)), layer_height), height
    )
    beside = (layer < 0) & ~np.isnan(comment_height)
    return np.maximum(np.where(beside, comment_height, height), _MIN_HEIGHT)


def _fill_many_layers(
    beads: Extrusions, layer: Int, layers: tuple[Float, Float], height: Float, usual: float
) -> Float:
    """Return heights (B,), mm, in which extrusions that fill at least `_MAX_DEPTH` layers have those in comments.

    Only objects with layers of their own have these, so an external perimeter in the layer must be as high, and about
    as wide as usual, mm. `layers` are the tops and bottoms (L,) of the layers, mm.
    """
    top, bottom = layers
    place, comment_height = np.maximum(layer, 0), beads.height
    lowest = np.searchsorted(bottom, top[place] - comment_height - _HEIGHT_TOLERANCE)
    deep = (layer - lowest >= _MAX_DEPTH) & ~np.isnan(comment_height)
    reach = top[place] - bottom[np.minimum(lowest, len(bottom) - 1)]
    deep &= np.abs(reach - comment_height) < _HEIGHT_TOLERANCE
    external = np.flatnonzero(deep & (beads.purpose == Purpose.EXTERNAL_PERIMETER))
    is_usual = bead.width_for_section(beads.area[external], reach[external]) * _WIDE_RATIO > usual
    return np.where(deep & np.isin(layer, layer[external[is_usual]]), reach, height)
