"""Find what other supports leave without support, so that it can get supports of its own."""

from __future__ import annotations

from typing import Final

import numpy as np

from printer_slicer.arrays import Int
from printer_slicer.geometry import Areas, intersection, normalize
from printer_slicer.model import Overhangs, Toolpaths
from printer_slicer.profile import Profile
from printer_slicer.supports.branches import draw_discs
from printer_slicer.supports.patches import join_patches
from printer_slicer.supports.slopes import compute_steps
from printer_slicer.supports.unsupported_places import UnsupportedPoints, find_unsupported_groups
from printer_slicer.values import replace

__all__ = ["find_remaining_overhangs"]

_LEAST: Final = 1.0  # mm² of a place; smaller ones stay as they are
_BESIDE: Final = (
    0.6  # mm around a place up to which the overhang counts, so that there is room for extrusions
)


def find_remaining_overhangs(overhangs: Overhangs, paths: Toolpaths, profile: Profile) -> Overhangs:
    """Return the overhangs around places that have no bead near them, and islands without one.

    Args:
        overhangs: areas that need supports.
        paths: the beads of supports, on their layers.
        profile: gaps of supports, and the smallest patches.
    """
    groups = find_unsupported_groups(overhangs, paths, profile, with_islands=True)
    large = [one for one in groups if one.island.any() or one.area.sum() >= _LEAST]
    near = _draw_places(large, overhangs.plan.n_layers)
    area, islands = intersection(overhangs.area, near), intersection(overhangs.islands, near)
    step = compute_steps(overhangs.plan, profile.quality.support_threshold_deg)
    kept, patch = join_patches(area, area, Areas.empty(area.n_layers), step, profile.quality)
    return replace(overhangs, area=kept, ring_patch=patch, islands=islands)


def _draw_places(groups: list[UnsupportedPoints], n_layers: int) -> Areas:
    """Return the areas around the points of places, by layer."""
    if not groups:
        return Areas.empty(n_layers)
    xy = np.concatenate([one.xy for one in groups])
    layer: Int = np.concatenate([one.layer for one in groups])
    order = np.argsort(layer, kind="stable")
    return normalize(draw_discs(xy[order], np.full(len(order), _BESIDE), layer[order], n_layers))
