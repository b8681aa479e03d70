"""Stepwise uniform refinement: slabs of the thickest layer, each divided evenly as far as its steepest facet asks.

Source: Sabourin, Houser and Bohn, Adaptive slicing using stepwise uniform refinement, 1996. The part is divided at its
flats, each stretch between them into slabs of the thickest layer, and each slab into the fewest equal layers whose cusp
height t |n_z| is within the limit for the steepest facet anywhere in the slab. What does not go evenly into z steps
makes layers of one slab differ by one step. `quality.tolerance` bounds half of the cusp height, for layers that are cut
in the middle, or all of it where `quality.containment` is one-sided.

A list of heights may hold no even division. Then the slab gets different heights from the list; if they do not fill it
either, it is made as much thicker as the next lower height of the list asks. Below a flat and the top, the last slab is
what is left, and its last two layers may have any height within the machine's limits.

Guarantee: each facet's cusp height is within the limit in every layer that is thicker than the thinnest, unless no such
layers fill the last slab below a flat. The whole slab is looked at before it is divided, so no steep start is missed.
It does not see edges and peaks, and it is not the fewest layers: one steep facet makes its whole slab thin, and only
whole parts of a slab are used (with 0.08 to 0.32 mm: 0.32, 0.16, 0.11, 0.08). Flats nearer to each other than the
thinnest layer are not all met. Cost: one pass over the facets, one over the slabs.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np

from printer_slicer.arrays import Int
from printer_slicer.model import LayerPlan, Mesh
from printer_slicer.planning.reachable_heights import (
    event_planes,
    is_fillable,
    reachable_layers,
    stack_layers,
)
from printer_slicer.planning.slopes import Slopes, cusp_height
from printer_slicer.planning.z_steps import ZSteps
from printer_slicer.profile import Profile

__all__ = ["plan_stepwise"]

_SLACK = 1e-4  # steps; a limit that is a whole number of steps must not lose one to rounding
_Cap = Callable[[int, int], int]


def plan_stepwise(mesh: Mesh, profile: Profile) -> LayerPlan:
    """Slabs of the thickest layer, each in as many equal layers as its steepest facet asks for.

    Args:
        mesh: the part, standing on z = 0.
        profile: `quality.tolerance` is the error allowed.

    Raises:
        PlanError: the part is thinner than the thinnest layer.
    """
    steps = ZSteps(mesh, profile)
    first, rest = steps.begin()
    heights = [first] if first else []
    slopes, cusp = Slopes(mesh, steps), cusp_height(profile) / steps.size

    def cap(bottom: int, top: int) -> int:
        """The thickest layer between two z steps, in steps; the thinnest allowed one always may be."""
        slope = float(slopes.largest(np.array([bottom]), np.array([top]))[0])
        return max(int(min(cusp / max(slope, 1e-12), steps.highest) + _SLACK), int(steps.allowed[0]))

    for start, end in pairwise([first, *event_planes(mesh, steps, first)] if rest else []):
        here = start
        while here < end:
            slab = _slab(here, end, cap, steps)
            heights += slab
            here += sum(slab)
    return steps.plan(np.array(heights, np.int64), "stepwise")


def _slab(here: int, end: int, cap: _Cap, steps: ZSteps) -> list[int]:
    """Heights in steps of the layers of the next slab over `here`; what it leaves under `end` can be filled."""
    thick = int(steps.allowed[-1])
    if not _leaves_room(here + thick, end, steps):
        return _last(end - here, cap(here, end), steps)
    limit = cap(here, here + thick)
    slab = _even(thick, limit, steps) or _listed(thick, limit, steps)
    return slab or _longer(here, end, cap, steps)


def _leaves_room(top: int, end: int, steps: ZSteps) -> bool:
    """Whether what is between the top of a slab and the next plane can be filled with layers."""
    return top <= end and is_fillable(end - top, steps)


def _even(total: int, limit: int, steps: ZSteps) -> list[int]:
    """The fewest equal layers within the limit; nothing if their height is not allowed."""
    allowed = set(steps.allowed.tolist())
    for count in range(-(-total // limit), total // int(steps.allowed[0]) + 1):
        low, more = divmod(total, count)
        if {low, low + (more > 0)} <= allowed:
            return [low + 1] * more + [low] * (count - more)
    return []


def _listed(total: int, limit: int, steps: ZSteps) -> list[int]:
    """Allowed heights within the limit that fill the slab, the thickest first; nothing if there are none."""
    heights = _filled(total, limit, steps).tolist()
    return heights if max(heights) <= limit and set(heights) <= set(steps.allowed.tolist()) else []


def _filled(total: int, limit: int, steps: ZSteps) -> Int:
    """Layers under a plane that `total` z steps are left to, the same limit everywhere."""
    limits = np.full(total, limit, np.int64)
    return stack_layers(reachable_layers(limits, [total], 0, steps), limits, [total], 0, steps)


def _longer(here: int, end: int, cap: _Cap, steps: ZSteps) -> list[int]:
    """A slab a little thicker than the thickest layer: so many layers of one allowed height that they reach its top."""
    thick = int(steps.allowed[-1])
    for height in steps.allowed[::-1].tolist():
        total = -(-thick // height) * height
        if _leaves_room(here + total, end, steps) and height <= cap(here, here + total):
            return [height] * (total // height)
    return _last(end - here, cap(here, end), steps)


def _last(total: int, limit: int, steps: ZSteps) -> list[int]:
    """The layers of what is left under a plane: equal ones if they may be, else as near to the list as it goes."""
    return _even(total, limit, steps) or _filled(total, limit, steps).tolist()
