"""Select a single layer of a file, with all its extrusions, including supports, rafts and skirts."""

from __future__ import annotations

from typing import Final

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, frozen_array
from printer_slicer.inspection.coverage.extrusions import Extrusions, Purpose
from printer_slicer.inspection.coverage.gcode_extrusions import GcodeExtrusions
from printer_slicer.inspection.coverage.stack import Stack
from printer_slicer.values import Struct, force_setattr, replace

__all__ = ["FileLayers", "LayerExtrusions", "extrusions_of_layer", "file_layers_of"]

_SAME_HEIGHT: Final = 0.004  # mm; nozzle heights that differ by less are one layer, as in `stack`
_HEIGHT_TOLERANCE: Final = 0.01  # mm
_WALLS: Final = (Purpose.EXTERNAL_PERIMETER, Purpose.PERIMETER)


class FileLayers(Struct, frozen=True, eq=False):
    """The layers of a file, including layers that have only supports or raft.

    Attributes:
        beads: the extrusions, with their heights.
        level: (B,) layer of each extrusion; -1 outside all layers, such as a priming line.
        top: (L,) mm, ascending.
        bottom: (L,) mm.
        of_stack: (L,) the same layer in the stack of the part; -1 without one.
    """

    beads: Extrusions
    level: Int
    top: Float
    bottom: Float
    of_stack: Int

    def __post_init__(self) -> None:
        for name, dtype, shape in (
            ("level", np.int64, (self.beads.n_beads,)),
            ("top", np.float64, (-1,)),
            ("bottom", np.float64, (len(self.top),)),
            ("of_stack", np.int64, (len(self.top),)),
        ):
            force_setattr(self, name, frozen_array(getattr(self, name), dtype, shape))

    @property
    def n_layers(self) -> int:
        """Number of layers."""
        return len(self.top)

    def layer_at(self, z: float) -> int:
        """Return the index of the layer at a height, mm; the lower layer where two meet; else -1."""
        index = int(np.searchsorted(self.top, z - _SAME_HEIGHT))
        return index if z >= 0 and index < self.n_layers else -1

    def layer_of_line(self, line: int) -> int:
        """Return the index of the layer that a line of the file belongs to; -1 outside the extrusions of all layers."""
        in_layers = np.flatnonzero(self.level >= 0)
        lines = self.beads.line[in_layers]
        index = int(np.searchsorted(lines, line))
        is_between = index < len(lines) and line >= lines[0]
        return int(self.level[in_layers[index]]) if is_between else -1


class LayerExtrusions(Struct, frozen=True, eq=False):
    """The extrusions of one layer, or of all up to one, in printing order.

    Attributes:
        number: index of the layer, from 0; the last one of several.
        count: number of layers in the file.
        top, height: of this layer, mm.
        beads: with their heights.
        name: (B,) role name in the file, as an index into `names`.
        names: role names of the file; empty for extrusions without one.
        travel: (T, 2, 2) mm, travel moves to and between these extrusions.
    """

    number: int
    count: int
    top: float
    height: float
    beads: Extrusions
    name: Int
    names: tuple[str, ...]
    travel: Float

    def __post_init__(self) -> None:
        force_setattr(self, "name", frozen_array(self.name, np.int64, (self.beads.n_beads,)))
        force_setattr(self, "travel", frozen_array(self.travel, np.float64, (-1, 2, 2)))


def file_layers_of(gcode: GcodeExtrusions, stack: Stack) -> FileLayers:
    """Return the layers of a file.

    Args:
        gcode: extrusions of the file.
        stack: layers of the part in the file.
    """
    beads, comment_height = stack.beads, gcode.beads.height
    outside_stack = stack.layer < 0
    new_tops = _find_unknown_heights(
        beads.z_top[outside_stack & (beads.purpose == Purpose.SUPPORT_MATERIAL)], stack.top
    )
    top = np.concatenate([stack.top, new_tops])
    if not len(top):
        return FileLayers(beads, np.full(beads.n_beads, -1), top, top, np.zeros(0, np.int64))
    order = np.argsort(top)
    top = top[order]
    of_stack = np.append(np.arange(stack.n_layers), np.full(len(new_tops), -1))[order]
    bottom = np.where(of_stack < 0, np.append(0.0, top[:-1]), np.append(stack.bottom, 0.0)[of_stack])
    near = np.minimum(np.searchsorted(top, beads.z_top - _SAME_HEIGHT), len(top) - 1)
    hit = np.abs(top[near] - beads.z_top) <= 2 * _SAME_HEIGHT
    place = np.argsort(order)  # index in the sorted layers of each unsorted layer
    level = np.where(outside_stack, np.where(hit, near, -1), place[stack.layer])
    # Extrusions outside the layers of the stack get the height of their file layer.
    height = np.where(outside_stack & np.isnan(comment_height) & hit, (top - bottom)[near], beads.height)
    # The layer below may be one of another object, so it may be nearer than the layer is high.
    own = _find_usual_heights(replace(beads, height=comment_height), level, len(top))
    bottom = np.where(own > top - bottom + _HEIGHT_TOLERANCE, np.maximum(top - own, 0.0), bottom)
    return FileLayers(replace(beads, height=height), level, top, bottom, of_stack)


def _find_usual_heights(beads: Extrusions, level: Int, count: int) -> Float:
    """Return the median height (L,) of the perimeters of each layer, by length, mm; NaN where none is known.

    Args:
        beads: with the heights in the comments of the file; NaN where there are none.
        level: (B,) layer of each; -1 for none.
        count: L, the number of layers.
    """
    is_known = np.isin(beads.purpose, _WALLS) & np.isfinite(beads.height) & (level >= 0)
    known = np.flatnonzero(is_known & (beads.length > 0))
    if not len(known):
        return np.full(count, np.nan)
    known = known[np.lexsort((beads.height[known], level[known]))]
    total = np.bincount(level[known], beads.length[known], count)
    middle = np.searchsorted(np.cumsum(beads.length[known]), np.cumsum(total) - total / 2)
    found = beads.height[known[np.minimum(middle, len(known) - 1)]]
    return np.where(total > 0, found, np.nan)


def _find_unknown_heights(z: Float, known: Float) -> Float:
    """Return the heights in `z` that are not in `known`; merge heights that differ only by rounding."""
    values = np.unique(np.round(z[z > _SAME_HEIGHT], 4))
    values = values[np.append(np.diff(values) > _SAME_HEIGHT, True)[: len(values)]]
    if not len(known):
        return np.asarray(values)
    return np.asarray(values[np.abs(values[:, None] - known).min(axis=1) > 2 * _SAME_HEIGHT])


def extrusions_of_layer(
    gcode: GcodeExtrusions, file_layers: FileLayers, number: int, *, with_lower: bool = False
) -> LayerExtrusions:
    """Return the extrusions of one layer.

    Args:
        gcode: extrusions of the file.
        file_layers: layers of the file.
        number: index of the layer, from 0.
        with_lower: also return the extrusions of all layers below it.

    Raises:
        ValueError: there is no such layer.
    """
    if not 0 <= number < file_layers.n_layers:
        raise ValueError(f"layer {number} is not in the file, which has {file_layers.n_layers} layers")
    level = file_layers.level
    selected: Bool = (level >= 0) & (level <= number) if with_lower else level == number
    leads_to_selected = np.append(selected, False)[gcode.before]
    return LayerExtrusions(
        number=number,
        count=file_layers.n_layers,
        top=float(file_layers.top[number]),
        height=float(file_layers.top[number] - file_layers.bottom[number]),
        beads=file_layers.beads.take(selected),
        name=gcode.name[selected],
        names=gcode.names,
        travel=gcode.travel[leads_to_selected],
    )
