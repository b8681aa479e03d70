"""Regions -> Toolpaths. One pattern a file; this table is the whole list."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final

import numpy as np

from printer_slicer import bead
from printer_slicer.geometry import offset
from printer_slicer.infill.grid import grid_lines
from printer_slicer.infill.rectilinear import rectilinear_lines
from printer_slicer.model import Areas, Float, Int, Regions, Role, Toolpaths
from printer_slicer.profile import Profile

__all__ = ["PATTERNS", "Pattern", "infill_paths"]

# (area, spacing (L,) mm, angle (L,) radians, longest turn (L,) mm) -> points (N, 2), size (M,), layer (M,) of polylines
Pattern = Callable[[Areas, Float, Float, Float], tuple[Float, Int, Int]]
PATTERNS: Final[Mapping[str, Pattern]] = {"rectilinear": rectilinear_lines, "grid": grid_lines}

# A turn runs along the boundary, which meets the lines at any angle; past 20° it is longer than three spacings.
_LONGEST_TURN = 3.0


def infill_paths(regions: Regions, profile: Profile) -> Toolpaths:
    """Lines that fill every region: solid ones bead by bead, sparse ones to `quality.infill_density`."""
    quality, plan = profile.quality, regions.plan
    width = profile.extrusion_width
    gap = bead.spacing(width, plan.height)
    angle = np.deg2rad(quality.infill_angle_deg) + np.pi / 2 * (np.arange(plan.n_layers) % 2)
    density = quality.infill_density
    jobs: list[tuple[Role, Areas, Pattern, Float, Float]] = [
        (Role.BRIDGE, regions.bridge, rectilinear_lines, gap, regions.bridge_angle),
        (Role.BOTTOM_SKIN, regions.bottom_skin, rectilinear_lines, gap, angle),
        (Role.SOLID, regions.solid, rectilinear_lines, gap, angle),
        (Role.TOP_SKIN, regions.top_skin, rectilinear_lines, gap, angle),
    ]
    if density > 0:
        jobs.append((Role.SPARSE, regions.sparse, PATTERNS[quality.infill], gap / density, angle))
    parts = []
    overlap = quality.infill_overlap * width if quality.perimeters else 0.0
    for role, region, pattern, spacing, direction in jobs:
        # The centre lines stay half a bead inside; the turns at their ends fill the half bead that is left.
        # Sparse lines have no turns: those would be more plastic than the density says.
        turn = np.zeros_like(gap) if role == Role.SPARSE else _LONGEST_TURN * gap
        xy, size, layer = pattern(offset(region, overlap - gap / 2), spacing, direction, turn)
        n_paths = len(layer)
        parts.append(
            Toolpaths.gathered(
                plan,
                xy=xy,
                size=size,
                layer=layer,
                role=np.full(n_paths, role),
                width=np.full(n_paths, width),
                closed=False,
            )
        )
    return Toolpaths.joined(plan, parts)
