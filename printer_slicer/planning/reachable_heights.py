"""Layers that end exactly where they must: stretches of z between event planes, filled with the heights allowed.

An event plane is a height at which a layer shall end: a flat of the part, its top. Between two of them a planner
chooses among `ZSteps.allowed`, no thicker than the surface permits; where the list does not lead to the plane exactly,
the last layer below it may have another height, then the last two.

Which heights lead on is found from each plane downward. Where a layer of height h may stand on step z, and its top
leads on, z leads on: one look at a window of bits for each step of z. A planner that walks upward and takes only
heights that lead on never gets stuck under a plane.
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

__all__ = ["event_planes", "is_fillable", "next_plane", "reachable_layers", "stack_layers"]


def event_planes(mesh: Mesh, steps: ZSteps, bottom: int) -> list[int]:
    """The flats that layers can end on, and the top of the part: ascending, in z steps, all over `bottom`.

    Of flats too near to each other for the machine's layers, the larger ones are kept.
    """
    planes = [bottom, steps.part]
    heights, areas = find_flats(mesh)
    # Areas are sums over facets in any order: rounded, so that dust does not decide between equal ones.
    by_area = np.lexsort((heights, -np.round(areas, 2)))
    for plane in nearest_step(heights[by_area], steps.size).tolist():
        place = bisect_left(planes, plane)
        if 0 < place < len(planes) and planes[place] != plane:
            below, above = plane - planes[place - 1], planes[place] - plane
            if is_fillable(below, steps) and is_fillable(above, steps):
                planes.insert(place, plane)
    return planes[1:]


def is_fillable(total: int, steps: ZSteps) -> bool:
    """Whether layers within the machine's limits, or none at all, have this sum in z steps."""
    return -(-total // steps.highest) * steps.lowest <= total


def next_plane(planes: Sequence[int], steps: ZSteps) -> Int:
    """(part + 1,) the first event plane over each z step; over the last one, the top of the part."""
    place = np.searchsorted(planes, np.arange(steps.part + 1), side="right")
    return np.append(planes, steps.part)[place].astype(np.int64)


def reachable_layers(limit: Int, planes: Sequence[int], bottom: int, steps: ZSteps) -> Int:
    """The thickest layer on each z step from which all event planes can be met; 0 where there is none.

    Where no layers within the limit meet the next plane, those are taken that exceed it by the fewest steps, and they
    stand right below the plane.

    Args:
        limit: (part,) the thickest layer that the surface permits on each step, at least the thinnest one allowed.
        planes: where layers must end, ascending, in steps; the last one is the top.
        bottom: where the first layer of all begins.
        steps: of the printer.

    Returns:
        (part,) heights in z steps. A walk from `bottom` that takes them one after the other meets every plane exactly,
        unless no layers within the machine's limits have the sum asked for; then it rises over the last one.
    """
    limits = np.minimum(limit, steps.highest).tolist()
    masks = _masks(steps)
    ways = [0] * len(limits)
    for start, end in pairwise([bottom, *planes]):
        ways[start:end] = _fill_interval(limits[start:end], masks, steps)
    return np.array(ways, np.int64)


def stack_layers(ways: Int, limit: Int, planes: Sequence[int], bottom: int, steps: ZSteps) -> Int:
    """Heights (n,) in z steps of the layers from `bottom` up, as `reachable_layers` has them.

    Where the last layer below a plane is thinner than the one before, both get half of their sum if they may.
    """
    heights: list[int] = []
    here, way = bottom, ways.tolist()
    ends, allowed = set(planes), set(steps.allowed.tolist())
    while here < len(way):
        height = way[here]
        if here + height in ends and heights and here not in ends:
            both = heights[-1] + height
            more, less = both - both // 2, both // 2
            shared = here - heights[-1] + more
            if heights[-1] > more and {more, less} <= allowed and less <= limit[shared]:
                heights[-1], here, height = more, shared, less
        heights.append(height)
        here += height
    return np.array(heights, np.int64)


def _masks(steps: ZSteps) -> list[int]:
    """For each limit in steps the allowed heights up to it, as bits."""
    masks, allowed = [0], set(steps.allowed.tolist())
    for height in range(1, steps.highest + 1):
        masks.append(masks[-1] | ((height in allowed) << height))
    return masks


def _fill_interval(limits: list[int], masks: list[int], steps: ZSteps) -> list[int]:
    """What `reachable_layers` gives, for one stretch between two planes.

    The first that works of: allowed heights only; the last layer free between thinnest and thickest; the last two; the
    last two free within the machine's limits; the same four with the limit exceeded by one step, by two, by three, ...
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
            free = _free_ends(relaxed, low, high, count)
            ways = _downward(limits, relaxed, masks, free)
            if ways[0]:
                return ways
        extra += max(extra // 2, 1)
    ways, here = [0] * total, 0
    step = masks[min(limits)].bit_length() - 1
    for height in fill_with_layers(total, step, steps.lowest, steps.highest).tolist():
        ways[here] = height
        here += height
    return ways


def _free_ends(limits: list[int], low: int, high: int, count: int) -> dict[int, int]:
    """Layers of any height from `low` to `high` by where they begin: up to `count` of them end the stretch."""
    end = len(limits)
    last = {
        end - height: height
        for height in range(low, min(high, end) + 1)
        if count and height <= limits[end - height]
    }
    free = dict(last)
    for here in range(max(end - 2 * high, 0), max(end - 2 * low + 1, 0)) if count > 1 else ():
        half = (end - here + 1) // 2
        # Two equal ones if they may be; else the thickest that leaves one.
        for height in (half, *range(min(high, limits[here]), low - 1, -1)):
            if here not in free and low <= height <= min(high, limits[here]) and here + height in last:
                free[here] = height
    return free


def _downward(limits: list[int], relaxed: list[int], masks: list[int], free: dict[int, int]) -> list[int]:
    """For each step of a stretch the height of a layer that leads on; 0 where there is none.

    A free one that ends the stretch, else the thickest allowed one within the limit, else the one least beyond it, else
    the first of two free ones.
    """
    end = len(limits)
    ways = [0] * end
    leads, full = 1, (1 << masks[-1].bit_length()) - 1  # bit i: i steps higher leads on
    for here in range(end - 1, -1, -1):
        leads = (leads << 1) & full
        hits = leads & masks[relaxed[here]]
        within = hits & masks[limits[here]]
        height = free.get(here, 0)
        if hits and here + height != end:
            height = within.bit_length() - 1 if within else (hits & -hits).bit_length() - 1
        ways[here] = height
        leads |= height > 0
    return ways
