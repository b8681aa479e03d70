"""Which thin layers are filled together: groups of them, the same over the whole part.

Beads of one place are then all equally high, and what is printed thick in one layer holds on to what is printed thick
beside it.
"""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Float, Int
from printer_slicer.geometry import Areas, window_intersection
from printer_slicer.model import LayerPlan

__all__ = ["area_savings", "choose_groups", "last_layers", "tallest_groups"]

_ROUNDING = 1e-6  # mm
_CUT = 0.05  # of the lines in what is left to single layers: the price of filling a layer's area in two parts


def tallest_groups(plan: LayerPlan, limit: float) -> Int:
    """(L,) the first layer of the highest group that ends with each layer.

    Args:
        plan: the layers; the first one holds on to the bed by itself.
        limit: mm, summed height of a group.
    """
    own = np.arange(plan.n_layers)
    lowest = np.searchsorted(plan.bottom, plan.top - limit - _ROUNDING)
    return np.asarray(np.minimum(np.clip(lowest, 1, np.maximum(own, 1)), own), np.int64)


def area_savings(areas: Areas, lowest: Int) -> Float:
    """(n, L) mm² by which filling `extra` (row) layers and the one after them (column) together shortens the filling.

    A group of n layers saves n - 1 times the lines in what they have in common, less a little for the lines that it
    cuts in two. `lowest` is where the highest groups begin; what reaches farther down saves nothing.
    """
    n, own = areas.n_layers, np.arange(areas.n_layers)
    saved, so_far = np.zeros((_most(lowest), n)), np.append(0.0, np.cumsum(areas.area()))
    for extra in range(1, len(saved)):
        fits = own - extra >= lowest
        common = window_intersection(areas, np.where(fits, own - extra, own), own + 1)
        shared = common.area()
        left = so_far[own + 1] - so_far[np.maximum(own - extra, 0)] - (extra + 1) * shared
        saved[extra] = np.where(fits, extra * shared - _CUT * left, 0.0)
    return saved


def last_layers(groups: Int) -> Int:
    """(L,) the last layer of the group of each layer; `groups` (L,) holds the first ones."""
    return np.asarray(np.searchsorted(groups, groups, side="right") - 1, np.int64)


def _most(lowest: Int) -> int:
    """How many layers a group has at most."""
    return int(np.max(np.arange(len(lowest)) - lowest, initial=0)) + 1


def choose_groups(saved: Float) -> Int:
    """(L,) the first layer of the group that each layer belongs to, where all groups together save the most.

    Args:
        saved: (n, L) what a group of so many layers (row, from one on) that ends with each layer (column) saves.
    """
    most, n = saved.shape
    best, size = [0.0], list[int]()
    for layer in range(n):
        options = [best[layer - extra] + float(saved[extra, layer]) for extra in range(min(most, layer + 1))]
        # Of equals the thinner one: ties are layers without anything to fill together.
        size.append(int(np.argmax(options)))
        best.append(options[size[-1]])
    first, layer = np.arange(n), n - 1
    while layer >= 0:
        first[layer - size[layer] : layer + 1] = layer - size[layer]
        layer -= size[layer] + 1
    return first
