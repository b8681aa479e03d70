"""Regions -> Toolpaths. One pattern a file; this table is the whole list."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final

import numpy as np

from printer_slicer import bead
from printer_slicer.geometry import offset
from printer_slicer.infill.grid import grid_lines
from printer_slicer.infill.rectilinear import rectilinear_lines
from printer_slicer.model import Areas, Float, Int, LayerPlan, Regions, Role, Toolpaths
from printer_slicer.profile import Profile

__all__ = ["PATTERNS", "Pattern", "infill_paths"]

# (area, spacing (L,) mm, angle (L,) radians, longest turn (L,) mm) -> points (N, 2), size (M,), layer (M,) of polylines
Pattern = Callable[[Areas, Float, Float, Float], tuple[Float, Int, Int]]
PATTERNS: Final[Mapping[str, Pattern]] = {"rectilinear": rectilinear_lines, "grid": grid_lines}

# A turn runs along the boundary, which meets the lines at any angle; past 20° it is longer than three spacings.
_LONGEST_TURN = 3.0
_NARROWEST, _WIDEST = 0.7, 1.5  # spacing of solid beads as a share of the usual one
_HAIR = 2e-4  # mm; more than the geometry's rounding


def infill_paths(regions: Regions, profile: Profile) -> Toolpaths:
    """Lines that fill every region: solid ones bead by bead, sparse ones to `quality.infill_density`."""
    quality, plan = profile.quality, regions.plan
    turned = np.deg2rad(quality.infill_angle_deg) + np.pi / 2 * (np.arange(plan.n_layers) % 2)
    parts = [
        _solid(regions.bridge, Role.BRIDGE, plan, regions.bridge_angle, profile),
        _solid(regions.bottom_skin, Role.BOTTOM_SKIN, plan, turned, profile),
        _solid(regions.solid, Role.SOLID, plan, turned, profile),
        _solid(regions.top_skin, Role.TOP_SKIN, plan, turned, profile),
    ]
    if quality.infill_density > 0:
        parts.append(_sparse(regions.sparse, plan, turned, profile))
    return Toolpaths.joined(plan, parts)


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
    lines = rectilinear_lines(area, step, angle, _LONGEST_TURN * gap, phase=first / step)
    return _paths(plan, lines, role, width)


def _sparse(region: Areas, plan: LayerPlan, angle: Float, profile: Profile) -> Toolpaths:
    """Lines of the pattern, without turns: those would be more plastic than the density says."""
    quality = profile.quality
    width = bead.layer_widths(plan.n_layers, profile.width_of_first_layer, profile.extrusion_width)
    gap = bead.spacing(width, plan.height)
    overlap = (quality.sparse_overlap if quality.perimeters else 0.0) * width
    pattern = PATTERNS[quality.infill]
    area = offset(region, overlap - gap / 2)
    xy, size, layer = pattern(area, gap / quality.infill_density, angle, np.zeros_like(gap))
    # Between walls that nearly touch, lines shrink to dots that carry nothing and cost a stop each.
    ends = xy.reshape(-1, 2, 2)
    carries = np.hypot(*(ends[:, 1] - ends[:, 0]).T) >= width[layer]
    lines = ends[carries].reshape(-1, 2), size[carries], layer[carries]
    return _paths(plan, lines, Role.SPARSE, width)


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


def _paths(plan: LayerPlan, lines: tuple[Float, Int, Int], role: Role, width: Float) -> Toolpaths:
    xy, size, layer = lines
    roles = np.full(len(layer), role)
    return Toolpaths.gathered(
        plan, xy=xy, size=size, layer=layer, role=roles, width=width[layer], closed=False
    )
