"""The heights at which layers may end, and which layers a plan may have between them.

Heights are counted in units, a whole number of the printer's z steps; a unit is divided into an even number of cells,
so that the middle of every layer is a border between cells. A height from the list may be anywhere; any other one only
where the layer touches an event plane (a flat, a peak, the part's top, the end of a range). That leaves a fraction of
what the printer could print, and all that a plan needs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import gcd
from typing import Final, NamedTuple

import numpy as np

from printer_slicer.arrays import Bool, Float, Int
from printer_slicer.model import Mesh
from printer_slicer.planning.z_steps import ZSteps
from printer_slicer.profile import HeightRange, Profile
from printer_slicer.surface import find_flats, read_surface

__all__ = [
    "FINEST",
    "HeightGrid",
    "HeightRow",
    "event_planes",
    "list_layers",
    "overlaps_range",
    "range_borders",
]

FINEST: Final = 0.0025
"""mm; heights need not be told apart more finely to end on an event plane."""


@dataclass(frozen=True, slots=True)
class HeightGrid:
    """The heights at which layers may end.

    Attributes:
        unit: mm.
        steps: z steps in a unit.
        n: units in the part, to the nearest.
        rest: z steps that the part is higher than n units; the last layer has them too.
        lowest, highest: heights that the printer can print, in units.
    """

    unit: float
    steps: int
    n: int
    rest: int
    lowest: int
    highest: int

    @property
    def cells(self) -> int:
        """Cells in a unit: an even number, each no larger than 0.0025 mm."""
        return 2 * max(int(np.ceil(self.unit / (2 * FINEST) - 1e-6)), 1)

    @property
    def cell(self) -> float:
        """mm."""
        return self.unit / self.cells

    @classmethod
    def of(cls, steps: ZSteps, more: Sequence[float] = ()) -> HeightGrid:
        """The coarsest grid with all allowed heights, and `more` in mm, that is fine enough for event planes."""
        wanted = [steps.of(height) for height in more]
        common = gcd(*steps.allowed.tolist(), *wanted, steps.first)
        fits = [
            d for d in range(1, common + 1) if common % d == 0 and (d == 1 or d * steps.size <= FINEST + 1e-9)
        ]
        size = fits[-1]
        n = round(steps.part / size)
        low, high = -(-steps.lowest // size), steps.highest // size
        return cls(steps.size * size, size, n, steps.part - n * size, low, high)

    def nearest(self, z: Float) -> Int:
        """The nodes nearest to heights in mm."""
        return np.rint(np.asarray(z) / self.unit).astype(np.int64).clip(0, self.n)

    def steps_of(self, heights: Int) -> Int:
        """The heights in z steps of the layers of a plan with these in units."""
        steps = heights * self.steps
        steps[-1] += self.rest
        return np.asarray(steps)

    def units(self, height: float) -> int:
        """The nearest number of units to a height in mm."""
        return round(height / self.unit)


class HeightRow(NamedTuple):
    """All layers of one height that a plan may have.

    Attributes:
        height: units.
        end: (n,) where each ends, in units, ascending.
        listed: (n,) whether the height is allowed there.
        free: (n,) whether it is, or the layer touches an event plane.
    """

    height: int
    end: Int
    listed: Bool
    free: Bool


def range_borders(profile: Profile, height: float) -> Float:
    """(n,) mm, where ranges begin and end within a part of this height."""
    ends = [z for stretch in profile.dials.ranges for z in (stretch.low, stretch.high)]
    return np.array([z for z in ends if 0 < z < height], np.float64)


def overlaps_range(stretch: HeightRange, grid: HeightGrid, start: Int, end: Int) -> Bool:
    """Whether layers between two nodes reach into a range."""
    return np.asarray((end > grid.units(stretch.low)) & (start < grid.units(stretch.high)))


def event_planes(mesh: Mesh, profile: Profile) -> Float:
    """(n,) mm, where layers may have any height: flats, level ridges, peaks and pits, ends of ranges.

    Flats that lean by a hair are no events of the surface, but shall be met all the same.
    """
    events = read_surface(mesh).contacts.events()
    return np.concatenate([events, find_flats(mesh)[0], range_borders(profile, mesh.height)])


def list_layers(
    planes: Float, grid: HeightGrid, steps: ZSteps, profile: Profile, *, everywhere: bool
) -> list[HeightRow]:
    """The layers that a plan may have, from the lowest height up.

    Args:
        planes: (n,) mm, the event planes.
        grid: heights and ends.
        steps: of the printer: allowed heights, first layer.
        profile: tells the ranges.
        everywhere: layers of every height that the printer can print, as a last resort.
    """
    first = steps.first // grid.steps
    event = np.zeros(grid.n + 1, np.bool_)
    event[grid.nearest(planes)] = True
    event[0], event[-1] = bool(first), True  # a first layer of its own is as free as one that meets a flat
    allowed = set((steps.allowed // grid.steps).tolist())
    rows = []
    for height in range(grid.lowest, min(grid.highest, grid.n) + 1):
        end = np.arange(height, grid.n + 1)
        start = end - height
        listed = np.full(len(end), height in allowed)
        for stretch in profile.dials.ranges:
            if stretch.layer_height and grid.units(stretch.layer_height) == height:
                listed |= overlaps_range(stretch, grid, start, end)
        free = listed | event[end] | event[start]
        chosen = free | everywhere
        if first and height != first:
            chosen[0] = False
        chosen[-1] &= steps.lowest <= height * grid.steps + grid.rest <= steps.highest
        rows.append(HeightRow(height, end[chosen], listed[chosen], free[chosen]))
    return rows
