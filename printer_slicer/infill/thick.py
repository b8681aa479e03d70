"""Sparse infill of several layers in one bead: the accurate outside thin, the fast inside thick.

Sources: Sabourin, Houser & Bohn, Accurate exterior, fast interior layered manufacturing, 1997; Ma & He, An adaptive
slicing and selective hatching strategy for layered manufacturing, 1999.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from printer_slicer.arrays import Float, Int, frozen_array, run_starts
from printer_slicer.combine_layers import area_savings, choose_groups, last_layers, tallest_groups
from printer_slicer.geometry import Areas, difference, offset_open, window_intersection
from printer_slicer.model import LayerPlan

__all__ = ["Fillings", "fillings", "groups_of"]


@dataclass(frozen=True, slots=True, eq=False)
class Fillings:
    """What is filled with sparse infill, and how high its beads are; an entry (E of them) is filled on one layer.

    Attributes:
        area: E entries.
        layer: (E,) on which it is printed.
        height: (E,) mm, how far down from the top of that layer the beads reach.
        turn: (E,) counts the entries above each other, for patterns that take turns.
    """

    area: Areas
    layer: Int
    height: Float
    turn: Int

    def __post_init__(self) -> None:
        n = self.area.n_layers
        for name, dtype in (("layer", np.int64), ("height", np.float64), ("turn", np.int64)):
            object.__setattr__(self, name, frozen_array(getattr(self, name), dtype, (n,)))


def fillings(sparse: Areas, plan: LayerPlan, groups: Int, narrowest: float) -> Fillings:
    """The sparse areas of all layers, those of several layers together where they agree.

    What all layers of a group have in common is filled on its last layer; what only some of them have is filled layer
    by layer.

    Args:
        sparse: the sparse area of each layer.
        plan: the layers.
        groups: (L,) the first layer of the group of each layer.
        narrowest: mm; common areas narrower than this are left to the layers, and what is left to layers of a group
            and narrower than this stays empty.
    """
    own = np.arange(plan.n_layers)
    if (groups == own).all():
        return Fillings(sparse, own, plan.height, own)
    last = last_layers(groups)
    several = groups < last
    ends = several & (last == own)
    common = window_intersection(sparse, np.where(ends, groups, own), own + 1)
    common = offset_open(common.of_layers(ends), narrowest / 2)
    rest = difference(sparse, common.for_each(last))
    wide = offset_open(rest.of_layers(several), narrowest / 2)
    return Fillings(
        _stacked(rest.of_layers(~several).merge(wide), common),
        np.tile(own, 2),
        np.concatenate([plan.height, plan.top - plan.bottom[groups]]),
        np.tile(_turns(groups), 2),
    )


def groups_of(
    sparse: Areas, plan: LayerPlan, limit: float, groups: Int | None = None, *, begins: Int | None = None
) -> Int:
    """(L,) the first layer of the group that each layer belongs to.

    The layers are divided into groups no higher than `limit`, the same groups over the whole part, so that beads of
    one place are all equally high. Of all divisions the one that saves the most is taken: groups end where skins begin
    and where the outline changes.

    Args:
        sparse: the sparse area of each layer.
        plan: the layers.
        limit: mm, summed height of a group; 0 or less than two layers: no groups.
        groups: (L,) if they are known already; those higher than `limit` are divided into single layers.
        begins: (L,) the lowest layer that each may be together with.
    """
    lowest = tallest_groups(plan, limit)
    lowest = lowest if begins is None else np.maximum(lowest, begins)
    if groups is None:
        return choose_groups(area_savings(sparse, lowest))
    return np.where(groups >= lowest[last_layers(groups)], groups, np.arange(plan.n_layers))


def _turns(groups: Int) -> Int:
    """(L,) which turn it is on each layer: groups are counted, and the layers of one take turns up to its own."""
    own = np.arange(len(groups))
    number = np.cumsum(run_starts(groups)) - 1
    return np.asarray(number + last_layers(groups) - own, np.int64)


def _stacked(one: Areas, another: Areas) -> Areas:
    """Both stacks as one, the second above the first."""
    return Areas(
        np.concatenate([one.xy, another.xy]),
        np.concatenate([one.ring_start, another.ring_start[1:] + len(one.xy)]),
        np.concatenate([one.ring_layer, another.ring_layer + one.n_layers]),
        one.n_layers + another.n_layers,
    )
