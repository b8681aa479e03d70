"""The grid of heights at which layers may end, and the candidate layers between them.

Heights are counted in units of a whole number of the printer's z steps. A unit is divided into an even number of cells,
so that the middle of every layer is a cell border. Layers of an allowed height may be anywhere. Layers of other heights
are candidates only if they touch an event plane (a flat, a peak, the top of the part, the end of a range). This keeps
the number of candidates small without losing useful plans.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import gcd
from typing import Final, NamedTuple

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, distinct
from printer_slicer.model import Mesh
from printer_slicer.planning.support_tops import find_support_contacts
from printer_slicer.planning.z_steps import ZSteps
from printer_slicer.profile import HeightRange, Profile
from printer_slicer.surface import find_flats, read_surface
from printer_slicer.values import Struct

__all__ = [
    "FINEST",
    "HeightGrid",
    "HeightRow",
    "find_event_planes",
    "list_candidate_layers",
    "overlaps_range",
    "range_ends",
]

FINEST: Final = 0.0025
"""mm; a grid finer than this is not needed to meet event planes."""


class HeightGrid(Struct, frozen=True):
    """The grid of heights at which layers may end.

    Attributes:
        unit: size of a unit, mm.
        steps: z steps per unit.
        n: height of the part in units, rounded.
        rest: z steps by which the part is higher than n units; they are added to the last layer.
        lowest, highest: minimum and maximum layer height of the printer, in units.
    """

    unit: float
    steps: int
    n: int
    rest: int
    lowest: int
    highest: int

    @property
    def cells(self) -> int:
        """Number of cells per unit; even, and each cell is at most 0.0025 mm."""
        return 2 * max(int(np.ceil(self.unit / (2 * FINEST) - 1e-6)), 1)

    @property
    def cell(self) -> float:
        """Size of a cell, mm."""
        return self.unit / self.cells

    @classmethod
    def of(cls, steps: ZSteps, extra: Sequence[float] = ()) -> HeightGrid:
        """Build the coarsest grid for all allowed heights, `extra` heights in mm, and event planes."""
        wanted = [steps.to_steps(height) for height in extra]
        common = gcd(*steps.allowed.tolist(), *wanted, steps.first)
        fits = [
            d for d in range(1, common + 1) if common % d == 0 and (d == 1 or d * steps.size <= FINEST + 1e-9)
        ]
        size = fits[-1]
        n = round(steps.part / size)
        low, high = -(-steps.lowest // size), steps.highest // size
        return cls(steps.size * size, size, n, steps.part - n * size, low, high)

    def nearest_nodes(self, z: Float) -> Int:
        """Return the nodes nearest to heights in mm."""
        return np.rint(np.asarray(z) / self.unit).astype(np.int64).clip(0, self.n)

    def to_steps(self, heights: Int) -> Int:
        """Convert the layer heights of a plan from units to z steps."""
        steps = heights * self.steps
        steps[-1] += self.rest
        return np.asarray(steps)

    def to_units(self, height: float) -> int:
        """Convert a height in mm to units, rounded."""
        return round(height / self.unit)


class HeightRow(NamedTuple):
    """All candidate layers of one height.

    Attributes:
        height: layer height, units.
        end: (n,) top of each layer, units, ascending.
        listed: (n,) whether the height is allowed there.
        free: (n,) whether the height is allowed there, or the layer touches an event plane.
    """

    height: int
    end: Int
    listed: Bool
    free: Bool


def range_ends(profile: Profile, height: float) -> Float:
    """Return the ends of height ranges (n,) that lie inside a part of this height, mm."""
    ends = [z for height_range in profile.dials.ranges for z in (height_range.low, height_range.high)]
    return np.array([z for z in ends if 0 < z < height], np.float64)


def overlaps_range(height_range: HeightRange, grid: HeightGrid, start: Int, end: Int) -> Bool:
    """Return whether layers between two nodes overlap a range."""
    return np.asarray((end > grid.to_units(height_range.low)) & (start < grid.to_units(height_range.high)))


def find_event_planes(mesh: Mesh, profile: Profile, unit: float) -> Float:
    """Return the z (n,), mm, of events, next to which layers may have any height.

    Events are flats, ridges, peaks, pits, range ends and, at multiples of `unit` in mm, the tops of supports that have
    the layers of the part. Nearly horizontal flats are not events of the surface, so they are added.
    """
    events = read_surface(mesh).contacts.event_heights()
    tops = find_support_contacts(mesh, profile, unit)[1] * unit
    return np.concatenate([events, find_flats(mesh)[0], range_ends(profile, mesh.height), tops])


def list_candidate_layers(
    planes: Float, grid: HeightGrid, steps: ZSteps, profile: Profile, *, everywhere: bool
) -> list[HeightRow]:
    """List the candidate layers, from the smallest height up.

    Args:
        planes: (n,) mm, the event planes.
        grid: the grid of heights.
        steps: allowed heights and first layer.
        profile: gives the height ranges.
        everywhere: allow every height that the printer can print, as a last resort.
    """
    first = steps.first // grid.steps
    event = np.zeros(grid.n + 1, np.bool_)
    event[grid.nearest_nodes(planes)] = True
    event[0], event[-1] = bool(first), True  # above a fixed first layer any height is allowed, as at a flat
    nodes = np.flatnonzero(event)
    allowed = set((steps.allowed // grid.steps).tolist())
    rows = []
    for height in range(grid.lowest, min(grid.highest, grid.n) + 1):
        ranges = [
            one
            for one in profile.dials.ranges
            if one.layer_height and grid.to_units(one.layer_height) == height
        ]
        if everywhere or ranges or height in allowed:
            end = np.arange(height, grid.n + 1)
        else:  # few layers touch an event plane
            end = distinct(np.concatenate([nodes[nodes >= height], nodes[nodes <= grid.n - height] + height]))
        start = end - height
        listed = np.full(len(end), height in allowed)
        for height_range in ranges:
            listed |= overlaps_range(height_range, grid, start, end)
        free = listed | event[end] | event[start]
        chosen = free | everywhere
        if first and height != first:
            chosen[start == 0] = False
        chosen[end == grid.n] &= steps.lowest <= height * grid.steps + grid.rest <= steps.highest
        rows.append(HeightRow(height, end[chosen], listed[chosen], free[chosen]))
    return rows
