"""Print the internal infill of several thin layers in one thick layer, which saves time.

Sources: Sabourin, Houser & Bohn, Accurate exterior, fast interior layered manufacturing, 1997; Ma & He, An adaptive
slicing and selective hatching strategy for layered manufacturing, 1999.
"""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Float, Int, frozen_array, run_starts
from printer_slicer.combine_layers import (
    choose_groups,
    compute_area_savings,
    find_last_layers,
    find_tallest_groups,
)
from printer_slicer.geometry import Areas, difference, offset_open, window_intersection
from printer_slicer.model import LayerPlan
from printer_slicer.values import Struct, force_setattr

__all__ = ["InfillAreas", "combine_infill_areas", "group_layers"]


class InfillAreas(Struct, frozen=True, eq=False):
    """Areas of internal infill, as E entries, each of which is printed on one layer.

    Attributes:
        area: E entries.
        layer: (E,) the layer that prints the entry.
        height: (E,) mm, height of the extrusions, from the top of that layer down.
        turn: (E,) counter of entries above each other, for patterns that alternate.
    """

    area: Areas
    layer: Int
    height: Float
    turn: Int

    def __post_init__(self) -> None:
        n = self.area.n_layers
        for name, dtype in (("layer", np.int64), ("height", np.float64), ("turn", np.int64)):
            force_setattr(self, name, frozen_array(getattr(self, name), dtype, (n,)))


def combine_infill_areas(infill: Areas, plan: LayerPlan, groups: Int, narrowest: float) -> InfillAreas:
    """Combine the infill areas of each group of layers.

    The area that all layers of a group share is printed on its last layer. The rest is printed layer by layer.

    Args:
        infill: internal infill area of each layer.
        plan: the layers.
        groups: (L,) first layer of the group of each layer.
        narrowest: mm; narrower shared areas are printed layer by layer, and narrower remainders stay empty.
    """
    own = np.arange(plan.n_layers)
    if (groups == own).all():
        return InfillAreas(infill, own, plan.height, own)
    last = find_last_layers(groups)
    several = groups < last
    ends = several & (last == own)
    common = window_intersection(infill, np.where(ends, groups, own), own + 1)
    common = offset_open(common.of_layers(ends), narrowest / 2)
    rest = difference(infill, common.copy_layers(last))
    wide = offset_open(rest.of_layers(several), narrowest / 2)
    return InfillAreas(
        _concatenate_stacks(rest.of_layers(~several).merge(wide), common),
        np.tile(own, 2),
        np.concatenate([plan.height, plan.top - plan.bottom[groups]]),
        np.tile(_count_turns(groups), 2),
    )


def group_layers(
    infill: Areas,
    plan: LayerPlan,
    limit: float,
    groups: Int | None = None,
    *,
    lowest_allowed: Int | None = None,
) -> Int:
    """Divide the layers into groups whose infill is printed together; return the first layer (L,) of their groups.

    Groups are at most `limit` high and the same over the whole part. The division that saves the most extrusion is
    chosen, so groups end at solid infill and at changes of the outline.

    Args:
        infill: internal infill area of each layer.
        plan: the layers.
        limit: mm, greatest height of a group; 0 or less than two layers: no groups.
        groups: (L,) known groups; those higher than `limit` are divided into single layers.
        lowest_allowed: (L,) lowest layer that each layer may be grouped with.
    """
    lowest = find_tallest_groups(plan, limit)
    lowest = lowest if lowest_allowed is None else np.maximum(lowest, lowest_allowed)
    if groups is None:
        return choose_groups(compute_area_savings(infill, lowest))
    return np.where(groups >= lowest[find_last_layers(groups)], groups, np.arange(plan.n_layers))


def _count_turns(groups: Int) -> Int:
    """Return the counter (L,) by which patterns alternate: the group number plus the number of group layers above."""
    own = np.arange(len(groups))
    number = np.cumsum(run_starts(groups)) - 1
    return np.asarray(number + find_last_layers(groups) - own, np.int64)


def _concatenate_stacks(one: Areas, another: Areas) -> Areas:
    """Concatenate two stacks, the second above the first."""
    return Areas(
        np.concatenate([one.xy, another.xy]),
        np.concatenate([one.ring_start, another.ring_start[1:] + len(one.xy)]),
        np.concatenate([one.ring_layer, another.ring_layer + one.n_layers]),
        one.n_layers + another.n_layers,
    )
