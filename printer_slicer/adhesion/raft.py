"""Make the raft: a platform under the part, with a gap between them so that they can be separated.

Everything from the layer plan to the infill is made as if the part stood on the bed. Then the part is lifted by the
raft and the gap. Paths keep their extrusion height, so the part's first layer is as high as it would be on the bed.
"""

from __future__ import annotations

from math import ceil, floor

import numpy as np

from printer_slicer import bead
from printer_slicer.adhesion.loops import is_on_bed, loop_paths
from printer_slicer.arrays import Float
from printer_slicer.errors import PartError, PlanError
from printer_slicer.geometry import chain_rows, hatch, offset, union
from printer_slicer.model import Areas, Sections, Toolpaths
from printer_slicer.profile import Profile
from printer_slicer.roles import Role
from printer_slicer.values import replace

__all__ = ["place_on_raft", "raft_heights", "raft_paths", "raft_reach"]

_BASE_WIDTH_RATIO = 2.0  # nozzle diameters; wide lines adhere to the bed
_BASE_HEIGHT_RATIO = 0.8  # nozzle diameters; a thick layer evens out the bed
_INTERFACE_HEIGHT_RATIO = 0.5  # nozzle diameters; thin layers make a smooth surface
_LONGEST_TURN_ROWS = 3.0  # row spacings
_OVERLAP_RATIO = 0.1  # of the spacing, overlap of lines with the loop around them
_ROUNDING = 1e-6  # mm


def raft_reach(profile: Profile) -> float:
    """Return how far the raft extends beyond the part, mm; 0 without a raft.

    The rafts of parts that are nearer than four times this distance join.
    """
    return profile.quality.raft_margin if profile.quality.raft_height else 0.0


def place_on_raft(sections: Sections, profile: Profile, beside: Areas | None = None) -> Sections:
    """Return the sections on their raft: the areas of the raft, then the lifted sections of the part.

    Without a raft the sections are returned unchanged. The raft covers the part's first section and `raft_margin`
    around it; bays and holes narrower than two margins are filled.

    Args:
        sections: the part.
        profile: margin, height and gap of the raft.
        beside: what else stands on the raft, as a stack of which only the first layer counts.

    Raises:
        PlanError: the height of the raft cannot be divided into layers.
        PartError: part and raft are too high for the printer, leave the bed, or the part does not begin on the bed.
    """
    quality, printer, plan = profile.quality, profile.printer, sections.plan
    if not quality.raft_height:
        return sections
    heights = raft_heights(profile)
    lifted = quality.raft_height + quality.raft_gap
    top = np.round(np.concatenate([np.cumsum(heights), plan.top + lifted]), 9)
    cut = np.concatenate([np.cumsum(heights) - heights / 2, plan.cut + lifted])
    if top[-1] > printer.bed_z + _ROUNDING:
        raise PartError(
            f"part and raft are {top[-1]:.5g} mm high, but {printer.name!r} prints up to {printer.bed_z:g} mm",
            remedy="Lower quality.raft_height, or print without a raft: quality.raft_height=0",
        )
    first = sections.solid.select(sections.solid.ring_layer == 0)
    if not first.n_rings:
        raise PartError(
            "the part does not touch the bed, so it cannot stand on a raft",
            remedy="Leave out `drop=False`, or print without a raft: quality.raft_height=0",
        )
    if beside is not None and beside.n_rings:
        first = union(
            first, beside.of_layers(np.arange(1)).on_layers(np.arange(beside.n_layers), first.n_layers)
        )
    area = _find_raft_area(first, quality.raft_margin)
    if not is_on_bed(list(map(area.ring, range(area.n_rings))), profile, 0.0):
        where = " or enters an excluded area" if printer.excluded_areas else ""
        raise PartError(
            f"a raft {quality.raft_margin:g} mm wider than the part leaves the bed of {printer.name!r}{where}",
            remedy="Lower quality.raft_margin",
        )
    solid = _stack_below(area, sections.solid, len(heights))
    base = np.concatenate([np.cumsum(heights) - heights, plan.base + lifted]) if len(plan.base) else plan.base
    return replace(sections, plan=replace(plan, top=top, cut=cut, base=base), solid=solid)


def _find_raft_area(first: Areas, margin: float) -> Areas:
    """Return the area of the raft below the first layer, as a stack of one layer."""
    one = Areas(first.xy, first.ring_start, first.ring_layer, 1)
    return offset(offset(one, 2 * margin, join="round"), -margin, join="round")


def _stack_below(area: Areas, solid: Areas, n_below: int) -> Areas:
    """Add `n_below` layers, each with the area `area`, below the stack `solid`."""
    rings = np.tile(np.arange(area.n_rings), n_below)
    below = area.take(rings)
    return Areas(
        np.concatenate([below.xy, solid.xy]),
        np.concatenate([below.ring_start, solid.ring_start[1:] + len(below.xy)]),
        np.concatenate([np.repeat(np.arange(n_below), area.n_rings), solid.ring_layer + n_below]),
        n_below + solid.n_layers,
    )


def raft_heights(profile: Profile) -> Float:
    """Return the layer heights (B,) of the raft, mm: a thick base, then thin interface layers of about equal height.

    All heights are whole z steps within the printer's limits; their sum is `raft_height`.

    Raises:
        PlanError: no such heights exist.
    """
    printer, step = profile.printer, profile.printer.z_step
    total = round(profile.quality.raft_height / step)
    thinnest, thickest = (
        ceil(printer.min_layer / step - _ROUNDING),
        floor(printer.max_layer / step + _ROUNDING),
    )
    wanted = _INTERFACE_HEIGHT_RATIO * printer.nozzle_diameter / step
    highest = max(
        min(thickest, floor(_BASE_HEIGHT_RATIO * printer.nozzle_diameter / step + _ROUNDING)), thinnest
    )
    for base in range(min(highest, total - thinnest), thinnest - 1, -1):
        rest = total - base
        fewest, most = ceil(rest / thickest), rest // thinnest
        if fewest <= most:
            count = min(max(round(rest / wanted), fewest, 1), most)
            more = np.arange(count) < rest % count
            return np.round(np.append(base, rest // count + more) * step, 9)
    raise PlanError(
        f"a raft of {profile.quality.raft_height:g} mm cannot be divided into layers of "
        f"{printer.min_layer:g} to {printer.max_layer:g} mm",
        remedy=f"Set quality.raft_height to at least {2 * thinnest * step:g} mm, or to 0 for no raft",
    )


def raft_paths(printed: Sections, profile: Profile) -> Toolpaths:
    """Return the loops and lines of the raft; empty if the profile has no raft.

    Each layer has a loop along its border and lines perpendicular to those of its neighbours; the last lines cross
    those of the part's first layer. The base has wide lines at `raft_base_density`.

    Args:
        printed: result of `place_on_raft`.
        profile: the profile used for it.
    """
    if not profile.quality.raft_height:
        return loop_paths(printed.plan, [], np.zeros(0, np.int64), Role.RAFT, 0.0)
    heights = raft_heights(profile)
    n = len(heights)
    raft = printed.solid.select(printed.solid.ring_layer < n)
    area = Areas(raft.xy, raft.ring_start, raft.ring_layer, n)
    width = np.full(n, profile.extrusion_width)
    width[0] = max(_BASE_WIDTH_RATIO * profile.printer.nozzle_diameter, width[0])
    gap = bead.spacing(width, heights)
    loop = offset(area, -width / 2)
    rows = np.where(np.arange(n) == 0, gap / profile.quality.raft_base_density, gap)
    angle = np.deg2rad(profile.quality.infill_angle_deg) + np.pi / 2 * (n - np.arange(n))
    lines = hatch(offset(loop, -gap * (1 - _OVERLAP_RATIO)), angle=angle, spacing=rows, phase=0.5)
    xy, start, layer = chain_rows(lines, max_turn=_LONGEST_TURN_ROWS * rows)
    loops = [loop.ring(i) for i in range(loop.n_rings)]
    rings = loop_paths(printed.plan, loops, loop.ring_layer, Role.RAFT, width[loop.ring_layer])
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
