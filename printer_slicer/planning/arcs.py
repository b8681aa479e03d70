"""Every layer that a plan may have, with what it costs: one table a quantity, by height and by end.

Heights are counted in units, a whole number of the printer's z steps; a unit is divided into an even number of cells,
so that the middle of every layer is a border between cells. Entry [r, k] of a table is about the layer of `heights[r]`
units that ends `k` units above the bed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import gcd
from typing import Final

import numpy as np

from printer_slicer.geometry import frozen_array
from printer_slicer.model import Bool, Float, Int
from printer_slicer.planning.seconds import LayerTimes
from printer_slicer.planning.steps import Steps
from printer_slicer.profile import Profile
from printer_slicer.surface import Surface
from printer_slicer.surface.runs import run_tables

__all__ = ["Arcs", "Lattice", "counted", "touches"]

_FINE: Final = 0.0025  # mm; heights need not be told apart more finely to end on an event plane


@dataclass(frozen=True, slots=True)
class Lattice:
    """The heights at which layers may end.

    Attributes:
        unit: mm.
        steps: z steps in a unit.
        n: units in the part.
        heights: (R,) all heights that the printer can print, in units.
    """

    unit: float
    steps: int
    n: int
    heights: Int

    @property
    def cells(self) -> int:
        """Cells in a unit: an even number, each no larger than 0.0025 mm."""
        return 2 * max(int(np.ceil(self.unit / (2 * _FINE) - 1e-6)), 1)

    @classmethod
    def of(cls, steps: Steps, more: Sequence[float] = ()) -> Lattice:
        """The coarsest lattice with all allowed heights, and `more` in mm, that is fine enough for event planes."""
        wanted = [steps.of(height) for height in more]
        common = gcd(*steps.allowed.tolist(), *wanted, steps.first, steps.part)
        fits = [
            d for d in range(1, common + 1) if common % d == 0 and (d == 1 or d * steps.size <= _FINE + 1e-9)
        ]
        size = fits[-1]
        low, high = -(-steps.lowest // size), steps.highest // size
        return cls(steps.size * size, size, steps.part // size, np.arange(low, high + 1, dtype=np.int64))

    def nearest(self, z: Float) -> Int:
        """The nodes nearest to heights in mm."""
        return np.rint(np.asarray(z) / self.unit).astype(np.int64).clip(0, self.n)

    def ends(self) -> tuple[Int, Int]:
        """Start (R, n + 1) and end (n + 1,) of every layer in units; starts under the bed are negative."""
        end = np.arange(self.n + 1)
        return end - self.heights[:, None], end


@dataclass(frozen=True, slots=True, eq=False)
class Arcs:
    """What every layer would do.

    Attributes:
        lattice: heights and ends.
        bound: (R, n + 1) mm, certified error; errs upward by less than a cell.
        volume: (R, n + 1) mm³, wrongly filled or empty at most.
        seconds: (R, n + 1) s, modelled.
    """

    lattice: Lattice
    bound: Float
    volume: Float
    seconds: Float

    def __post_init__(self) -> None:
        for name in ("bound", "volume", "seconds"):
            shape = (len(self.lattice.heights), self.lattice.n + 1)
            object.__setattr__(self, name, frozen_array(getattr(self, name), np.float64, shape))

    @classmethod
    def over(cls, surface: Surface, lattice: Lattice, profile: Profile) -> Arcs:
        """The tables for a part."""
        containment = profile.quality.containment
        middles: Float = np.arange(2 * lattice.n + 1, dtype=np.float64) * (lattice.unit / 2)
        times = LayerTimes(surface, profile, middles)
        volume = _volumes(surface, lattice, containment)
        return cls(lattice, _bounds(surface, lattice, containment), volume, _seconds(lattice, times))


def _bounds(surface: Surface, lattice: Lattice, containment: str) -> Float:
    """Certified error of every layer."""
    cell, n_cells, heights = lattice.unit / lattice.cells, lattice.cells * lattice.n, lattice.heights
    contained, half = containment != "mid", lattice.cells // 2
    # From the cut in the middle to either end, or through the whole layer.
    length = heights * (lattice.cells if contained else half)
    rising = run_tables(surface.contacts, cell, n_cells, length, contained=contained)
    falling = run_tables(surface.turned, cell, n_cells, length, bottom=-n_cells * cell, contained=contained)
    bound = np.zeros((len(heights), lattice.n + 1))
    for row, height in enumerate(heights.tolist()):
        start = lattice.cells * np.arange(lattice.n + 1 - height)
        first, last = (start, start + lattice.cells * height) if contained else (start + half * height,) * 2
        bound[row, height:] = np.maximum(rising[row, first], falling[row, n_cells - last])
    return bound


def _volumes(surface: Surface, lattice: Lattice, containment: str) -> Float:
    """Wrong volume of every layer, at most."""
    cell, n, cells = lattice.unit / lattice.cells, lattice.n, lattice.cells
    up, down = (shadow.on_lattice(cell, cells * n) for shadow in (surface.up, surface.down))
    volume = np.zeros((len(lattice.heights), n + 1))
    over, under = (up, down) if containment != "negative" else (down, up)
    # Shadows just above and just below each end, from the nearest cell: flats in the end itself belong to one side.
    just_above, just_below = np.append(np.diff(over), 0.0) / cell, np.append(0.0, np.diff(under)) / cell
    for row, height in enumerate(lattice.heights.tolist()):
        start, end = cells * np.arange(n + 1 - height), cells * np.arange(height, n + 1)
        if containment == "mid":
            both, middle = up + down, start + cells // 2 * height
            volume[row, height:] = both[start] + both[end] - 2 * both[middle]
        else:
            thick = cells * height * cell
            added = over[end] - over[start] - thick * just_above[start]
            volume[row, height:] = added + thick * just_below[end] - under[end] + under[start]
    return np.maximum(volume, 0.0)


def _seconds(lattice: Lattice, times: LayerTimes) -> Float:
    """Modelled time of every layer."""
    seconds = np.zeros((len(lattice.heights), lattice.n + 1))
    for row, height in enumerate(lattice.heights.tolist()):
        middle = slice(height, 2 * lattice.n + 1 - height, 2)
        seconds[row, height:] = times.seconds(middle, height * lattice.unit)
    return seconds


def counted(places: tuple[Int, Int], weight: Float, start: Int, end: Int) -> Float:
    """(R, n + 1) total weight of the places, each from a lowest to a highest node, strictly within every layer."""
    n = len(end) - 1
    started, ended = (
        np.cumsum(np.bincount(nodes, weights=weight, minlength=n + 1).astype(np.float64)) for nodes in places
    )
    within = np.append(0.0, ended[:-1])[end] - started[np.maximum(start, 0)]
    return np.where(within > 1e-9, within, 0.0)  # sums leave their rounding behind


def touches(places: Int, start: Int, end: Int) -> Bool:
    """(R, n + 1) whether a layer begins or ends at one of the places."""
    member = np.zeros(len(end), np.bool_)
    member[places] = True
    return np.asarray(member[end] | (member[np.maximum(start, 0)] & (start >= 0)))
