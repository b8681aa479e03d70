"""Sections -> Toolpaths: skirt and brim around the first layer."""

from __future__ import annotations

import numpy as np

from printer_slicer import bead
from printer_slicer.errors import PartError
from printer_slicer.geometry import offset
from printer_slicer.model import Areas, Role, Sections, Toolpaths
from printer_slicer.profile import Profile

__all__ = ["adhesion_paths"]


def adhesion_paths(sections: Sections, profile: Profile) -> Toolpaths:
    """Skirt loops around the first layer, then brim loops from the outside to the part; none if not asked for.

    Skirt loops that would leave the bed are left out.

    Raises:
        PartError: the brim leaves the bed.
    """
    quality, plan = profile.quality, sections.plan
    width = profile.extrusion_width
    gap = float(bead.spacing(width, float(plan.height[0])))
    first = _outlines(sections.solid.select(sections.solid.ring_layer == 0))
    n_brim = int(np.ceil(quality.brim_width / gap - 1e-6))
    brim = [_outlines(offset(first, width / 2 + i * gap, join="round")) for i in range(n_brim)]
    reach = n_brim * gap + quality.skirt_distance + width / 2
    skirt = [_outlines(offset(first, reach + i * gap, join="round")) for i in range(quality.skirt_loops)]
    skirt = [loop for loop in skirt if _on_bed(loop, profile, width)]
    if brim and not _on_bed(brim[-1], profile, width):
        raise PartError(
            f"a brim of {quality.brim_width:g} mm around the part leaves the bed of {profile.printer.name!r}",
            remedy="lower quality.brim_width",
        )
    loops = [*skirt[::-1], *brim[::-1]]
    roles = [Role.SKIRT] * len(skirt) + [Role.BRIM] * len(brim)
    counts = [loop.n_rings for loop in loops]
    return Toolpaths.gathered(
        plan,
        xy=np.concatenate([np.zeros((0, 2)), *(loop.xy for loop in loops)]),
        size=np.concatenate([np.zeros(0, np.int64), *(np.diff(loop.ring_start) for loop in loops)]),
        layer=np.zeros(sum(counts), np.int64),
        role=np.repeat(np.array(roles, np.int64), counts),
        width=np.full(sum(counts), width),
        closed=True,
    )


def _on_bed(loop: Areas, profile: Profile, width: float) -> bool:
    """Whether beads along these rings lie on the bed with their whole width."""
    low, high = profile.printer.corners
    inside = (loop.xy >= np.add(low, width / 2)) & (loop.xy <= np.subtract(high, width / 2))
    return bool(inside.all())


def _outlines(areas: Areas) -> Areas:
    """Only the outer rings: nothing is laid inside holes."""
    return areas.select(areas.ring_area() > 0)
