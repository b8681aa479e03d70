"""Make the skirt: loops around all objects, on the first layer or, as a draft shield, on many layers."""

from __future__ import annotations

import numpy as np

from printer_slicer import bead
from printer_slicer.adhesion.loops import is_on_bed, loop_paths
from printer_slicer.arrays import Float, Int
from printer_slicer.geometry import convex_hull, offset, simplify
from printer_slicer.model import Areas, Sections, Toolpaths
from printer_slicer.profile import Profile
from printer_slicer.roles import Role
from printer_slicer.values import replace

__all__ = ["skirt_paths"]


def skirt_paths(sections: Sections, brim: Toolpaths, profile: Profile) -> Toolpaths:
    """Return loops around the convex hull of all objects, from the outside inward; skip loops that leave the bed.

    A skirt of one layer surrounds that layer and the brim. A draft shield surrounds the sections of all layers, even
    above its own height, so that no part of an object is closer to it than the skirt distance.

    Args:
        sections: of all objects, on the printed layers.
        brim: of the first layer.
        profile: loops, distance, height and length of the skirt.
    """
    quality, plan = profile.quality, sections.plan
    tall = _count_layers(plan.bottom, quality.skirt_height)
    # The hull of a twisted part has thousands of corners; each would be a move on every layer.
    coarse = quality.resolution / 2 if tall > 1 else 0.0
    hull = _make_hull(sections.solid, brim, first_only=tall == 1) if quality.skirt_loops else Areas.empty(1)
    if not hull.n_rings:
        return loop_paths(plan, [], np.zeros(0, np.int64), Role.SKIRT, 0.0)
    hull = simplify(hull, coarse)
    usual = bead.layer_widths(tall, profile.width_on_bed, profile.extrusion_width)
    # The first layer over the gap of a raft is higher than others, up to the highest extrusion of the nozzle.
    high = np.minimum(plan.height[:tall], profile.highest_bead)
    width = np.maximum(usual, high)
    (heights, wide), variant_of_layer = np.unique(np.stack([high, width]), axis=1, return_inverse=True)
    stack = hull.take(np.zeros(len(heights), np.int64))
    stack = Areas(stack.xy, stack.ring_start, np.arange(len(heights)), len(heights))
    loops: list[Areas] = []
    wanted = max(quality.skirt_loops, _count_loops_for_length(hull, sections, profile))
    for i in range(wanted):
        reach = coarse + quality.skirt_distance + wide / 2 + i * bead.spacing(wide, heights)
        loop = offset(stack, reach, join="round")
        if not is_on_bed(list(map(loop.ring, range(loop.n_rings))), profile, float(wide.max())):
            break
        loops.append(loop)
    lines, layer = _list_loops(loops, variant_of_layer.ravel(), quality.skirt_loops)
    return replace(loop_paths(plan, lines, layer, Role.SKIRT, width[layer]), height=high[layer])


def _count_layers(bottom: Float, height: float) -> int:
    """Return the number of layers of the skirt: all that begin below its height, at least one."""
    return max(int(np.searchsorted(bottom, height - 1e-6)), 1)


def _make_hull(solid: Areas, brim: Toolpaths, *, first_only: bool) -> Areas:
    """Return the convex hull of the sections and the brim."""
    xy = solid.select(solid.ring_layer == 0).xy if first_only else solid.xy
    beads = offset(convex_hull(brim.xy), float(brim.width.max(initial=0.0)) / 2, join="round")
    return convex_hull(np.concatenate([xy, beads.xy]))


def _count_loops_for_length(hull: Areas, sections: Sections, profile: Profile) -> int:
    """Return the number of loops on the first layer that use `skirt_min_length` of filament, limited by the bed."""
    quality, printer, height = profile.quality, profile.printer, float(sections.plan.height[0])
    width = max(profile.width_on_bed, height)
    gap = float(bead.spacing(width, height))
    most = int(max(printer.bed_x, printer.bed_y) / gap) + 1
    out = quality.skirt_distance + width / 2 + gap * np.arange(most)
    # Each mm outward adds 2π mm to the length around a convex area.
    length = hull.ring_length().sum() + 2 * np.pi * out
    per_mm = bead.filament_per_mm(width, height, profile.material.filament_diameter)
    fed = np.cumsum(length * per_mm * profile.material.flow_ratio * quality.first_layer_flow)
    return (
        int(np.searchsorted(fed, quality.skirt_min_length * (1 - 1e-4))) + 1
        if quality.skirt_min_length
        else 0
    )


def _list_loops(loops: list[Areas], variant_of_layer: Int, n_loops: int) -> tuple[list[Float], Int]:
    """List the loops of each layer from the outside inward: all loops on the first layer, `n_loops` on later layers."""
    lines: list[Float] = []
    layer: list[int] = []
    for k, variant in enumerate(variant_of_layer.tolist()):
        some = loops if k == 0 else loops[:n_loops]
        lines += [loop.ring(variant) for loop in reversed(some)]
        layer += [k] * len(some)
    return lines, np.array(layer, np.int64)
