"""Spiral mode (vase): print the outlines of all layers above the bottom as one continuous rising extrusion.

Within a layer the nozzle rises from the bottom to the top of the layer and blends from the outline below to that of the
layer. The extrusion fills the height down to the turn below, for any layer heights: its height starts at 0 on the first
turn, and falls to 0 on an additional last turn at the top.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from printer_slicer.arrays import Float, Int, consecutive
from printer_slicer.errors import PartError
from printer_slicer.model import Toolpaths
from printer_slicer.ordering.loops import Loops, start_loops_at
from printer_slicer.profile import Profile, profile_with
from printer_slicer.roles import Role
from printer_slicer.values import replace

__all__ = ["apply_spiral_settings", "make_spiral", "select_spiral_paths"]

_SPIRAL_SETTINGS: Final = {
    "quality.perimeters": 1,
    "quality.infill_density": 0,
    "quality.top_thickness": 0,
    "quality.solid_infill_below_area": 0,
    "quality.extra_perimeters": False,
    "quality.seam": "aligned",
    "quality.z_contouring": False,
}

_MAX_BLEND_WIDTHS = 3.0  # maximum distance of the outline below for blending, in extrusion widths


def apply_spiral_settings(profile: Profile) -> Profile:
    """Apply the settings that spiral mode requires, if the profile uses it."""
    return profile_with(profile, _SPIRAL_SETTINGS) if profile.quality.spiral else profile


def select_spiral_paths(paths: Toolpaths, profile: Profile) -> Toolpaths:
    """Drop all paths above the bottom except the external loops.

    Raises:
        PartError: a layer above the bottom does not have exactly one outline.
    """
    first = _find_first_spiral_layer(paths, profile)
    outer = paths.closed & (paths.role == Role.EXTERNAL_PERIMETER) & (paths.layer >= first)
    n_loops = np.bincount(paths.layer[outer], minlength=paths.plan.n_layers)[first:]
    wrong = np.flatnonzero(n_loops != 1)
    # The tip of a part may be too thin for an extrusion; the spiral ends there.
    last = int(np.flatnonzero(n_loops)[-1]) if n_loops.any() else -1
    wrong = wrong[wrong <= last]
    if last < 0 or len(wrong):
        z = float(paths.plan.top[first + int(wrong[0])]) if len(wrong) else float(paths.plan.top[-1])
        count = int(n_loops[wrong[0]]) if len(wrong) else 0
        raise PartError(
            f"spiral mode needs one outline on every layer above the bottom; at z {z:g} mm there are {count}",
            remedy="Turn off quality.spiral, or choose a part without holes and branches",
        )
    return paths.take(np.flatnonzero(outer | (paths.layer < first)))


def make_spiral(paths: Toolpaths, profile: Profile) -> Toolpaths:
    """Join the external loops above the bottom into one rising extrusion; paths must be in printing order."""
    first = _find_first_spiral_layer(paths, profile)
    chosen = np.flatnonzero(paths.layer >= first)
    if not len(chosen):
        return paths
    paths = _align_starts(paths, chosen)
    loops = Loops.of(paths, chosen)
    below = np.flatnonzero(paths.layer == first - 1)
    base = below[paths.closed[below] & (paths.role[below] == Role.EXTERNAL_PERIMETER)]
    turns = _make_rising_turns(paths, loops, Loops.of(paths, base[:1]), profile)
    return Toolpaths.joined(paths.plan, [paths.take(np.flatnonzero(paths.layer < first)), turns])


def _find_first_spiral_layer(paths: Toolpaths, profile: Profile) -> int:
    """Return the first layer above the bottom; the bottom includes at least the layer on the bed or raft."""
    base = int(paths.layer[paths.role == Role.RAFT].max(initial=-1)) + 1
    bottom = paths.plan.bottom
    over = np.searchsorted(
        bottom, bottom[min(base, len(bottom) - 1)] + profile.quality.bottom_thickness - 1e-9
    )
    return max(base + 1, int(over))


def _align_starts(paths: Toolpaths, chosen: Int) -> Toolpaths:
    """Start every turn at its position nearest to the start of the turn below."""
    loops = Loops.of(paths, chosen)
    along = np.zeros(loops.n_loops)
    place = loops.xy[loops.start[0]][None]
    for turn in range(1, loops.n_loops):
        along[turn : turn + 1], _ = loops.nearest_positions(np.array([turn]), place)
        place = loops.points_at(np.array([turn]), along[turn : turn + 1])
    return start_loops_at(paths, loops, along)


def _make_rising_turns(paths: Toolpaths, loops: Loops, base: Loops, profile: Profile) -> Toolpaths:
    """Convert the loops (R,) to open rising paths, and add one more turn at the top."""
    n = np.append(np.diff(loops.start), np.diff(loops.start)[-1])
    turn = np.repeat(np.arange(len(n)), n + 1)
    step = consecutive(np.zeros_like(n), n + 1)
    loop = np.minimum(turn, loops.n_loops - 1)
    point = loops.start[loop] + step % n[turn]
    around = np.where(step == n[turn], loops.length[loop], loops.reach[point])
    share = around / np.maximum(loops.length[loop], 1e-9)
    layer = loops.layer[loop]
    height = paths.plan.height[layer]
    under = np.append(0.0, paths.plan.height[loops.layer])[turn]  # of the turn below; 0 below the first
    is_last = turn == loops.n_loops
    bead_height = np.where(is_last, (1 - share) * height, (1 - share) * under + share * height)
    reach = _MAX_BLEND_WIDTHS * profile.extrusion_width
    xy = _join_turns(_blend_outlines(loops, base, (turn, point, share), reach), n + 1, reach)
    of_paths = loops.point[point]
    made = Toolpaths.gathered(
        paths.plan,
        xy=xy,
        size=n + 1,
        layer=np.append(loops.layer, loops.layer[-1]),
        role=np.full(len(n), int(Role.EXTERNAL_PERIMETER)),
        width=paths.width[of_paths],
        closed=False,
        support_ratio=paths.support_ratio[of_paths],
    )
    rise = np.where(is_last, 0.0, -(1 - share) * height)
    return replace(made, z_offset=rise, flow_ratio=bead_height / height)


def _join_turns(xy: Float, size: Int, reach: float) -> Float:
    """Start each turn of `size` (R,) points at the end of the turn below, if that is within `reach`, mm.

    The nearest position on the outline below may differ from the end of its turn.
    """
    end = np.cumsum(size)
    start, before = end[:-1], end[:-1] - 1
    near = np.hypot(*(xy[start] - xy[before]).T) < reach
    xy[start[near]] = xy[before[near]]
    return xy


def _blend_outlines(loops: Loops, base: Loops, position: tuple[Int, Int, Float], reach: float) -> Float:
    """Return points (n, 2) of turns, blended from the outline of the layer below to the outline of their own layer.

    `position` is the turn, the loop point and the fraction of the turn of each, (n,).
    """
    turn, point, share = position
    xy = loops.xy[point].copy()
    for index in range(loops.n_loops):
        under, which = (loops, index - 1) if index else (base, 0)
        if not under.n_loops:
            continue
        own = np.flatnonzero(turn == index)
        goal = loops.xy[point[own]]
        along, gap = under.nearest_positions(np.full(len(own), which), goal)
        near = gap < reach
        beside = under.points_at(np.full(len(own), which), along)
        part = share[own][:, None]
        xy[own[near]] = ((1 - part) * beside + part * goal)[near]
    return xy
