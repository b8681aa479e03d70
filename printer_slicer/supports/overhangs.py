"""Find overhangs: slopes flatter than the threshold, islands and tails, except areas under bridges."""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Bool, Int
from printer_slicer.geometry import Areas, difference, intersection, offset_open, union
from printer_slicer.model import Overhangs, Regions, Sections
from printer_slicer.profile import Profile
from printer_slicer.supports.slopes import compute_steps, find_strips, grow_by_step

__all__ = ["find_overhangs", "mark_flat_layers"]

_SLIVER = 0.02  # mm, width of strips that are left out
_FLAT = 0.2  # share of a patch in one layer, if the patch is not a slope


def find_overhangs(sections: Sections, regions: Regions, profile: Profile) -> Overhangs:
    """Find the areas of each layer that need supports, whether or not the profile has supports.

    Left out are areas that bridge lines and perimeters carry from support to support, and patches that are smaller than
    the profile allows, except islands and tails.

    Args:
        sections: the solid area of each layer.
        regions: the bridges, and the directions of their lines.
        profile: threshold angle, maximum length of bridges, and smallest patches.
    """
    plan, quality, solid = sections.plan, profile.quality, sections.solid
    below = solid.shift_layers(1)
    step = compute_steps(plan, quality.support_threshold_deg)
    around = grow_by_step(below, step)
    steep = difference(solid.of_layers(np.arange(1, plan.n_layers)), around)
    air = difference(solid.of_layers(steep.used), below)
    if not air.n_rings:
        return Overhangs(plan, air, np.zeros(0, np.int64), air, air, np.zeros(plan.n_layers, np.bool_))
    from printer_slicer.supports.bridged_areas import find_bridged_areas  # noqa: PLC0415 - many parts have no overhangs
    from printer_slicer.supports.islands import find_islands  # noqa: PLC0415
    from printer_slicer.supports.patches import drop_small_groups, find_far_pieces, join_patches  # noqa: PLC0415

    islands = find_islands(solid, below, air, around, profile.extrusion_width)
    hanging = union(find_strips(air, steep, step), islands)
    required = union(islands, find_far_pieces(hanging, below, quality))
    hanging = offset_open(drop_small_groups(hanging, required, step, quality), _SLIVER / 2)
    cover = find_bridged_areas(hanging, below, solid, regions, profile)
    left = union(difference(hanging, cover), islands)
    required = union(islands, find_far_pieces(left, below, quality))
    area, patch = join_patches(left, required, cover, step, quality)
    return Overhangs(plan, area, patch, islands, intersection(hanging, cover), mark_flat_layers(area, patch))


def mark_flat_layers(area: Areas, ring_patch: Int) -> Bool:
    """Return a mask (L,) of the layers that contain more than a fifth of a patch."""
    size, n_layers = area.ring_area(), area.n_layers
    whole = np.bincount(ring_patch, size)
    keys, entry = np.unique(ring_patch * n_layers + area.ring_layer, return_inverse=True)
    flat = np.zeros(n_layers, np.bool_)
    flat[(keys % n_layers)[np.bincount(entry, size) > _FLAT * whole[keys // n_layers]]] = True
    return flat
