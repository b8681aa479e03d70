"""Stepwise uniform refinement: slabs of the thickest layer, each divided evenly as its flattest facet requires.

Source: Sabourin, Houser and Bohn, Adaptive slicing using stepwise uniform refinement, 1996. The part is divided at its
flats, each interval between them into slabs of the thickest layer height. Each slab is divided into the fewest equal
layers whose cusp height t |n_z| is within the limit for every facet in the slab. If a slab is not divisible into whole
z steps, its layers differ by one step. `quality.tolerance` limits half of the cusp height for layers that are cut in
the middle, or all of it if `quality.containment` is one-sided.

If the list of heights has no even division, the slab gets different heights from the list. If these do not fill it, the
slab is made thicker, as far as the next smaller height on the list requires. The last slab below a flat or the top is
the remainder; its last two layers may have any height within the printer's limits.

Guarantee: the cusp height of each facet is within the limit in every layer thicker than the thinnest, unless no such
layers fill the last slab below a flat. The whole slab is examined before it is divided, so no slope is missed. Edges
and peaks are ignored. The number of layers is not minimal: one flat facet makes its whole slab thin, and only whole
fractions of a slab are used (with 0.08 to 0.32 mm: 0.32, 0.16, 0.11, 0.08). Not all flats closer together than the
thinnest layer are met. Cost: one pass over the facets, one over the slabs.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np

from printer_slicer.arrays import Int
from printer_slicer.model import LayerPlan, Mesh
from printer_slicer.planning.reachable_heights import (
    fill_with_reachable_layers,
    find_event_planes,
    find_reachable_layers,
    is_fillable,
)
from printer_slicer.planning.slopes import Slopes, cusp_height
from printer_slicer.planning.z_steps import ZSteps
from printer_slicer.profile import Profile

__all__ = ["plan_stepwise"]

_SLACK = 1e-4  # steps; keeps a limit of a whole number of steps from losing one to rounding
_HeightLimit = Callable[[int, int], int]


def plan_stepwise(mesh: Mesh, profile: Profile) -> LayerPlan:
    """Plan slabs of the thickest layer height, each divided into equal layers as its flattest facet requires.

    Args:
        mesh: the part, standing on z = 0.
        profile: `quality.tolerance` is the allowed deviation.

    Raises:
        PlanError: the part is thinner than the thinnest layer.
    """
    steps = ZSteps(mesh, profile)
    first, rest = steps.split_first_layer()
    heights = [first] if first else []
    slopes, cusp = Slopes(mesh, steps), cusp_height(profile) / steps.size

    def height_limit(bottom: int, top: int) -> int:
        """Return the thickest allowed layer between two z steps, in steps; at least the thinnest one."""
        slope = float(slopes.largest_slope(np.array([bottom]), np.array([top]))[0])
        return max(int(min(cusp / max(slope, 1e-12), steps.highest) + _SLACK), int(steps.allowed[0]))

    for start, end in pairwise([first, *find_event_planes(mesh, steps, first)] if rest else []):
        here = start
        while here < end:
            slab = _plan_slab(here, end, height_limit, steps)
            heights += slab
            here += sum(slab)
    return steps.make_plan(np.array(heights, np.int64), "stepwise")


def _plan_slab(here: int, end: int, height_limit: _HeightLimit, steps: ZSteps) -> list[int]:
    """Return layer heights, in steps, of the next slab above `here`, such that layers can fill the rest up to `end`."""
    thick = int(steps.allowed[-1])
    if not _is_rest_fillable(here + thick, end, steps):
        return _plan_last_slab(end - here, height_limit(here, end), steps)
    limit = height_limit(here, here + thick)
    slab = _divide_evenly(thick, limit, steps) or _fill_with_listed_heights(thick, limit, steps)
    return slab or _plan_thicker_slab(here, end, height_limit, steps)


def _is_rest_fillable(top: int, end: int, steps: ZSteps) -> bool:
    """Return whether layers can fill the space between the top of a slab and the plane `end`."""
    return top <= end and is_fillable(end - top, steps)


def _divide_evenly(total: int, limit: int, steps: ZSteps) -> list[int]:
    """Divide a slab into the fewest equal layers within the limit; empty if their height is not allowed."""
    allowed = set(steps.allowed.tolist())
    for count in range(-(-total // limit), total // int(steps.allowed[0]) + 1):
        low, more = divmod(total, count)
        if {low, low + (more > 0)} <= allowed:
            return [low + 1] * more + [low] * (count - more)
    return []


def _fill_with_listed_heights(total: int, limit: int, steps: ZSteps) -> list[int]:
    """Fill a slab with allowed heights within the limit, the thickest first; empty if that is impossible."""
    heights = _fill_to_plane(total, limit, steps).tolist()
    return heights if max(heights) <= limit and set(heights) <= set(steps.allowed.tolist()) else []


def _fill_to_plane(total: int, limit: int, steps: ZSteps) -> Int:
    """Return layers that fill `total` z steps below a plane, with the same limit everywhere."""
    limits = np.full(total, limit, np.int64)
    return fill_with_reachable_layers(
        find_reachable_layers(limits, [total], 0, steps), limits, [total], 0, steps
    )


def _plan_thicker_slab(here: int, end: int, height_limit: _HeightLimit, steps: ZSteps) -> list[int]:
    """Return a slab of equal layers of an allowed height, at least as thick as the thickest layer."""
    thick = int(steps.allowed[-1])
    for height in steps.allowed[::-1].tolist():
        total = -(-thick // height) * height
        if _is_rest_fillable(here + total, end, steps) and height <= height_limit(here, here + total):
            return [height] * (total // height)
    return _plan_last_slab(end - here, height_limit(here, end), steps)


def _plan_last_slab(total: int, limit: int, steps: ZSteps) -> list[int]:
    """Return the layers of the last slab below a plane: equal layers if allowed, otherwise listed heights."""
    return _divide_evenly(total, limit, steps) or _fill_to_plane(total, limit, steps).tolist()
