"""Areas that supports must leave free, because the part is beside, just above or just below."""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Float, Int, consecutive, distinct
from printer_slicer.geometry import normalize, offset, union
from printer_slicer.model import Areas, LayerPlan, Sections, SupportPlan

__all__ = ["find_blocked_areas", "find_gaps_above"]

_ROUNDING = 1e-6  # mm


def find_blocked_areas(
    sections: Sections, layers: LayerPlan, xy_gap: float, z_gaps: tuple[float, float | Float], near_gap: float
) -> Areas:
    """Return the areas of each support layer that supports must leave free.

    Args:
        sections: the part.
        layers: the layers of supports.
        xy_gap: distance from layers of the part that overlap the support layer in z, mm.
        z_gaps: (below, above) distance in z to the part, mm; the latter may be one for each support layer (S,).
        near_gap: distance sideways from layers of the part that are nearer than the gaps in z, mm.
    """
    beside = _find_ranges(sections, layers, (0.0, 0.0))
    near = _find_ranges(sections, layers, z_gaps)
    own = sections.solid.find_first_equal_layers()
    chosen, entry = _find_different_entries(own, beside, near)
    areas = offset(_unite_ranges(sections.solid, own, beside[chosen]), xy_gap)
    if any(map(np.any, z_gaps)):
        areas = union(areas, offset(_unite_ranges(sections.solid, own, near[chosen]), near_gap))
    return areas.copy_layers(entry)


def find_gaps_above(plan: SupportPlan, gap: float) -> Float:
    """Return the distance (S,) of each support layer to the part above; it is less only where there is no room."""
    gaps = np.full(plan.layers.n_layers, gap)
    carried = np.flatnonzero(plan.carrier >= 0)
    np.minimum.at(gaps, plan.carrier[carried], plan.gap[carried])
    return gaps


def _find_ranges(sections: Sections, layers: LayerPlan, z_gaps: tuple[float, float | Float]) -> Int:
    """Return the range (S, 2) of part layers that come within the gaps of each support layer."""
    plan, (below, above) = sections.plan, z_gaps
    first = np.searchsorted(plan.top, layers.bottom - below + _ROUNDING, side="right")
    last = np.searchsorted(plan.bottom, layers.top + above - _ROUNDING)
    return np.stack([first, np.maximum(last, first)], axis=1).astype(np.int64)


def _find_different_entries(own: Int, beside: Int, near: Int) -> tuple[Int, Int]:
    """Return support layers (E,) of which no two have the same part layers, and the entry (S,) for each layer.

    `own` (L,) is the first part layer with the same section.
    """
    seen, chosen, entry = dict[tuple[bytes, bytes], int](), list[int](), list[int]()
    for layer, ranges in enumerate(np.concatenate([beside, near], axis=1).tolist()):
        key = distinct(own[ranges[0] : ranges[1]]).tobytes(), distinct(own[ranges[2] : ranges[3]]).tobytes()
        if key not in seen:
            seen[key] = len(chosen)
            chosen.append(layer)
        entry.append(seen[key])
    return np.array(chosen, np.int64), np.array(entry, np.int64)


def _unite_ranges(solid: Areas, own: Int, ranges: Int) -> Areas:
    """Return the union of the sections in each range (E, 2) of layers."""
    n_layers = len(ranges)
    entry = np.repeat(np.arange(n_layers), ranges[:, 1] - ranges[:, 0])
    source = own[consecutive(ranges[:, 0], ranges[:, 1] - ranges[:, 0])]
    pair = distinct(entry * max(solid.n_layers, 1) + source)  # equal sections are taken once
    entry, source = np.divmod(pair, max(solid.n_layers, 1))
    copies = solid.copy_layers(source)
    return normalize(Areas(copies.xy, copies.ring_start, entry[copies.ring_layer], n_layers))
