"""Find layers of allowed heights that end exactly on all event planes.

An event plane is a height at which a layer should end: a flat, or the top of the part. Between two planes a planner
chooses among `ZSteps.allowed`, no thicker than the surface permits. If these heights do not add up to the distance, the
last layer below the plane may have another height, then the last two.

Reachability is computed downward from each plane: step z is reachable if a layer of an allowed height on z ends on a
reachable step. That takes one bit mask per step. A planner that goes upward through reachable steps never gets stuck
below a plane.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from printer_slicer.arrays import Int
from printer_slicer.model import Mesh
from printer_slicer.planning.slopes import nearest_step
from printer_slicer.planning.z_steps import ZSteps, fill_with_layers
from printer_slicer.surface.flats import find_flats

__all__ = [
    "fill_with_reachable_layers",
    "find_event_planes",
    "find_next_planes",
    "find_reachable_layers",
    "is_fillable",
]


def find_event_planes(mesh: Mesh, steps: ZSteps, bottom: int) -> list[int]:
    """Return, in z steps, the flats above `bottom` on which layers can end, and the top of the part, ascending.

    Of flats too close together for the printer's layers, the larger ones are kept. The heights at which supports should
    end below flats follow, if layers can end there as well.
    """
    planes = [bottom, steps.part]
    heights, areas = find_flats(mesh)
    # Areas are rounded, so that rounding errors do not decide between equal ones.
    by_area = np.lexsort((heights, -np.round(areas, 2)))
    flats = nearest_step(heights[by_area], steps.size)
    for plane in [*flats.tolist(), *steps.support_tops.tolist()]:
        place = bisect_left(planes, plane)
        if 0 < place < len(planes) and planes[place] != plane:
            below, above = plane - planes[place - 1], planes[place] - plane
            if is_fillable(below, steps) and is_fillable(above, steps):
                planes.insert(place, plane)
    return planes[1:]


def is_fillable(total: int, steps: ZSteps) -> bool:
    """Return whether zero or more layers within the printer's limits can have this total height in z steps."""
    return -(-total // steps.highest) * steps.lowest <= total


def find_next_planes(planes: Sequence[int], steps: ZSteps) -> Int:
    """Return the first event plane above each z step (part + 1,), or the top of the part if there is none."""
    place = np.searchsorted(planes, np.arange(steps.part + 1), side="right")
    return np.append(planes, steps.part)[place].astype(np.int64)


def find_reachable_layers(limit: Int, planes: Sequence[int], bottom: int, steps: ZSteps) -> Int:
    """Return the thickest layer on each z step from whose top all event planes can be met; 0 if there is none.

    If no layers within the limit meet the next plane, the limit is exceeded by as few steps as possible, right below
    the plane.

    Args:
        limit: (part,) maximum layer height on each step, at least the thinnest allowed one.
        planes: heights at which layers must end, ascending, in steps; the last one is the top.
        bottom: bottom of the first layer, in steps.
        steps: z steps of the printer.

    Returns:
        (part,) heights in z steps. Layers of these heights, stacked from `bottom`, meet every plane exactly. If no
        layers within the printer's limits can, the last one extends above the plane.
    """
    limits = np.minimum(limit, steps.highest).tolist()
    masks = _build_height_masks(steps)
    reachable = [0] * len(limits)
    for start, end in pairwise([bottom, *planes]):
        reachable[start:end] = _fill_interval(limits[start:end], masks, steps)
    return np.array(reachable, np.int64)


def fill_with_reachable_layers(
    reachable: Int, limit: Int, planes: Sequence[int], bottom: int, steps: ZSteps
) -> Int:
    """Stack layers of the heights `reachable` from `bottom` up; return the heights (n,) of these layers in z steps.

    If the last layer below a plane is thinner than the one before, both get half of their sum, if that is allowed.
    """
    heights: list[int] = []
    here, tallest = bottom, reachable.tolist()
    ends, allowed = set(planes), set(steps.allowed.tolist())
    while here < len(tallest):
        height = tallest[here]
        if here + height in ends and heights and here not in ends:
            both = heights[-1] + height
            more, less = both - both // 2, both // 2
            shared = here - heights[-1] + more
            if heights[-1] > more and {more, less} <= allowed and less <= limit[shared]:
                heights[-1], here, height = more, shared, less
        heights.append(height)
        here += height
    return np.array(heights, np.int64)


def _build_height_masks(steps: ZSteps) -> list[int]:
    """Return for each limit in steps a bit mask of the allowed heights up to it."""
    masks, allowed = [0], set(steps.allowed.tolist())
    for height in range(1, steps.highest + 1):
        masks.append(masks[-1] | ((height in allowed) << height))
    return masks


def _fill_interval(limits: list[int], masks: list[int], steps: ZSteps) -> list[int]:
    """Compute `find_reachable_layers` for one interval between two planes.

    Tries in this order: allowed heights only; the last layer free between thinnest and thickest; the last two layers
    free; the last two free within the printer's limits; the same four with the limit exceeded by one step, two, ...
    """
    total, thin, thick = len(limits), int(steps.allowed[0]), int(steps.allowed[-1])
    extra = 0
    while extra < 1.5 * steps.highest:
        relaxed = [min(limit + extra, steps.highest) for limit in limits] if extra else limits
        for count, low, high in (
            (0, 0, 0),
            (1, thin, thick),
            (2, thin, thick),
            (2, steps.lowest, steps.highest),
        ):
            free = _find_free_layers(relaxed, low, high, count)
            reachable = _search_downward(limits, relaxed, masks, free)
            if reachable[0]:
                return reachable
        extra += max(extra // 2, 1)
    reachable, here = [0] * total, 0
    step = masks[min(limits)].bit_length() - 1
    for height in fill_with_layers(total, step, steps.lowest, steps.highest).tolist():
        reachable[here] = height
        here += height
    return reachable


def _find_free_layers(limits: list[int], low: int, high: int, count: int) -> dict[int, int]:
    """Return layers {bottom: height} of any height from `low` to `high` among the last `count` layers."""
    end = len(limits)
    last = {
        end - height: height
        for height in range(low, min(high, end) + 1)
        if count and height <= limits[end - height]
    }
    free = dict(last)
    for here in range(max(end - 2 * high, 0), max(end - 2 * low + 1, 0)) if count > 1 else ():
        half = (end - here + 1) // 2
        # Two equal layers if possible, otherwise the thickest that leaves room for one more.
        for height in (half, *range(min(high, limits[here]), low - 1, -1)):
            if here not in free and low <= height <= min(high, limits[here]) and here + height in last:
                free[here] = height
    return free


def _search_downward(
    limits: list[int], relaxed: list[int], masks: list[int], free: dict[int, int]
) -> list[int]:
    """Return for each z step a layer height from whose top the plane at the end can be reached; 0 if there is none.

    Prefers a free layer that ends the interval, then the thickest allowed one within the limit, then the one that
    exceeds it least, then the first of two free ones.
    """
    end = len(limits)
    reachable = [0] * end
    leads, full = 1, (1 << masks[-1].bit_length()) - 1  # bit i: the plane can be reached from i steps higher
    for here in range(end - 1, -1, -1):
        leads = (leads << 1) & full
        hits = leads & masks[relaxed[here]]
        within = hits & masks[limits[here]]
        height = free.get(here, 0)
        if hits and here + height != end:
            height = within.bit_length() - 1 if within else (hits & -hits).bit_length() - 1
        reachable[here] = height
        leads |= height > 0
    return reachable
