"""The raft: a platform under the part, with air between them so that they come apart.

Everything from the plan to the infill is made as if the part stood on the bed. Then it is lifted: the raft's layers
come before the part's, whose tops lie higher by the raft and the air. Paths keep the height of their beads, so the
part's first layer is laid over the air as high as it would have been on the bed.
"""

from __future__ import annotations

from dataclasses import replace
from math import ceil, floor

import numpy as np

from printer_slicer import bead
from printer_slicer.adhesion.loops import on_bed, paths_of
from printer_slicer.arrays import Float
from printer_slicer.errors import PartError, PlanError
from printer_slicer.geometry import chain_rows, hatch, offset
from printer_slicer.model import Areas, Sections, Toolpaths
from printer_slicer.profile import Profile
from printer_slicer.roles import Role

__all__ = ["on_raft", "raft_heights", "raft_paths"]

_BASE_WIDTH = 2.0  # nozzle diameters: wide beads hold on to the bed
_BASE_HEIGHT = 0.8  # nozzle diameters: thick ones even it out
_INTERFACE_HEIGHT = 0.5  # nozzle diameters: thin ones make a smooth floor
_LONGEST_TURN = 3.0  # rows
_OVERLAP = 0.1  # of a bead that lines reach into the loop around them
_SLACK = 1e-6  # mm


def on_raft(sections: Sections, profile: Profile) -> Sections:
    """All that is printed, layer by layer as the nozzle sees it: the raft's areas, then the sections of the part.

    Without a raft these are the sections themselves. The raft covers the part's first section and `raft_margin` around
    it; bays and holes less than two margins wide are filled.

    Raises:
        PlanError: the raft's height cannot be divided into layers.
        PartError: part and raft are higher than the printer, leave the bed, or the part does not begin on the bed.
    """
    quality, printer, plan = profile.quality, profile.printer, sections.plan
    if not quality.raft_height:
        return sections
    heights = raft_heights(profile)
    lifted = quality.raft_height + quality.raft_gap
    top = np.round(np.concatenate([np.cumsum(heights), plan.top + lifted]), 9)
    cut = np.concatenate([np.cumsum(heights) - heights / 2, plan.cut + lifted])
    if top[-1] > printer.bed_z + _SLACK:
        raise PartError(
            f"on its raft the part reaches up to z {top[-1]:.5g} mm, but {printer.name!r} prints up to "
            f"{printer.bed_z:g} mm",
            remedy="lower quality.raft_height, or print without a raft: quality.raft_height=0",
        )
    first = sections.solid.select(sections.solid.ring_layer == 0)
    if not first.n_rings:
        raise PartError(
            "a raft has nothing to carry: no section of the part is in its first layer",
            remedy="leave out --no-drop, or print without a raft: quality.raft_height=0",
        )
    area = _under(first, quality.raft_margin)
    if not on_bed(area.xy, profile, 0.0):
        raise PartError(
            f"a raft {quality.raft_margin:g} mm wider than the part leaves the bed of {printer.name!r}",
            remedy="lower quality.raft_margin",
        )
    solid = _stacked(area, sections.solid, len(heights))
    base = np.concatenate([np.cumsum(heights) - heights, plan.base + lifted]) if len(plan.base) else plan.base
    return replace(sections, plan=replace(plan, top=top, cut=cut, base=base), solid=solid)


def _under(first: Areas, margin: float) -> Areas:
    """The area of the raft under the first layer's, as a stack of one layer."""
    one = Areas(first.xy, first.ring_start, first.ring_layer, 1)
    return offset(offset(one, 2 * margin, join="round"), -margin, join="round")


def _stacked(area: Areas, solid: Areas, n_below: int) -> Areas:
    """The same area on the lowest layers, and a stack over them."""
    rings = np.tile(np.arange(area.n_rings), n_below)
    below = area.take(rings)
    return Areas(
        np.concatenate([below.xy, solid.xy]),
        np.concatenate([below.ring_start, solid.ring_start[1:] + len(below.xy)]),
        np.concatenate([np.repeat(np.arange(n_below), area.n_rings), solid.ring_layer + n_below]),
        n_below + solid.n_layers,
    )


def raft_heights(profile: Profile) -> Float:
    """(B,) layer heights of the raft, mm: a thick base, then interface layers that are about equally thin.

    All are within the printer's limits and whole z steps, and come to `raft_height`.

    Raises:
        PlanError: there are no such heights.
    """
    printer, step = profile.printer, profile.printer.z_step
    total = round(profile.quality.raft_height / step)
    thinnest, thickest = ceil(printer.min_layer / step - _SLACK), floor(printer.max_layer / step + _SLACK)
    wanted = _INTERFACE_HEIGHT * printer.nozzle_diameter / step
    highest = max(min(thickest, floor(_BASE_HEIGHT * printer.nozzle_diameter / step + _SLACK)), thinnest)
    for base in range(min(highest, total - thinnest), thinnest - 1, -1):
        rest = total - base
        fewest, most = ceil(rest / thickest), rest // thinnest
        if fewest <= most:
            count = min(max(round(rest / wanted), fewest, 1), most)
            more = np.arange(count) < rest % count
            return np.round(np.append(base, rest // count + more) * step, 9)
    raise PlanError(
        f"a raft of {profile.quality.raft_height:g} mm is no base and interface in layers of "
        f"{printer.min_layer:g} to {printer.max_layer:g} mm",
        remedy=f"choose quality.raft_height from {2 * thinnest * step:g} mm up, 0 for no raft",
    )


def raft_paths(printed: Sections, profile: Profile) -> Toolpaths:
    """Loops and lines of the raft; none if not asked for.

    Each layer has a loop around it and lines across those of its neighbours, the last ones across the lines of the
    part's first layer. The base is laid in wide beads, to `raft_base_density`.

    Args:
        printed: of `on_raft`.
        profile: what they were made with.
    """
    if not profile.quality.raft_height:
        return paths_of(printed.plan, [], np.zeros(0, np.int64), Role.RAFT, 0.0)
    heights = raft_heights(profile)
    n = len(heights)
    raft = printed.solid.select(printed.solid.ring_layer < n)
    area = Areas(raft.xy, raft.ring_start, raft.ring_layer, n)
    width = np.full(n, profile.extrusion_width)
    width[0] = max(_BASE_WIDTH * profile.printer.nozzle_diameter, width[0])
    gap = bead.spacing(width, heights)
    loop = offset(area, -width / 2)
    rows = np.where(np.arange(n) == 0, gap / profile.quality.raft_base_density, gap)
    angle = np.deg2rad(profile.quality.infill_angle_deg) + np.pi / 2 * (n - np.arange(n))
    lines = hatch(offset(loop, -gap * (1 - _OVERLAP)), angle=angle, spacing=rows, phase=0.5)
    xy, start, layer = chain_rows(lines, max_turn=_LONGEST_TURN * rows)
    loops = [loop.ring(i) for i in range(loop.n_rings)]
    rings = paths_of(printed.plan, loops, loop.ring_layer, Role.RAFT, width[loop.ring_layer])
    filling = Toolpaths.gathered(
        printed.plan,
        xy=xy,
        size=np.diff(start),
        layer=layer,
        role=np.full(len(layer), Role.RAFT, np.int64),
        width=width[layer],
        closed=False,
    )
    return Toolpaths.joined(printed.plan, [rings, filling])
