"""Areas that supports must leave free, because the part is beside, just above or just below."""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Float, Int, consecutive, distinct
from printer_slicer.geometry import difference, intersection, normalize, offset, union
from printer_slicer.model import Areas, LayerPlan, Sections, SupportPlan

__all__ = ["find_blocked_areas", "find_gaps_above"]

_ROUNDING = 1e-6  # mm
_MIN_ANGLE_DEG = 20.0  # degrees; on gentler upward slopes, beads have the part below them anyway
_TREAD_GAP = 0.5  # of the gap above the part, the least above treads


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
    below, above = z_gaps
    solid, core = sections.solid, _drop_treads(sections, float(layers.top[-1]))
    own, own_core = solid.find_first_equal_layers(), core.find_first_equal_layers()
    beside = _find_ranges(sections, layers, (0.0, 0.0))
    near = _find_ranges(sections, layers, (_TREAD_GAP * below, above))
    under = _find_ranges(sections, layers, (below, 0.0))
    chosen, entry = _find_different_entries((own_core, beside), (own, near), (own_core, under))
    areas = offset(_unite_ranges(core, own_core, beside[chosen]), xy_gap)
    if any(map(np.any, z_gaps)):
        found = _unite_ranges(solid, own, near[chosen]).merge(_unite_ranges(core, own_core, under[chosen]))
        areas = union(areas, offset(normalize(found), near_gap))
    return areas.copy_layers(entry)


def _drop_treads(sections: Sections, highest: float) -> Areas:
    """Return the sections up to a height, mm, without the treads of upward slopes: strips beside the section above.

    Supports stand on slopes only if they come near them, because a bead needs the part below half of its width.
    """
    solid, plan = sections.solid, sections.plan
    own = solid.find_first_equal_layers()
    differs = np.append(own[1:] != own[:-1], False) & (plan.bottom < highest)
    lower, upper = solid.of_layers(differs), solid.shift_layers(-1).of_layers(differs)
    outside = difference(lower, upper)
    if not outside.n_rings:
        return solid
    widest = np.diff(plan.cut, append=plan.cut[-1]) / np.tan(np.deg2rad(_MIN_ANGLE_DEG))
    treads = intersection(outside, offset(upper.of_layers(outside.used), widest))
    return difference(lower, treads).merge(solid.of_layers(~differs))


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


def _find_different_entries(*cases: tuple[Int, Int]) -> tuple[Int, Int]:
    """Return support layers (E,) of which no two have the same part layers, and the entry (S,) for each layer.

    Args:
        cases: the first part layer (L,) with the same section, and ranges (S, 2) of part layers, of each stack.
    """
    seen, chosen, entry = dict[tuple[bytes, ...], int](), list[int](), list[int]()
    for layer in range(len(cases[0][1])):
        key = tuple(distinct(own[slice(*ranges[layer].tolist())]).tobytes() for own, ranges in cases)
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
