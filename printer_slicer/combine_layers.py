"""Group thin layers whose interior is printed together in one thick layer.

The groups are the same over the whole part. So thick extrusions that lie side by side have the same height and bond.
"""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Float, Int
from printer_slicer.geometry import Areas, window_intersection
from printer_slicer.model import LayerPlan

__all__ = ["choose_groups", "compute_area_savings", "find_last_layers", "find_tallest_groups"]

_ROUNDING = 1e-6  # mm
_CUT = 0.05  # cost of filling the rest of a layer separately, as a fraction of its lines


def find_tallest_groups(plan: LayerPlan, limit: float) -> Int:
    """Return for each layer the first layer (L,) of the tallest group that may end with that layer.

    Args:
        plan: the layers; the first one is always a group of its own.
        limit: maximum total height of a group, mm.
    """
    own = np.arange(plan.n_layers)
    lowest = np.searchsorted(plan.bottom, plan.top - limit - _ROUNDING)
    return np.asarray(np.minimum(np.clip(lowest, 1, np.maximum(own, 1)), own), np.int64)


def compute_area_savings(areas: Areas, lowest: Int) -> Float:
    """Return the infill area (n, L), mm², saved by combining each layer (column) with the n layers (row n) below it.

    A group of n layers saves n - 1 times the area that all of them share, less a small cost for the lines that the
    remaining areas cut in two. Groups that start below `lowest` (L,) save nothing.
    """
    n, own = areas.n_layers, np.arange(areas.n_layers)
    saved, so_far = np.zeros((_find_largest_group(lowest), n)), np.append(0.0, np.cumsum(areas.area()))
    for extra in range(1, len(saved)):
        fits = own - extra >= lowest
        common = window_intersection(areas, np.where(fits, own - extra, own), own + 1)
        shared = common.area()
        left = so_far[own + 1] - so_far[np.maximum(own - extra, 0)] - (extra + 1) * shared
        saved[extra] = np.where(fits, extra * shared - _CUT * left, 0.0)
    return saved


def find_last_layers(groups: Int) -> Int:
    """Return the last layer (L,) of each layer's group; `groups` (L,) holds the first layers."""
    return np.asarray(np.searchsorted(groups, groups, side="right") - 1, np.int64)


def _find_largest_group(lowest: Int) -> int:
    """Return the maximum number of layers of a group."""
    return int(np.max(np.arange(len(lowest)) - lowest, initial=0)) + 1


def choose_groups(saved: Float) -> Int:
    """Return the first layer (L,) of each layer's group, for the grouping that saves the most in total.

    Args:
        saved: (n, L) saving of the group that consists of a layer (column) and the n layers (row n) below it.
    """
    most, n = saved.shape
    best, size = [0.0], list[int]()
    for layer in range(n):
        options = [best[layer - extra] + float(saved[extra, layer]) for extra in range(min(most, layer + 1))]
        # On ties take the smaller group: such layers have no area to combine.
        size.append(int(np.argmax(options)))
        best.append(options[size[-1]])
    first, layer = np.arange(n), n - 1
    while layer >= 0:
        first[layer - size[layer] : layer + 1] = layer - size[layer]
        layer -= size[layer] + 1
    return first
