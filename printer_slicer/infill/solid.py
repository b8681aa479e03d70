"""Solid regions: beads side by side."""

from __future__ import annotations

import numpy as np

from printer_slicer import bead
from printer_slicer.geometry import Areas, Float, chain_rows, hatch, offset
from printer_slicer.model import LayerPlan, Regions, Role, Toolpaths
from printer_slicer.profile import Profile

__all__ = ["solid_paths"]

# A turn runs along the boundary, which meets the lines at any angle; past 20° it is longer than three spacings.
_LONGEST_TURN = 3.0
_NARROWEST, _WIDEST = 0.7, 1.5  # spacing of beads as a share of the usual one
_HAIR = 2e-4  # mm; more than the geometry's rounding


def solid_paths(regions: Regions, profile: Profile) -> list[Toolpaths]:
    """Lines that fill bridges, skins and what is solid below them; the direction turns by 90° from layer to layer."""
    plan = regions.plan
    turned = np.deg2rad(profile.quality.infill_angle_deg) + np.pi / 2 * (np.arange(plan.n_layers) % 2)
    return [
        _solid(regions.bridge, Role.BRIDGE, plan, regions.bridge_angle, profile),
        _solid(regions.bottom_skin, Role.BOTTOM_SKIN, plan, turned, profile),
        _solid(regions.solid, Role.SOLID, plan, turned, profile),
        _solid(regions.top_skin, Role.TOP_SKIN, plan, turned, profile),
    ]


def _solid(region: Areas, role: Role, plan: LayerPlan, angle: Float, profile: Profile) -> Toolpaths:
    """Beads side by side, a little wider or narrower than usual so that a whole number of them fills the layer."""
    wide = bead.layer_widths(plan.n_layers, profile.width_of_first_layer, profile.extrusion_width)
    overlap = (profile.quality.infill_overlap if profile.quality.perimeters else 0.0) * wide
    usual = bead.spacing(wide, plan.height)
    low, high = _across(region, angle)
    low, high = low - overlap, high + overlap
    count = np.maximum(np.rint((high - low) / usual), 1)
    fitting = np.clip((high - low) / count, _NARROWEST * usual, _WIDEST * usual)
    width = np.round(bead.width_for_spacing(fitting, plan.height), 4)  # what the file will say
    gap = bead.spacing(width, plan.height)
    # The centre lines stay half a bead inside; the turns at their ends fill the half bead that is left. The outermost
    # rows would lie on the border: a hair inside they are certain to be found.
    area = offset(region, overlap - gap / 2)
    first = np.where(count > 1, low + gap / 2 + _HAIR, (low + high) / 2)
    step = np.where(count > 1, (high - low - gap - 2 * _HAIR) / np.maximum(count - 1, 1), gap)
    rows = hatch(area, angle=angle, spacing=step, phase=first / step)
    xy, start, layer = chain_rows(rows, max_turn=_LONGEST_TURN * gap)
    roles = np.full(len(layer), role)
    return Toolpaths.gathered(
        plan, xy=xy, size=np.diff(start), layer=layer, role=roles, width=width[layer], closed=False
    )


def _across(region: Areas, angle: Float) -> tuple[Float, Float]:
    """(L,) from where to where each layer's region reaches across lines of this direction; 0 where it is empty."""
    low, high = np.zeros(region.n_layers), np.zeros(region.n_layers)
    if region.n_rings:
        layers, rings = np.unique(region.ring_layer, return_index=True)
        turn = np.repeat(angle[region.ring_layer], np.diff(region.ring_start))
        across = region.xy[:, 1] * np.cos(turn) - region.xy[:, 0] * np.sin(turn)
        low[layers] = np.minimum.reduceat(across, region.ring_start[rings])
        high[layers] = np.maximum.reduceat(across, region.ring_start[rings])
    return low, high
