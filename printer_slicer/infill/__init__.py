"""Regions -> Toolpaths. One pattern a file; this table is the whole list."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final

import numpy as np

from printer_slicer import bead
from printer_slicer.geometry import offset
from printer_slicer.infill.grid import grid_lines
from printer_slicer.infill.rectilinear import rectilinear_lines
from printer_slicer.infill.solid import solid_paths
from printer_slicer.model import Areas, Float, Int, LayerPlan, Regions, Role, Toolpaths
from printer_slicer.profile import Profile

__all__ = ["PATTERNS", "Pattern", "infill_paths"]

# (area, spacing (L,) mm, angle (L,) radians, longest turn (L,) mm) -> points (N, 2), size (M,), layer (M,) of polylines
Pattern = Callable[[Areas, Float, Float, Float], tuple[Float, Int, Int]]
PATTERNS: Final[Mapping[str, Pattern]] = {"rectilinear": rectilinear_lines, "grid": grid_lines}


def infill_paths(regions: Regions, profile: Profile) -> Toolpaths:
    """Lines that fill every region: solid ones bead by bead, sparse ones to `quality.infill_density`."""
    quality, plan = profile.quality, regions.plan
    turned = np.deg2rad(quality.infill_angle_deg) + np.pi / 2 * (np.arange(plan.n_layers) % 2)
    parts = solid_paths(regions, profile)
    if quality.infill_density > 0:
        parts.append(_sparse(regions.sparse, plan, turned, profile))
    return Toolpaths.joined(plan, parts)


def _sparse(region: Areas, plan: LayerPlan, angle: Float, profile: Profile) -> Toolpaths:
    """Lines of the pattern, without turns: those would be more plastic than the density says."""
    quality, width = profile.quality, profile.extrusion_width
    gap = bead.spacing(width, plan.height)
    overlap = quality.sparse_overlap * width if quality.perimeters else 0.0
    pattern = PATTERNS[quality.infill]
    area = offset(region, overlap - gap / 2)
    xy, size, layer = pattern(area, gap / quality.infill_density, angle, np.zeros_like(gap))
    # Between walls that nearly touch, lines shrink to dots that carry nothing and cost a stop each.
    ends = xy.reshape(-1, 2, 2)
    carries = np.hypot(*(ends[:, 1] - ends[:, 0]).T) >= width
    lines = ends[carries].reshape(-1, 2), size[carries], layer[carries]
    return _paths(plan, lines, Role.SPARSE, np.full(plan.n_layers, width))


def _paths(plan: LayerPlan, lines: tuple[Float, Int, Int], role: Role, width: Float) -> Toolpaths:
    xy, size, layer = lines
    roles = np.full(len(layer), role)
    return Toolpaths.gathered(
        plan, xy=xy, size=size, layer=layer, role=roles, width=width[layer], closed=False
    )
